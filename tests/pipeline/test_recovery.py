import numpy as np
import pytest

from palpate.pipeline.metrics import recovery, unfelt
from palpate.types.trajectory import Trajectory

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
    error[8:12] = 3.0  # 0.3 s, but not to stay
    error[25:37] = 30.0  # and 0.2 s at the end are too short to tell
    return error


def test_recovery_by_hand():
    found = recovery(trajectory([8, 9]), errors(), np.zeros(40), frames(5, 6, 25))
    assert found["knocks"] == 2
    # Near from frame 13 on, 0.7 s after frame 6, of which two frames are not in contact.
    assert found["knock_recovery_s"] == [pytest.approx(0.7), None]
    assert found["knock_recovery_contact_s"] == [pytest.approx(0.5), None]
    # Frames 7 to 24 but for two of them, and 26 to 39.
    assert found["knock_contact_s"] == [pytest.approx(1.6), pytest.approx(1.4)]
    # 1.5 s after the second, the last frame is beside the end; 2 s after the first there is the second.
    known = {"0.5": [3.0, 30.0], "1": [2.0, 30.0], "1.5": [2.0, 2.0], "2": [None, None], "3": [None, None]}
    assert found["knock_error_mm"] == known


def test_one_frame_that_is_off_before_the_next_knock_is_not_to_have_stayed():
    error = np.full(40, 2.0)
    error[20] = 10.1
    found = recovery(trajectory(), error, np.zeros(40), frames(5, 25))
    # Near at once and for 1.5 s, and then from frame 21 to the next knock.
    assert found["knock_recovery_s"] == [pytest.approx(1.6), 0.0]
    error[24] = 10.1
    found = recovery(trajectory(), error, np.zeros(40), frames(5, 25))
    assert found["knock_recovery_s"] == found["knock_recovery_contact_s"] == [None, 0.0]
    assert found["knock_contact_s"] == [pytest.approx(1.9), pytest.approx(1.4)]


def test_recovery_needs_no_contact_that_lasts():
    error = np.full(40, 2.0)
    error[5:12] = 20.0
    # One frame of contact, the 11th, mends it; then there is none up to the end.
    found = recovery(trajectory([*range(6, 11), *range(12, 40)]), error, np.zeros(40), frames(5))
    assert found["knock_recovery_s"] == [pytest.approx(0.7)]
    assert found["knock_recovery_contact_s"] == found["knock_contact_s"] == [pytest.approx(0.1)]


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
    error[10:20] = error[22:] = NAN
    # Near from frame 8 on; frames 8, 9, 20 and 21 are 0.3 s of it.
    found = recovery(trajectory(), error, np.zeros(40), frames(5))
    assert found["knock_recovery_s"] == [pytest.approx(0.3)]
    assert found["knock_contact_s"] == [pytest.approx(1.6)]  # what becomes of it after frame 21 is not known
    assert found["knock_error_mm"] == {"0.5": [2.0], "1": [None], "1.5": [2.0], "2": [None], "3": [None]}
    error[21] = NAN
    assert recovery(trajectory(), error, np.zeros(40), frames(5))["knock_recovery_s"] == [None]
    error[22:] = 20.0
    found = recovery(trajectory(), error, np.zeros(40), frames(5))
    assert (found["knock_recovery_s"], found["knock_contact_s"]) == ([None], [pytest.approx(3.4)])


def test_unfelt_from_a_knock_to_the_next_touch():
    knocked = np.array([0, 1, 1, 0, 0, 0, 1, 0, 0], np.bool_)
    contact = np.array([1, 1, 0, 0, 1, 1, 1, 1, 0], np.bool_)
    np.testing.assert_array_equal(unfelt(knocked, contact), [0, 0, 1, 1, 0, 0, 0, 0, 0])
    assert not unfelt(np.zeros(3, np.bool_), np.zeros(3, np.bool_)).any()


def test_without_knocks_and_without_truth():
    none = recovery(trajectory(), errors(), np.zeros(40), frames())
    assert (none["knocks"], none["knock_recovery_s"], none["knock_recovery_contact_s"]) == (0, [], [])
    assert none["knock_error_mm"] == {"0.5": [], "1": [], "1.5": [], "2": [], "3": []}
    blind = recovery(trajectory(), np.full(40, NAN), np.full(40, NAN), frames(3, 8))
    assert (blind["knocks"], blind["knock_recovery_s"], blind["knock_contact_s"]) == (2, [None, None], [0.0, 0.0])
    unknown = recovery(trajectory(), errors(), np.zeros(40), None)
    assert set(unknown) == set(blind) and set(unknown.values()) == {None}
