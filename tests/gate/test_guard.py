"""What the guard refuses and what it believes, at 30 frames a second."""

import numpy as np
import pytest

from palpate.errors import FrameError
from palpate.gate.guard import StreamGuard

RATE, SPEED = 30.0, 0.03  # [Hz], [m/s]: 1 mm a frame


def guard_after(frames: int, touched: bool = True) -> StreamGuard:
    """A guard that has seen so many frames of a sensor that goes on along x."""
    guard = StreamGuard(RATE)
    for frame in range(frames):
        guard.check_time(frame / RATE)
        assert not guard.check_pose(frame / RATE, at(frame), touched)
    return guard


def at(frame: float) -> np.ndarray:
    return np.array([SPEED * frame / RATE, 0.0, 0.0])


def test_a_stamp_that_leaps_is_refused_and_a_clock_that_was_set_on_is_believed():
    guard = guard_after(10)
    with pytest.raises(FrameError, match=r"frame at 1000\.333 s comes 1e\+03 s after the last one, more than 60 s"):
        guard.check_time(1000.333)
    guard.check_time(10 / RATE)  # it was one stamp: the next is as before
    guard.check_pose(10 / RATE, at(10), touched=True)
    with pytest.raises(FrameError):
        guard.check_time(1000.333)
    guard.check_time(1000.366)  # the clock was set on: the next one follows


@pytest.mark.parametrize(("unit", "word"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_stamps_in_another_unit_are_never_believed(unit, word):
    guard = StreamGuard(RATE)
    guard.check_time(2.0 * unit)
    guard.check_pose(2.0 * unit, at(0), touched=False)
    for frame in range(1, 5):
        interval = unit / RATE
        if interval > 60.0:
            with pytest.raises(FrameError, match=f"are these {word}"):
                guard.check_time((2.0 + frame / RATE) * unit)


@pytest.mark.parametrize("length", [0.02, 1.0])
def test_one_pose_that_leaps_in_a_contact_is_refused(length):
    guard = guard_after(20)
    with pytest.raises(FrameError, match=r"m and 0 degrees from where"):
        guard.check_pose(20 / RATE, at(20) + np.array([0.0, length, 0.0]), touched=True)
    assert not guard.check_pose(21 / RATE, at(21), touched=True)


def test_poses_that_agree_with_each_other_are_believed():
    guard = guard_after(20)
    elsewhere = np.array([0.0, 0.3, 0.0])
    for frame in (20, 21):
        with pytest.raises(FrameError, match="faster than any arm; 3 in a row that agree are believed"):
            guard.check_pose(frame / RATE, at(frame) + elsewhere, touched=True)
    assert guard.check_pose(22 / RATE, at(22) + elsewhere, touched=True)
    assert not guard.check_pose(23 / RATE, at(23) + elsewhere, touched=True)


def test_between_contacts_a_sensor_may_be_anywhere():
    guard = guard_after(20, touched=False)
    assert not guard.check_pose(20 / RATE, at(20) + np.array([0.3, 0.0, 0.0]), touched=False)


def test_a_robot_that_speeds_up_and_frames_that_are_missing_are_no_leap():
    guard = guard_after(20)
    assert not guard.check_pose(20 / RATE, at(20) + np.array([0.0, 0.012, 0.0]), touched=True)  # 10.8 m/s^2
    guard = guard_after(20)
    assert not guard.check_pose(28 / RATE, at(19), touched=True)  # it stopped meanwhile, 9 mm before where it might be


def test_millimetres_are_asked_for():
    guard = guard_after(5)
    with pytest.raises(FrameError, match="are these millimetres"):
        guard.check_pose(5 / RATE, 1e3 * np.array([0.5, 0.0, 0.0]), touched=True)


def test_degrees_are_asked_for():
    guard = guard_after(5)
    with pytest.raises(FrameError, match=r"has the sensor 0\.001 m and 57 degrees .*; is theta in degrees\?"):
        guard.check_pose(5 / RATE, at(5) + np.array([0.0, 0.0, 1.0]), touched=True)


def test_a_pose_that_stands_still_from_full_speed_on_is_frozen():
    guard = guard_after(20)
    lags = []
    for frame in range(20, 40):
        guard.check_pose(frame / RATE, at(19), touched=True)
        lags.append(guard.blind)
    assert lags[:2] == [0.0, 0.0]  # no harm yet
    assert lags[-1] == pytest.approx(0.02)  # 20 frames of 1 mm
    with pytest.raises(FrameError):  # 21 mm are too many for one frame, and not for two
        guard.check_pose(40 / RATE, at(40), touched=True)
    assert guard.check_pose(41 / RATE, at(41), touched=True)
    assert guard.blind == 0.0


def test_a_pose_that_goes_on_from_where_it_stood_was_not_frozen():
    guard = guard_after(20)
    for frame in range(20, 40):
        guard.check_pose(frame / RATE, at(19), touched=True)
    assert guard.blind == pytest.approx(0.02)
    assert not guard.check_pose(40 / RATE, at(19.5), touched=True)  # half a millimetre
    assert guard.blind == guard.unseen == 0.0
    for frame in range(41, 60):
        guard.check_pose(frame / RATE, at(frame - 20.5), touched=True)
    for frame in range(60, 80):  # from now on nobody wonders that it stands
        guard.check_pose(frame / RATE, at(38.5), touched=True)
        assert guard.blind == 0.0


def test_a_contact_that_ends_while_the_pose_is_frozen_leaves_the_way_unseen():
    guard = guard_after(20)
    for frame in range(20, 40):
        guard.check_pose(frame / RATE, at(19), touched=True)
    guard.check_pose(40 / RATE, at(19), touched=False)
    assert guard.unseen == pytest.approx(0.02) and guard.blind == 0.0
    # A touch that is felt while the pose still stands is elsewhere, until the pose goes on.
    for frame in (42, 43):
        guard.check_pose(frame / RATE, at(19), touched=True)
        assert guard.blind == pytest.approx((frame - 19) * 1e-3)
    guard.check_pose(44 / RATE, at(19), touched=False)
    guard.check_pose(45 / RATE, at(45), touched=True)
    assert guard.blind == 0.0


def test_poses_that_stand_before_a_contact_are_known_to_stand_exactly():
    guard = StreamGuard(RATE)
    for frame in range(10):
        guard.check_pose(frame / RATE, at(0), touched=False)
    for frame in range(10, 40):
        guard.check_pose(frame / RATE, at(frame - 9.5), touched=frame > 12)
    for frame in range(40, 60):
        guard.check_pose(frame / RATE, at(29.5), touched=True)
        assert guard.blind == 0.0


def test_what_may_be_pushed_between_two_frames():
    guard = guard_after(20)
    guard.check_pose(50 / RATE, at(50) + np.array([0.0, 0.04, 0.0]), touched=True)  # 31 mm along, 40 across
    assert guard.pushed == pytest.approx(np.hypot(0.031, 0.04))
    guard = guard_after(20)
    guard.check_pose(50 / RATE, at(50) + np.array([0.0, 0.04, 0.0]), touched=False)
    assert guard.pushed == pytest.approx(0.031)  # for 31 frames at 1 mm a frame
    guard = guard_after(20)
    guard.check_pose(20 / RATE, at(19), touched=True)  # it stands when it is seen last
    guard.check_pose(50 / RATE, at(50), touched=False)
    assert guard.pushed == 0.0


def test_a_robot_that_slows_down_and_stands_is_not_frozen():
    guard = guard_after(20)
    place = 19.0
    for frame in range(20, 29):
        place += (29 - frame) / 10
        guard.check_pose(frame / RATE, at(place), touched=True)
    for frame in range(29, 80):
        guard.check_pose(frame / RATE, at(place), touched=True)
        assert guard.blind == 0.0


def test_a_sensor_that_draws_back_touches_nothing():
    guard = guard_after(20)
    for frame in range(1, 6):
        guard.check_pose((19 + frame) / RATE, at(19 - frame), touched=True)
        assert not guard.drawn_back  # up to 5 mm
    guard.check_pose(25 / RATE, at(13), touched=True)
    assert guard.drawn_back
    guard.check_pose(26 / RATE, at(12), touched=False)
    assert not guard.drawn_back
