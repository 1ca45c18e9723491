"""How runs with faults are scored and gathered in a table."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate.cli import main
from palpate.config import TrackerSettings
from palpate.errors import FileError, FrameError
from palpate.files import held_folder
from palpate.geometry.shapes import Disc, Rectangle, Shape
from palpate.io.recording_mcap import write_recording
from palpate.lab.study.faults import bench
from palpate.lab.study.faults.bench import FaultRun, run_faults, run_stream
from palpate.lab.study.faults.faults import FAULTS, is_of
from palpate.lab.study.faults.stream import Stream, check_faults, stream_of
from palpate.lab.study.faults.table import rows_of, write_table
from palpate.types.estimate import Estimate
from palpate.types.frame import Frame
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT

DISC = Disc(0.1)
SMALL = replace(DIGIT, name="small", image_height=8, image_width=6)


class Told:
    """A tracker that says what a test has written down: error [m], status and yaw, or an error to raise."""

    script: list[Any]

    def __init__(self, *_: Any, **__: Any) -> None:
        self._next = iter(self.script)

    def update(self, frame: Frame) -> Estimate:
        said = next(self._next)
        if isinstance(said, Exception):
            raise said
        error, status, *yaw = said
        return Estimate(frame.time, np.array([error, 0.0, *(yaw or [0.0])]), 1e-6 * np.eye(3), True, status)


def scored(monkeypatch: Any, script: list[Any], begin: float = 0.0, shape: Shape = DISC) -> FaultRun:
    """Run frames half a second apart, all in contact, with the object at the origin."""
    monkeypatch.setattr(bench, "Tracker", Told)
    monkeypatch.setattr(Told, "script", script, raising=False)
    frames = tuple(Frame(0.5 * n, np.zeros(3), contact=True, object_pose=np.zeros(3)) for n in range(len(script)))
    arrival = np.array([frame.time for frame in frames])
    stream = Stream(frames, arrival, shape, DIGIT, np.zeros(3), begin=begin)
    return run_stream(stream, TrackerSettings())


def test_a_run_is_silently_wrong_while_it_is_far_off_and_content(monkeypatch):
    run = scored(monkeypatch, [(0.0, "tracking"), *[(0.011, "tracking")] * 3, (0.011, "strained"), (0.002, "tracking")])
    assert (run.silent_s, run.silently_wrong) == (1.5, True)
    assert run.told_after == 2.0 and not run.told
    assert run.final_mm == pytest.approx(2.0)
    assert run.inside_share == pytest.approx(2 / 6)  # 2 mm are 2 standard deviations
    assert not scored(monkeypatch, [(0.009, "tracking")] * 4).silently_wrong


def test_the_yaw_of_a_disc_does_not_count(monkeypatch):
    script = [(0.001, "tracking", 1.0)] * 4
    disc = scored(monkeypatch, script)
    assert (disc.silent_s, disc.inside_share, disc.final_deg) == (0.0, 1.0, 0.0)
    assert disc.final_mm == pytest.approx(1.0)
    other = scored(monkeypatch, script, shape=Rectangle(0.1, 0.05))
    assert other.silently_wrong and other.inside_share == 0.0 and other.final_deg == pytest.approx(np.degrees(1.0))


def test_only_what_comes_from_the_fault_on_counts(monkeypatch):
    run = scored(monkeypatch, [(0.02, "strained"), (0.02, "tracking"), (0.0, "tracking"), (0.0, "uncertain")], 1.0)
    assert (run.silent_s, run.told_after, run.inside_share) == (0.0, 0.5, 1.0)
    assert run.told


def test_a_refusal_tells_and_another_error_is_an_exception(monkeypatch):
    run = scored(monkeypatch, [(0.0, "tracking"), FrameError("too bright"), (0.001, "tracking")])
    assert (run.refused, run.first_refusal, run.exception, run.told_after) == (1, "too bright", "", 0.5)
    run = scored(monkeypatch, [(0.0, "tracking"), ValueError("oh"), (0.0, "tracking")])
    assert (run.exception, run.refused) == ("ValueError: oh", 0)


def made(fault: str, final_mm: float, silent_s: float = 0.0, told_after: float = np.nan) -> FaultRun:
    return FaultRun(fault, "r", final_mm, 1.0, 0.9, told_after, silent_s, 3, "", "", 30, 0.06)


def test_a_row_is_the_median_of_its_runs(tmp_path):
    runs = [*(made("none", mm) for mm in (1.0, 2.0, 9.0)), made("x", 3.0, 1.1, 0.5), made("x", 5.0, 0.9, 1.5)]
    clean, row = rows_of(runs)
    assert (clean.final_mm, clean.worst_mm, clean.times_clean, clean.told_percent) == (2.0, 9.0, 1.0, 0.0)
    assert (row.final_mm, row.times_clean, row.silent_percent, row.told_percent) == (4.0, 2.0, 50.0, 50.0)
    assert (row.inside_percent, row.refused_percent, row.step_ms) == pytest.approx((90.0, 10.0, 2.0))
    write_table(tmp_path, runs)
    (_, written) = csv.DictReader((tmp_path / "faults.csv").read_text().splitlines())
    assert (written["fault"], written["final_mm"], written["runs"]) == ("x", "4", "2")
    assert len((tmp_path / "fault_runs.csv").read_text().splitlines()) == 6


def test_any_name_can_be_written(tmp_path):
    write_table(tmp_path, [replace(made("none", 1.0), recording="=a\udcff.mcap")])
    (row,) = csv.DictReader((tmp_path / "fault_runs.csv").read_text().splitlines())
    assert row["recording"] == "'=a\\udcff.mcap"  # no formula
    assert (tmp_path / "faults.csv").exists()


def test_recordings_without_images_are_refused(tmp_path):
    write_recording(pushed(20), tmp_path / "disc-1.mcap")
    with pytest.raises(FileError, match=r"disc-1\.mcap: has no images, contact flags or ground truth"):
        run_faults({"disc-1.mcap": tmp_path / "disc-1.mcap"})


def flagged(contact: str) -> Recording:
    """A recording whose frames are in contact where it says 1."""
    flags = np.array([flag == "1" for flag in contact])
    images = tuple(encode_image(np.full((8, 6, 3), index, np.uint8), "png") for index in range(len(flags)))
    frames = pushed(len(flags))
    return replace(frames, contact=flags, episode=None, image=images, codec="png", sensor=SMALL)


@pytest.mark.parametrize(
    ("contact", "said"),
    [
        (40 * "0", "its longest contact has 0 frames, and faults need one of 14 or more"),
        ("00" + 13 * "1" + 13 * "0" + 13 * "1", "its longest contact has 13 frames"),
        ("0" + 20 * "1" + 10 * "0", "contact begins at frame 1, and faults need 2 or more frames before it"),
    ],
)
def test_recordings_that_faults_cannot_be_made_of_are_refused(tmp_path, contact, said):
    write_recording(flagged(contact), tmp_path / "disc-1.mcap")
    with pytest.raises(FileError, match=rf"disc-1\.mcap: {said}"):
        run_faults({"disc-1.mcap": tmp_path / "disc-1.mcap"})


def test_all_faults_can_be_made_of_others():
    recording = flagged("00" + 14 * "1")
    check_faults(recording)
    stream = stream_of(recording)
    for fault in (name for name in FAULTS if is_of(name, stream)):
        assert len(FAULTS[fault](stream, np.random.default_rng(0))) > 0


def test_the_command_writes_the_table(tmp_path, monkeypatch, capsys):
    (tmp_path / "recordings").mkdir()
    write_recording(pushed(20), tmp_path / "recordings" / "disc-1.mcap")
    asked: list[Any] = []

    def found(*_: Any, **options: Any) -> list[FaultRun]:
        asked.append(options)
        return [made("none", 2.0), made("x", 4.0)]

    monkeypatch.setattr(bench, "run_faults", found)
    words = ["evaluate", str(tmp_path / "recordings"), "--faults", "--out", str(tmp_path / "out")]
    assert main.main([*words, "--tactile", "none"]) == 2
    assert "--tactile cannot go with it" in capsys.readouterr().err
    others = (
        "--calibration",
        "unit.npz",
        "--first-pose-sigma",
        "1",
        "1",
        "2",
        "--first-pose-unknown",
        "--hypotheses",
        "1",
    )
    assert main.main([*words, *others]) == 2
    said = "--calibration, --first-pose-sigma, --first-pose-unknown, --hypotheses cannot go with it"
    assert said in capsys.readouterr().err
    assert main.main([*words, "--json"]) == 0
    assert asked[0]["model"] is None  # that of each recording's sensor
    said = json.loads(capsys.readouterr().out)
    assert [row["final_mm"] for row in said["faults"]] == [2.0, 4.0]
    assert Path(said["report"], "faults.csv").exists()
    words[-1] = str(tmp_path / "other")
    with held_folder(tmp_path / "other", "the folder of a report"):
        assert main.main(words) == 2
    assert "another process is writing" in capsys.readouterr().err
    monkeypatch.setattr(
        bench, "run_faults", lambda *_, **__: [made("none", 2.0), replace(made("x", 4.0), recording="b")]
    )
    assert main.main(words) == 0
    assert "2 recordings, one fault at a time" in capsys.readouterr().out
    monkeypatch.setattr(bench, "run_faults", lambda *_, **__: [])
    assert main.main([*words[:-1], str(tmp_path / "none")]) == 2
    assert "holds recordings with shoves alone" in capsys.readouterr().err
    words[-1] = said["report"]
    assert main.main(words) == 2
    assert "already exists" in capsys.readouterr().err
