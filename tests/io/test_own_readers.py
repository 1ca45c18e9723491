"""Readers of users' own: the package of the examples, really installed, and such as do not work."""

import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_package import EXAMPLES

from palpate import Disc, FileError, SettingError, Trajectory
from palpate import io as formats
from palpate.cli.main import main
from palpate.lab.study.recordings import find_recordings
from palpate.live.sources import Clock, TimedPose, own_poses

LOG = "# my-robot log, disc of 50 mm\ntime_ms,x_mm,y_mm,yaw_deg,touching\n" + "".join(
    f"{33 * index},{100 + index},{20},{90},{int(index > 5)}\n" for index in range(12)
)


@pytest.fixture(autouse=True)
def _anew(tmp_path, monkeypatch):
    """Every test works in a folder of its own and finds what it installs there."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    yield


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """A folder into which pip has installed the example."""
    folder = tmp_path_factory.mktemp("example")
    shutil.copytree(EXAMPLES / "own_package", folder / "source")
    quiet = ["--quiet", "--no-index", "--no-deps", "--no-build-isolation", "--disable-pip-version-check"]
    words = [sys.executable, "-m", "pip", "install", *quiet, "--target", folder / "site", folder / "source"]
    subprocess.run(words, check=True, timeout=100)
    return folder / "site"


def write_reader(code: str) -> None:
    """Install a module of a reader `bad`, as if by pip."""
    info = Path("site/bad-1.0.dist-info")
    info.mkdir(parents=True)
    Path("site/bad_reader.py").write_text(code)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bad\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[palpate.io]\nbad = bad_reader\n")
    sys.modules.pop("bad_reader", None)


def test_the_example_reads_tracks_and_gives_poses(site, monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(site))
    Path("push.log").write_text(LOG)
    found: Any = formats.read("push.log")
    assert formats.detect_format("push.log") == "my-robot" and found.file == Path("push.log")
    assert found.shape == Disc(0.05) and found.contact.sum() == 6
    assert found.sensor_pose[3] == pytest.approx([0.103, 0.02, np.pi / 2]) and found.time[1] == pytest.approx(0.033)
    assert main(["info", "push.log"]) == 0 and "my robot, push.log" in capsys.readouterr().out
    words = ["track", "push.log", "--first-pose", "0.1", "0.1", "0", "--tactile", "none", "--out", "run"]
    assert main(words) == 0 and Path("run/summary.json").exists()
    assert main(["convert", "push.log", "push.mcap"]) == 0
    copy: Any = formats.read("push.mcap")
    assert np.array_equal(copy.sensor_pose, found.sensor_pose)
    assert sorted(find_recordings(Path(), leave_out=Path("run"))) == ["push.log", "push.mcap"]
    Path("cut.log").write_text(LOG[:-3])
    with pytest.raises(FileError, match=r"cut.log: expected lines of five numbers"):
        formats.read("cut.log")
    clock = Clock()
    pose = next(iter(own_poses("my-robot", clock)(threading.Event())))
    assert isinstance(pose, TimedPose) and abs(pose.time - clock.now()) < 5.0


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (
            "raise ImportError('no driver')",
            "entry point 'bad' of palpate.io (bad_reader) ended with ImportError: no driver",
        ),
        (
            "def detect(path): return True",
            "AttributeError: module 'bad_reader' has no attribute 'read'",
        ),
        (
            "def detect(path): raise KeyError('x')\ndef read(path): pass",
            "push.log: entry point 'bad' of",
        ),
        ("def detect(path): return 1\ndef read(path): return path[3]", "(bad_reader) ended with TypeError: "),
        ("def detect(path): return True\ndef read(path): return {}", "read a dict, expected a palpate.Recording or a"),
        (
            "import palpate\ndef detect(path): return True\ndef read(path): raise palpate.FileError('no\\x1b poses')",
            "push.log: no\\x1b poses",
        ),
        (
            "def detect(path): return False\ndef read(path): pass",
            "push.log: is in no known format; known are ",
        ),
    ],
)
def test_a_reader_that_does_not_work_is_named_in_one_line(capsys, code, said):
    Path("push.log").write_text(LOG)
    write_reader(code)
    assert main(["info", "push.log"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and said in err


def test_palpates_own_formats_come_first():
    write_reader("raise ImportError('no driver')")
    Path("path.tum").write_text("0 1 2 0 0 0 0 1\n")
    assert isinstance(formats.read("path.tum"), Trajectory)
    with pytest.raises(SettingError, match=r"format 'none' is not known, allowed are .*, bad"):
        formats.read("path.tum", "none")
