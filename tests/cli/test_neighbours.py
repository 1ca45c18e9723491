"""Two commands that write the same: the second is told in one sentence, and changes nothing."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from recording_samples import pushed

from palpate.cli import main
from palpate.files import held_folder, only_writer
from palpate.io.recording_mcap import write_recording


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("all").mkdir()
    write_recording(pushed(20), "all/push.mcap")


@contextmanager
def grows(path: Path) -> Iterator[None]:
    with held_folder(path):
        yield


@pytest.mark.parametrize(
    ("words", "first"),
    [
        ("simulate out --shape disc --count 1 --seconds 3 --no-images", grows),
        ("simulate out --shape disc --count 1 --seconds 3 --no-images --resume", grows),
        ("evaluate all --out out --tactile none", grows),
        ("evaluate all --out out --tactile none --resume", grows),
        ("tune all --out out --tactile oracle --evaluations 3", only_writer),
    ],
)
def test_the_second_is_told(words, first, capsys):
    if words.startswith("simulate"):
        pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")
    with first(Path("out")):
        before = sorted(Path().rglob("*"))
        assert main.main(words.split()) == 2
        assert sorted(Path().rglob("*")) == before
    said = capsys.readouterr().err
    assert said == "palpate: out: another process is writing it; wait until it ends, or name another\n"
