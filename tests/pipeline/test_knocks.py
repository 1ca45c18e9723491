"""What knocks the object, on small recordings worked out by hand and on real ones."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import planar
import pytest

from palpate import POINT, Recording, Rectangle, SensorProfile
from palpate import io as formats
from palpate.pipeline.truth import flag_runs, knocked_frames

STEP = 1 / 30
BAR = Rectangle(0.2, 0.1)
MIDDLE = np.array([-0.1, 0.0])  # of the left side of the bar
FINGERS = SensorProfile(name="fingers", radius=0.0, tips=((0.0, -0.03), (0.0, 0.03)))


def pushed(
    n: int = 40, sideways: Any = (), turned: Any = (), speed: float = 0.02, sensor: SensorProfile = POINT
) -> Recording:
    """Return a bar that is pushed evenly at the middle of its left side, along x.

    In the steps that begin at frames `sideways` a hand slides it at 80 mm/s along y, in those at `turned` it turns it
    at 3 rad/s about the tip.
    """
    moves = np.zeros((n, 2))
    moves[np.asarray(sideways, int) + 1, 0] = 0.08 * STEP
    moves[np.asarray(turned, int) + 1, 1] = 3.0 * STEP
    y, theta = np.cumsum(moves, axis=0).T
    tip: Any = np.column_stack([-0.1 + speed * STEP * np.arange(n), np.zeros(n), np.zeros(n)])
    corner = planar.transform(np.column_stack([np.zeros((n, 2)), theta]), MIDDLE)
    pose = np.column_stack([tip[:, 0] - corner[:, 0], y - corner[:, 1], theta])
    return Recording(STEP * np.arange(n, dtype=np.float64), tip, BAR, sensor, pose, np.ones(n, np.bool_))


def knocks(recording: Recording) -> list[tuple[int, int]]:
    return flag_runs(knocked_frames(recording))


def test_nothing_knocks_what_is_pushed_evenly():
    assert knocks(pushed()) == []
    assert knocks(pushed(sensor=FINGERS)) == []
    assert knocks(pushed(1)) == []


def test_a_hand_that_turns_the_object_about_the_tip():
    # The far corners are 206 mm away and go at 619 mm/s, the sensor at 20.
    for sensor in (POINT, FINGERS):
        assert knocks(pushed(turned=[20, 21, 22], sensor=sensor)) == [(20, 23)]


def test_knocks_close_by_are_one_and_simulations_know_theirs():
    # From frame 23 to 29 it is 0.2 s, to frame 34 it is 0.37 s.
    assert knocks(pushed(turned=[20, 21, 22, 29, 30])) == [(20, 31)]
    assert knocks(pushed(turned=[20, 21, 22, 34, 35])) == [(20, 23), (34, 36)]
    told = np.zeros(40)
    told[3], told[5], told[6] = 1.0, np.nan, 0.5
    assert knocks(replace(pushed(turned=[20]), extra={"knocked": told})) == [(3, 3), (6, 6)]


def test_all_motion_of_an_untouched_object_is_unexplained():
    recording = pushed(speed=0.06)
    assert knocks(replace(recording, contact=np.zeros(40, np.bool_))) == [(0, 39)]
    slow = pushed(speed=0.04)
    assert knocks(replace(slow, contact=np.zeros(40, np.bool_))) == []
    # A push explains it, however late its flag comes.
    assert knocks(recording) == []


def test_a_knock_while_truth_is_unknown():
    recording = pushed()
    assert recording.object_pose is not None
    pose = recording.object_pose.copy()
    pose[25:, 1] += 0.04  # 40 mm in the 0.2 s from frame 19 to 25
    pose[20:25] = np.nan
    assert knocks(replace(recording, object_pose=pose)) == [(19, 25)]
    pose[10:25] = np.nan  # too long to tell
    assert knocks(replace(recording, object_pose=pose)) == []


def test_knocks_of_real_pushes(shared_data: Path):
    """By hands that were seen in plots of how the squares moved; [s]."""
    times = {
        "BigPertubations": [2.3, 5.7],
        "BigPertubations3": [],
        "BigPertubations5": [],
        "Pertubations": [2.75, 5.5],
        "DoublesBigPerturbations": [1.75, 5.17],
        "NoPerturbations": [],
        "NoPerturbationsBlackDark": [],
        "SinglePerturbationsBlack": [2.43],
        "DoublePerturbationsPlywoodNoLighting": [1.75, 3.87],
        "NoPerturbationsPlywoodNoLighting": [],
        "OpenLoopAmbientLight": [1.85, 4.07],
    }
    files = sorted((shared_data / "mit_point_push").glob("*.json.gz"))
    assert len(files) == len(times)
    for file in files:
        name = file.name.removesuffix(".json.gz").removeprefix("StraightLine_2016_10_23_").removeprefix("StraightLine")
        recording: Any = formats.load_recording(file)
        found = [recording.time[[first, last]].mean() for first, last in knocks(recording)]
        assert found == pytest.approx(times[name], abs=0.1), name
