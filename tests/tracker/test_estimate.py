"""Contact point, sliding and touch age of an estimate, against values worked out by hand."""

import dataclasses
import math

import numpy as np
import pytest
from push_samples import SHAPES, frames, pushed, sensor
from tracker_samples import settings, track

from palpate import Estimate, Frame, Tracker

ANSWER = Tracker(SHAPES["disc"], sensor(), np.zeros(3)).update(Frame(0.0, np.ones(3), contact=False)).answers[0]
HALF = 0.2363 / 2  # [m] from the rectangle's centre to its left side


def estimate(**changes) -> Estimate:
    pose, covariance = np.array([1.0, 2.0, np.pi / 2]), np.diag([1.0, 4.0, 9.0])
    answer = dataclasses.replace(ANSWER, pose=pose, covariance=covariance)
    whole = Estimate(3.5, pose, covariance, True, "tracking", "", (answer,), (0.4, 0.1))
    return dataclasses.replace(whole, **changes)


def test_ros_has_the_covariance_about_the_axes_of_the_header():
    position, orientation, covariance = estimate().to_ros()
    assert position.tolist() == [1.0, 2.0, 0.0]
    np.testing.assert_allclose(orientation, [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])
    # The object's x axis lies along the world's y: a variance of 1 along the one is one of 1 along the other.
    np.testing.assert_allclose(covariance.reshape(6, 6), np.diag([4.0, 1.0, 0.0, 0.0, 0.0, 9.0]), atol=1e-12)
    correlated = np.array([[1.0, 0.5, 0.2], [0.5, 4.0, 0.3], [0.2, 0.3, 9.0]])
    six = estimate(covariance=correlated).to_ros().covariance.reshape(6, 6)
    # Turned by a quarter: x of the world is -y of the object, y of the world is x of the object.
    wanted = [[4.0, -0.5, -0.3], [-0.5, 1.0, 0.2], [-0.3, 0.2, 9.0]]
    np.testing.assert_allclose(six[np.ix_([0, 1, 5], [0, 1, 5])], wanted, atol=1e-12)
    assert np.count_nonzero(np.abs(six) > 1e-12) == 9


def test_estimates_are_equal_by_value():
    one = estimate(contact_point=np.array([0.1, 0.2]))
    assert one == estimate(contact_point=np.array([0.1, 0.2]))
    assert one != 3 and estimate(sliding=math.nan) == estimate(sliding=math.nan)
    other = dataclasses.replace(ANSWER, covariance=np.eye(3))
    for field in dataclasses.fields(Estimate):
        changed = {"status": "strained", "reason": "why", "answers": (other,), "friction": (0.4, 0.2)}
        value = changed.get(field.name, np.full(3, 7.0))
        assert estimate() != estimate(**{field.name: value}), field.name
    with pytest.raises(TypeError, match="unhashable"):
        hash(one)


@pytest.mark.parametrize("turn", [0.0, np.pi / 2])
def test_the_contact_is_where_the_tip_touches_the_side(turn):
    """A tip that touches the left side 10 mm above its middle, and the same seen from a turned world."""
    cos, sin = math.cos(turn), math.sin(turn)
    world = np.array([[cos, -sin], [sin, cos]])
    first = np.array([1.0, 2.0, turn])
    touching = np.array([*(first[:2] + world @ [-HALF, 0.01]), turn])
    tracker = Tracker(SHAPES["rectangle"], sensor(), first, settings("none"))
    resting = tracker.update(Frame(0.0, touching - [*(world @ [0.1, 0.0]), 0.0], contact=False))
    assert (resting.contact_point, resting.contact_normal, resting.touch_age) == (None, None, math.inf)
    found = tracker.update(Frame(0.1, touching, contact=True))
    assert found.contact_point is not None and found.contact_normal is not None
    np.testing.assert_allclose(found.contact_point, touching[:2], atol=3e-4)  # they are thought to overlap a little
    np.testing.assert_allclose(found.contact_normal, world @ [-1.0, 0.0], atol=0.01)
    assert np.hypot(*found.contact_normal) == pytest.approx(1.0)


def test_a_push_inside_the_cone_holds():
    o, e = pushed("rectangle", 30)
    _, found = track("rectangle", frames(o, e), o[0], settings("oracle"))
    assert math.isnan(found[0].sliding) and max(one.sliding for one in found[3:]) < 0.1


def test_a_push_along_the_side_slides():
    o, e = pushed("rectangle", 10)
    straight = [(x, 0.01, 0.05) for x in e[0, 0] + 1e-3 * np.arange(8)]
    aside = [(straight[-1][0] + 2e-4 * k, 0.01 + 1e-3 * k, 0.05) for k in range(1, 12)]
    seen = [Frame(k / 30, np.array(pose), contact=True) for k, pose in enumerate([*straight, *aside])]
    _, found = track("rectangle", seen, o[0], settings("none", hypotheses=1))
    assert found[-1].sliding > 0.4
