import numpy as np
import pytest

from palpate.recording.trajectory import Trajectory
from palpate.tracking.recovery import recovery, unfelt

NAN = float("nan")


def trajectory(contact=()):
    """Return 40 frames at 10 Hz, with contact but for those that are given."""
    flags = np.ones(40, np.bool_)
    flags[list(contact)] = False
    return Trajectory(np.arange(40) / 10, np.zeros((40, 3)), contact=flags)


def frames(*numbers):
    flags = np.zeros(40, np.bool_)
    flags[list(numbers)] = True
    return flags


def errors():
    """Return errors [mm] after knocks in frames 5 and 6, and in frame 25."""
    error = np.full(40, 2.0)
    error[5:13] = 20.0
    error[9:11] = 3.0  # 0.1 s are not to stay
    error[25:37] = 30.0  # and 0.2 s at the end neither
    return error


def test_recovery_by_hand():
    found = recovery(trajectory([8, 9]), errors(), np.zeros(40), frames(5, 6, 25))
    assert found["knocks"] == 2
    # Near from frame 13 on, 0.7 s after frame 6, of which two frames are not in contact.
    assert found["knock_recovery_s"] == [pytest.approx(0.7), None]
    assert found["knock_recovery_contact_s"] == [pytest.approx(0.5), None]
    # Frames 7 to 24 but for two of them, and 26 to 39.
    assert found["knock_contact_s"] == [pytest.approx(1.6), pytest.approx(1.4)]
    # 0.5 s after them 20 and 30 mm, 1 s after them 2 and 30, 1.5 s after them 2 and 2, for frame 39 is beside the end;
    # 2 s after the first there is the second.
    error = found["error_after_knock_mm"]
    assert error == {"0.5": 25.0, "1": 16.0, "1.5": 2.0, "2": None, "3": None}


def test_an_estimate_that_was_never_off_recovers_at_once():
    found = recovery(trajectory(), np.full(40, 9.9), np.full(40, -4.9), frames(20, 21))
    assert found["knock_recovery_s"] == found["knock_recovery_contact_s"] == [0.0]


def test_rotation_counts_in_both_directions():
    rotation = np.zeros(40)
    rotation[20:24] = -5.1
    found = recovery(trajectory(), np.zeros(40), rotation, frames(20))
    assert found["knock_recovery_s"] == [pytest.approx(0.4)]


def test_the_next_knock_ends_the_wait():
    error = np.full(40, 2.0)
    error[5:8] = 20.0
    # Frames 8 and 9 are near, which is 0.1 s, and in frame 10 it is knocked again.
    found = recovery(trajectory(), error, np.zeros(40), frames(5, 10))
    assert found["knock_recovery_s"] == [None, 0.0]


def test_only_scored_frames_count():
    error = np.full(40, 2.0)
    error[5:8] = 20.0
    error[10:20] = NAN
    # Near from frame 8 on; frames 8, 9, 20 and 21 are 0.3 s of it.
    found = recovery(trajectory(), error, np.zeros(40), frames(5))
    assert found["knock_recovery_s"] == [pytest.approx(0.3)]
    assert found["error_after_knock_mm"]["0.5"] == 2.0  # frame 10 is unknown, 9 beside it
    assert found["error_after_knock_mm"]["1"] is None
    error[21:] = 20.0
    assert recovery(trajectory(), error, np.zeros(40), frames(5))["knock_recovery_s"] == [None]


def test_unfelt_from_a_knock_to_the_next_touch():
    knocked = np.array([0, 1, 1, 0, 0, 0, 1, 0, 0], np.bool_)
    contact = np.array([1, 1, 0, 0, 1, 1, 1, 1, 0], np.bool_)
    np.testing.assert_array_equal(unfelt(knocked, contact), [0, 0, 1, 1, 0, 0, 0, 0, 0])
    assert not unfelt(np.zeros(3, np.bool_), np.zeros(3, np.bool_)).any()


def test_without_knocks_and_without_truth():
    none = recovery(trajectory(), errors(), np.zeros(40), frames())
    assert (none["knocks"], none["knock_recovery_s"], none["knock_recovery_contact_s"]) == (0, [], [])
    assert set(none["error_after_knock_mm"].values()) == {None}
    blind = recovery(trajectory(), np.full(40, NAN), np.full(40, NAN), frames(3, 8))
    assert (blind["knocks"], blind["knock_recovery_s"]) == (2, [None, None])
    unknown = recovery(trajectory(), errors(), np.zeros(40), None)
    assert set(unknown) == set(blind) and set(unknown.values()) == {None}
