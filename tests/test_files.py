"""Files and folders are written whole or not at all, and have one writer."""

import subprocess
import sys
from pathlib import Path

import pytest

from palpate import FileError
from palpate.files import whole_file
from palpate_lab.parallel import held_folder

# Holds something until it is killed.
CHILD = """
import sys
from pathlib import Path
from palpate_lab.parallel import held_folder
with held_folder(Path(sys.argv[1])):
    print("in", flush=True)
    sys.stdin.read()
"""


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def test_a_file_that_fails_leaves_the_old_one(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), whole_file(path, overwrite=True) as part:
        part.write_text("half")
        raise ZeroDivisionError
    with pytest.raises(FileError, match=r"a\.txt: cannot be written \(no space\)"), whole_file(path, overwrite=True):
        raise OSError("no space")
    with pytest.raises(FileError, match="already exists"), whole_file(path):
        pass
    assert names(tmp_path) == ["a.txt"] and path.read_text() == "old"
    with whole_file(path, overwrite=True) as part:
        part.write_text("new")
    assert names(tmp_path) == ["a.txt"] and path.read_text() == "new"


def test_one_process_writes_and_a_dead_one_holds_nothing(tmp_path):
    arguments = [sys.executable, "-c", CHILD, str(tmp_path / "study")]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None and child.stdout.readline() == "in\n"
        with (
            pytest.raises(FileError, match="study: another process is writing it"),
            held_folder(tmp_path / "study"),
        ):
            pass
        child.kill()
    with held_folder(tmp_path / "study"):
        pass
    assert names(tmp_path) == []


def test_unfinished_files_of_killed_processes_are_removed(tmp_path):
    for name in (".a.mcap.17.part", "b.mcap", "more/.c.npz.part"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    with held_folder(tmp_path):
        assert names(tmp_path) == [".folder.lock", "b.mcap", "more"]
