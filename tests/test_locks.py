"""What is written is whole, one process at a time writes it, and what a killed one left is told from what lives."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from palpate.errors import FileError
from palpate.files import whole_file, whole_folder
from palpate.locks import held_folder, only_writer, part_of, remove_parts

BUSY = "another process is writing it"

# Enters a block of ours, says so and waits there to be killed; with a second word dies at a step of its own.
CHILD = """
import os, signal, sys
from pathlib import Path
from palpate import files, locks
kind, path = sys.argv[1], Path(sys.argv[2])
if sys.argv[3:]:
    rename, calls = Path.rename, []
    def dying(self, target):
        calls.append(self)
        if len(calls) == int(sys.argv[3]):
            os.kill(os.getpid(), signal.SIGKILL)
        return rename(self, target)
    Path.rename = dying
block = {
    "file": lambda: files.whole_file(path, overwrite=True),
    "folder": lambda: files.whole_folder(path),
    "held": lambda: locks.held_folder(path, "a folder"),
    "writer": lambda: locks.only_writer(path),
}[kind]()
with block as part:
    if kind == "file":
        part.write_text("half")
    if kind == "folder":
        (part / "it").write_text("new")
    if not sys.argv[3:]:
        print("in", flush=True)
        sys.stdin.read()
"""


@pytest.fixture
def child() -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Starts processes that hold something; they are killed at the end."""
    started: list[subprocess.Popen[str]] = []

    def start(kind: str, path: Path) -> "subprocess.Popen[str]":
        words = [sys.executable, "-c", CHILD, kind, str(path)]
        process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        started.append(process)
        assert process.stdout is not None and process.stdout.readline() == "in\n"
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def kill(process: "subprocess.Popen[str]") -> None:
    process.kill()
    process.communicate()


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def test_a_file_is_written_by_one_and_taken_over_from_the_dead(child, tmp_path):
    path = tmp_path / "a.txt"
    writer = child("file", path)
    with pytest.raises(FileError, match=rf"a\.txt: {BUSY}; wait until it ends"), whole_file(path):
        pass
    assert part_of(path).read_text() == "half"
    kill(writer)
    assert names(tmp_path) == [".a.txt.part"]
    with whole_file(path) as part:
        assert part.read_text() == ""  # of the dead one nothing is left
        part.write_text("whole")
    assert names(tmp_path) == ["a.txt"] and path.read_text() == "whole"


def test_a_file_that_fails_leaves_the_old_one(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), whole_file(path, overwrite=True) as part:
        part.write_text("half")
        raise ZeroDivisionError
    with pytest.raises(FileError, match=r"a\.txt: cannot be written \(no space\)"), whole_file(path, overwrite=True):
        raise OSError("no space")
    assert names(tmp_path) == ["a.txt"] and path.read_text() == "old"


def test_nothing_is_written_through_a_link(tmp_path):
    (tmp_path / "mine").write_text("mine")
    part_of(tmp_path / "a.txt").symlink_to(tmp_path / "mine")
    with pytest.raises(FileError, match="cannot be written"), whole_file(tmp_path / "a.txt"):
        pass
    assert (tmp_path / "mine").read_text() == "mine"


def test_parts_of_the_dead_go_and_those_of_the_living_stay(child, tmp_path):
    kill(child("file", tmp_path / "dead"))
    child("file", tmp_path / "alive")
    (tmp_path / ".other.partial").touch()
    remove_parts(tmp_path, ".*.part")
    assert names(tmp_path) == [".alive.part", ".other.partial"]


def test_a_folder_is_made_by_one_and_taken_over_from_the_dead(child, tmp_path):
    folder = tmp_path / "runs" / "one"
    maker = child("folder", folder)
    with pytest.raises(FileError, match=rf"one: {BUSY}"), whole_folder(folder):
        pass
    assert (folder.parent / ".one.part" / "new" / "it").exists()
    kill(maker)
    with whole_folder(folder) as part:
        assert names(part) == []
        (part / "it").write_text("mine")
    assert names(tmp_path) == ["runs", "runs/one", "runs/one/it"]


def test_a_folder_that_fails_leaves_nothing(tmp_path):
    with pytest.raises(ZeroDivisionError), whole_folder(tmp_path / "a" / "b") as part:
        (part / "it").touch()
        raise ZeroDivisionError
    assert names(tmp_path) == []
    with pytest.raises(FileError, match="is not the name of a new folder"), whole_folder(Path("/")):
        pass


@pytest.mark.parametrize(("step", "found"), [(1, "old"), (2, "new")])
def test_one_that_replaces_a_folder_and_is_killed_loses_neither(tmp_path, step, found):
    """The old folder is moved away and the new one comes in its place; the kill is before either."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "it").write_text("old")
    done = subprocess.run([sys.executable, "-c", CHILD, "folder", str(folder), str(step)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert folder.exists() == (step == 1)
    with pytest.raises(FileError, match="as it was"), whole_folder(folder):
        assert (folder / "it").read_text() == found
        raise FileError("as it was")
    assert names(tmp_path) == ["run", "run/it"]


def test_a_folder_that_grows_is_held(child, tmp_path):
    holder = child("held", tmp_path / "a")
    with pytest.raises(FileError, match=rf"a: {BUSY}"), held_folder(tmp_path / "a", "a folder"):
        pass
    kill(holder)
    with held_folder(tmp_path / "a", "a folder"):
        pass
    assert names(tmp_path) == ["a"]  # it was there
    with pytest.raises(ZeroDivisionError), held_folder(tmp_path / "b" / "c", "a folder"):
        assert (tmp_path / "b" / "c").is_dir()
        raise ZeroDivisionError
    assert names(tmp_path) == ["a"]
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="file: cannot be a folder of mine"):
        held_folder(tmp_path / "file", "a folder of mine").__enter__()


def test_a_file_that_is_written_again_and_again_has_one_writer(child, tmp_path):
    path = tmp_path / "noise.json"
    writer = child("writer", path)
    with pytest.raises(FileError, match=rf"noise\.json: {BUSY}"), only_writer(path):
        pass
    kill(writer)
    with only_writer(path), whole_file(path) as part:
        part.write_text("{}")
    assert names(tmp_path) == ["noise.json"]


def test_a_system_without_locks(monkeypatch, tmp_path):
    monkeypatch.setattr("palpate.locks.fcntl", None)
    with whole_file(tmp_path / "a.txt") as part:
        part.write_text("whole")
    with whole_folder(tmp_path / "run") as part:
        (part / "it").touch()
    (tmp_path / ".b.part").touch()
    remove_parts(tmp_path, ".*.part")  # whose it is cannot be told, so it stays
    assert names(tmp_path) == [".b.part", "a.txt", "run", "run/it"]
