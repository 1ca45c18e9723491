"""A run that is interrupted goes on where it was, and a step that fails is written down."""

import dataclasses
import json
from contextlib import nullcontext

import numpy as np
import pytest
from recording_samples import pushed

from palpate.cli.main import main
from palpate.config import TrackerSettings
from palpate.errors import EstimationError, FileError
from palpate.filter.hypothesis_bank import Hypotheses
from palpate.geometry.shapes import Disc
from palpate.io.recording_mcap import write_recording
from palpate.pipeline import steps
from palpate.pipeline.failed_step import load_failed_step
from palpate.pipeline.run import track
from palpate.touch.model import SHIPPED
from palpate.tracker import Tracker
from palpate.types.answer import Answer
from palpate.types.frame import Frame
from palpate.types.recording import Recording

ORACLE = TrackerSettings(tactile="oracle", hypotheses=1)
EXACT = ("trajectory.tum", "estimates.csv", "answers.csv", "friction.csv", "settings.json")
"""Files of a run that say nothing of how long it took."""


class Killed(BaseException):
    """What stands for a kill: nothing catches it."""


@pytest.fixture(autouse=True)
def always_saved(monkeypatch, no_figures):
    monkeypatch.setattr(steps, "_EVERY", 0.0)
    monkeypatch.setattr(steps, "_SHARE", 0)


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Two contacts, and a pose that no frame can have."""
    given = pushed(45)
    poses = given.sensor_pose.copy()
    poses[12] = poses[12] + [3.0, 0.0, 0.0]
    return dataclasses.replace(given, sensor_pose=poses)


def killed_at(frame: int):
    def progress(done: int) -> None:
        if done == frame:
            raise Killed

    return progress


@pytest.mark.parametrize(("frame", "hypotheses"), [(1, 1), (14, 9), (30, 1)])
def test_a_run_goes_on_to_the_same_end(recording, frame, hypotheses, tmp_path):
    state, how = tmp_path / "state.npz", dataclasses.replace(ORACLE, hypotheses=hypotheses)
    with pytest.raises(Killed):
        track(recording, how, progress=killed_at(frame + 1), state=state)  # it is saved after the progress is told
    done: list[int] = []
    went_on, left_alone = track(recording, how, progress=done.append, state=state), track(recording, how)
    assert done == list(range(frame + 1, 46))
    for one, other in ((went_on.online, left_alone.online), (went_on.smoothed, left_alone.smoothed)):
        np.testing.assert_array_equal(one.pose, other.pose)
        np.testing.assert_array_equal(one.contact, other.contact)
    np.testing.assert_array_equal(went_on.online.covariance, left_alone.online.covariance)
    assert went_on.online.status == left_alone.online.status
    assert went_on.answers == left_alone.answers
    np.testing.assert_array_equal(went_on.friction, left_alone.friction)
    assert went_on.step_ms.shape == (45,)


def test_what_was_interrupted_is_of_the_same_recording_and_options(recording, tmp_path):
    state = tmp_path / "state.npz"
    with pytest.raises(Killed):
        track(recording, ORACLE, progress=killed_at(9), state=state)
    with pytest.raises(FileError, match="had another setting; say the same again"):
        track(recording, TrackerSettings(tactile="none"), state=state)
    with pytest.raises(FileError, match="had another first pose"):
        track(recording, ORACLE, (0.0, 0.0, 0.0), state=state)
    with pytest.raises(FileError, match="had another recording"):
        track(dataclasses.replace(recording, time=recording.time + 1.0), ORACLE, state=state)
    tracker = Tracker(recording.shape, recording.sensor, None)
    tracker.save(state)
    with pytest.raises(FileError, match="holds no steps of a recording"):
        track(recording, ORACLE, state=state)


def test_a_tracker_that_cannot_be_saved_is_tracked_all_the_same(tmp_path):
    state = tmp_path / "state.npz"
    assert len(track(pushed(4), TrackerSettings("oracle", "particle-filter"), state=state).online) == 4
    assert not state.exists()


def test_the_command_goes_on_and_keeps_what_is_whole(recording, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_recording(recording, tmp_path / "push.mcap")
    words = ["track", "push.mcap", "--tactile", "oracle", "--hypotheses", "1", "--out"]
    assert main([*words, "alone"]) == 0
    with monkeypatch.context() as patched, pytest.raises(Killed):
        patched.setattr("palpate.cli.console.progress_bar", lambda title, total: nullcontext(killed_at(14)))
        main([*words, "out"])
    assert [each.name for each in (tmp_path / ".out.part").iterdir()] == ["state.npz"]
    assert main([*words, "out", "--resume"]) == 0
    for name in EXACT:
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes(), name
    assert not (tmp_path / ".out.part").exists()
    before = (tmp_path / "out" / "summary.json").stat().st_mtime_ns
    (tmp_path / ".out.part").mkdir()
    (tmp_path / ".out.part" / "state.npz").write_bytes(b"of a process that was killed at its last move")
    capsys.readouterr()
    assert main([*words, "out", "--resume", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 45
    assert not (tmp_path / ".out.part").exists()
    assert (tmp_path / "out" / "summary.json").stat().st_mtime_ns == before
    capsys.readouterr()
    for options, other in (
        (("--smoother", "batch"), "with another smoother"),
        (("--first-pose", "0", "0", "0.1"), "with another first_pose"),
        (("--model", str(SHIPPED), "--tactile", "learnt"), "with another tactile"),
        (("--html",), "without page.html"),
        (("--mcap",), "without estimates.mcap"),
    ):
        assert main([*words, "out", "--resume", *options]) == 2
        assert f"holds a run {other}; --force replaces it" in capsys.readouterr().err
    write_recording(pushed(20), tmp_path / "push.mcap", overwrite=True)
    assert main([*words, "out", "--resume"]) == 2
    assert "holds a run with another recording" in capsys.readouterr().err


def test_what_an_earlier_run_left_is_of_no_account_unless_asked_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_recording(pushed(20), tmp_path / "push.mcap")
    (tmp_path / ".out.part").mkdir()
    (tmp_path / ".out.part" / "state.npz").write_bytes(b"damaged")
    words = ["track", "push.mcap", "--tactile", "oracle", "--hypotheses", "1", "--out", "out"]
    assert main([*words, "--resume"]) == 2
    assert main(words) == 0
    assert not (tmp_path / ".out.part").exists()


def test_a_step_that_fails_is_written_and_fails_again(recording, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_recording(recording, tmp_path / "push.mcap")
    last = int(np.flatnonzero(recording.contact)[-4])  # in the second contact
    touch, broken_at, poses = Hypotheses.touch, recording.time[last], last - 1  # one frame is left out

    def breaks(self: Hypotheses, sensor_pose, measurements, time):
        if time == broken_at:
            raise ZeroDivisionError(f"{len(self.path())} poses before")
        return touch(self, sensor_pose, measurements, time)

    monkeypatch.setattr(Hypotheses, "touch", breaks)
    words = ["track", "push.mcap", "--tactile", "oracle", "--hypotheses", "1", "--out", "out"]
    with pytest.raises(ZeroDivisionError):
        main(words)
    assert main([*words, "--dump"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"ZeroDivisionError: {poses} poses before; out-failed.npz holds the tracker before this step" in said
    assert "palpate.pipeline.failed_step.load_failed_step('out-failed.npz')" in said
    tracker, frame = load_failed_step("out-failed.npz")
    assert (frame.time, frame.contact) == (broken_at, True)
    np.testing.assert_array_equal(frame.sensor_pose, recording.sensor_pose[last])
    with pytest.raises(ZeroDivisionError, match=f"{poses} poses before"):
        tracker.update(frame)
    with pytest.raises(FileError, match="no frame that it fails on"):
        tracker.save("whole.npz")
        load_failed_step("whole.npz")


def test_a_failure_that_cannot_be_written_says_why(monkeypatch, tmp_path):
    def breaks(self: Tracker, frame: Frame, measurements=()):
        raise EstimationError("frame at 0.000 s: lost")

    monkeypatch.setattr(Tracker, "update", breaks)
    reason = r"frame at 0\.000 s: lost; what reproduces it cannot be written: .*such\.npz: the folder"
    with pytest.raises(EstimationError, match=reason):
        track(pushed(3), ORACLE, dump=tmp_path / "no" / "such.npz")


def test_answers_of_many_frames_are_saved_as_few_arrays(recording, tmp_path):
    first = recording[0]
    members = []
    for frames in (2, 60):
        taken = steps.Steps(Tracker(recording.shape, recording.sensor, recording.object_pose[0], ORACLE))
        estimate = taken.tracker.update(first)
        several = [(Answer(np.full(3, frame), np.eye(3) * frame, 0.5),) * 2 for frame in range(frames)]
        taken.estimates = [dataclasses.replace(estimate, answers=answers) for answers in several]
        taken.save(tmp_path / "state.npz", {})
        assert [one.answers for one in steps.load_steps(tmp_path / "state.npz", {}).estimates] == several
        with np.load(tmp_path / "state.npz") as state:
            members.append(len(state.files))
    assert members[1] <= members[0]


def test_of_many_frames_that_are_left_out_five_are_said(caplog):
    taker = steps.Steps(Tracker(Disc(0.05), "point", np.zeros(3)))
    for _ in range(8):
        taker.take(Frame(0.0, np.array([-0.3, 0.0, 0.0]), contact=False))  # none follows the first
    said = [record.getMessage() for record in caplog.records]
    assert len(said) == 5 and said[-1].endswith("times must increase; it is left out; further ones are counted only")
    assert taker.taken == [True, *[False] * 7]
