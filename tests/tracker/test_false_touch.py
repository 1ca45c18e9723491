"""Brief touches where nothing should be: they may be none, and the object may have been moved."""

from dataclasses import replace

import numpy as np
import pytest
from push_samples import frames, in_two_contacts, pushed
from tracker_samples import nees, poses, settings, statuses, track

from palpate.geometry import se2

STEPS, AWAY = 30, 10  # frames of a contact but its first, and between the two
BEGIN = STEPS + 4


def touched(contact: np.ndarray, false: int) -> np.ndarray:
    """Flags that tell so many frames of contact too many, in the middle of the rest."""
    flags = contact.copy()
    flags[BEGIN : BEGIN + false] = True
    return flags


@pytest.mark.parametrize("false", [1, 4])
def test_what_was_known_before_a_false_touch_goes_on_beside_it(false):
    o, e, contact = in_two_contacts("disc", STEPS)
    how = settings("oracle", "fixed-lag")
    expected = poses(track("disc", frames(o, e, contact), o[0], how)[1])
    tracker, found = track("disc", frames(o, e, touched(contact, false)), o[0], how)
    after, again = BEGIN + false, STEPS + AWAY + 1
    assert set(statuses(found)[BEGIN:after]) <= {"displaced", "uncertain", "ambiguous"}
    # The best answer is that there was none; the other is told, and the region spans both.
    assert set(statuses(found)[after:again]) == {"ambiguous"}
    np.testing.assert_array_equal(poses(found)[:BEGIN], expected[:BEGIN])
    np.testing.assert_array_equal(poses(found)[after:again], expected[after:again])
    assert 0.5 <= found[after].answers[0].weight < 0.8  # half, and that of answers there is no room for
    # The next contact finds the object where it was.
    assert np.abs(poses(found)[-1] - expected[-1])[:2].max() < 2e-3
    assert len(tracker.smoothed()) == len(o)


@pytest.mark.parametrize(
    ("rate", "false", "is_brief"),
    [(30.0, 15, True), (30.0, 16, False), (60.0, 24, True), (60.0, 33, False), (15.0, 7, True), (15.0, 14, False)],
)
def test_half_a_second_is_brief_at_any_rate(rate, false, is_brief):
    o, e = pushed("rectangle", STEPS)
    rest = 40
    o, e = np.concatenate([o, np.tile(o[-1], (rest, 1))]), np.concatenate([e, np.tile([-0.4, 0.0, 0.0], (rest, 1))])
    seen = frames(o, e, touched(np.arange(len(o)) <= STEPS, false))
    seen = [replace(frame, time=k / rate) for k, frame in enumerate(seen)]
    found = track("rectangle", seen, o[0], settings())[1]
    off = [np.abs(answer.pose - found[STEPS + 1].pose).max() for answer in found[-1].answers]
    assert (min(off) < 1e-4) == is_brief


def test_a_brief_touch_of_an_object_that_was_moved_is_not_forgotten():
    o, e, contact = in_two_contacts("disc", STEPS)
    moved = np.array([0.02, 0.0, 0.0])
    rest = np.arange(len(o)) > STEPS
    o[rest], e[rest] = se2.compose(moved, o[rest]), se2.compose(moved, e[rest])
    again = STEPS + AWAY + 1
    contact[again + 3 : again + 6] = False  # three frames of touch, three of none, and touch again
    estimates = track("disc", frames(o, e, contact), o[0], settings("oracle", "fixed-lag"))[1]
    assert statuses(estimates)[again + 3 : again + 6] == ["ambiguous"] * 3
    assert (nees(estimates, o)[again + 3 :] < 7.8).all()
    assert np.hypot(*(poses(estimates)[-1] - o[-1])[:2]) < 0.01
