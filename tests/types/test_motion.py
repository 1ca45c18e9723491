"""Poses in space over time, between the times at which they are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate import FileError
from palpate.geometry import se2
from palpate.types.motion import always, at_times, poses_in_time


def placed_in_time(numbers, times):
    return poses_in_time("/a", "world", np.array(times, np.int64), np.array(numbers, np.float64))


def turned(yaw, x=0.0):
    return np.array([x, 0.0, 0.0, 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)])


def yaws(placed):
    return Rotation.from_quat(placed.rotation).as_euler("zyx")[:, 0]


def test_yaw_turns_through_pi_the_short_way():
    poses = placed_in_time([turned(3.0, 1.0), turned(-3.0, 2.0)], [0, 100_000_000])
    placed = at_times(poses, np.array([0, 25_000_000, 50_000_000, 100_000_000]))
    turn = 2 * np.pi - 6.0
    assert placed.known.all()
    assert placed.position[:, 0] == pytest.approx([1.0, 1.25, 1.5, 2.0])
    assert se2.wrap(yaws(placed) - 3.0 - turn * np.array([0, 0.25, 0.5, 1])) == pytest.approx(0.0, abs=1e-12)


def test_a_quaternion_and_its_negative_are_one_rotation():
    poses = placed_in_time([turned(0.2), -turned(0.4)], [0, 10])
    assert yaws(at_times(poses, np.array([5]))) == pytest.approx([0.3])


def test_poses_are_sorted_and_the_last_of_one_time_counts():
    poses = placed_in_time([turned(0.0, x) for x in (2.0, 0.0, 1.0, 5.0)], [20, 0, 10, 10])
    assert poses.time.tolist() == [0, 10, 20]
    assert poses.position[:, 0].tolist() == [0.0, 5.0, 2.0]


def test_before_after_and_in_long_gaps_nothing_is_known():
    second = 1_000_000_000
    times = [0, second, 2 * second, 2 * second + 10]
    poses = placed_in_time([turned(0.0, x) for x in (0.0, 0.0, 1.0, 1.1)], times)
    asked = np.array([-1, 0, second // 2, second, second + 5, 2 * second, 2 * second + 10, 2 * second + 11])
    # Nothing moved in the first second, so that gap hides nothing.
    assert at_times(poses, asked).known.tolist() == [False, True, True, True, False, True, True, False]
    alone = placed_in_time([turned(0.0)], [5])
    assert at_times(alone, np.array([4, 5, 6])).known.tolist() == [False, True, False]
    assert always(alone, 2).known.all()


@pytest.mark.parametrize(
    ("numbers", "word"),
    [([0, 0, np.nan, 0, 0, 0, 1], "nan"), ([0, 0, 0, 0, 0, 0, 0], "length 1"), ([0, 0, 0, 0, 0, 1, 1], "length 1")],
)
def test_poses_that_are_none(numbers, word):
    with pytest.raises(FileError, match=rf"/a: pose 1 at 2\.0+ s .*{word}"):
        placed_in_time([turned(0.0), numbers], [0, 2_000_000_000])
