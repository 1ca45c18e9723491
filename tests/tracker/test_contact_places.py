"""The first frame of a contact of an object that is roughly known: the places where it may be touched are answers."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import planar
import pytest
from tracker_samples import settings

from palpate import POINT, ContactDirection, Disc, Estimate, Frame, Rectangle, Shape, Tracker

SQUARE, HALF = Rectangle(0.1, 0.1), 0.05
Answer = Any  # one of `Estimate.answers`
DIRECTION = ContactDirection(0.0, math.radians(1.0) ** 2)
"""The outline's normal lies along the push."""


def touched(first: Any, sigma: Any, at: Any, shape: Shape = SQUARE, measurements: Any = (DIRECTION,)) -> Estimate:
    """Return the estimate at a first frame, which touches the object with a point."""
    tracker = Tracker(shape, POINT, first, settings("none"), first_pose_sigma=sigma)
    return tracker.update(Frame(0.0, np.array(at, float), contact=True, measurements=measurements))


def likely(found: Estimate) -> list[Answer]:
    """Return all answers but those at a corner, which take much turning."""
    return [answer for answer in found.answers if answer.weight > 0.02]


def places(answers: Sequence[Answer]) -> np.ndarray:
    """Return the contact point in the object frame of each answer."""
    return np.array([planar.between(answer.pose, [-HALF, 0.0, 0.0])[:2] for answer in answers])


def test_a_side_is_met_at_places_as_likely_as_the_first_pose_says():
    sigma, spread = 0.02, 0.01  # [m] of the first pose along the side, and that of each place
    found = touched((0.0, 0.0, 0.0), (sigma, sigma, 0.3), (-HALF, 0.0, 0.0))
    answers = likely(found)
    x, y = places(answers).T
    # The direction tells the side and the yaw; the place along it is open.
    assert found.status == "ambiguous" and len(answers) > 4
    np.testing.assert_allclose(x, -HALF, atol=1e-4)
    assert max(abs(answer.pose[2]) for answer in answers) < math.radians(1.0)
    assert y.min() < -0.025 and y.max() > 0.025
    # A place at y0 has the weight of its distance in both Gaussians together, and the pose of their product.
    expected = np.exp(-0.5 * np.square(y * math.hypot(sigma, spread) / sigma**2))
    weights = np.array([answer.weight for answer in answers])
    np.testing.assert_allclose(weights / weights.sum(), expected / expected.sum(), atol=0.01)
    assert sum(answer.weight for answer in found.answers) == pytest.approx(1.0)


def test_sides_beside_a_corner_are_equally_likely():
    # It is thought to be met at its corner: it has turned by 45 degrees one way or the other.
    yaw = 0.25 * math.pi
    found = likely(touched((HALF * math.sqrt(2.0) - HALF, 0.0, yaw), (0.02, 0.02, 0.4), (-HALF, 0.0, 0.0)))
    turned = np.array([answer.pose[2] - yaw for answer in found])
    np.testing.assert_allclose(np.abs(turned), yaw, atol=0.03)
    np.testing.assert_allclose(SQUARE.signed_distance(places(found)), 0.0, atol=1e-3)
    weights = np.array([answer.weight for answer in found])
    assert weights[turned > 0.0].sum() == pytest.approx(weights[turned < 0.0].sum(), rel=0.1) and weights.sum() > 0.95


def test_a_first_pose_that_is_well_known_has_one_place():
    found = touched((0.0, 0.0, 0.0), (2e-3, 2e-3, 0.03), (-HALF, 0.01, 0.0))
    assert len(found.answers) == 1 and found.status == "tracking"


def test_a_direction_that_contradicts_the_pose_finds_the_next_side():
    # The point meets the top, 3 mm from a corner; the pose, 5 mm off, says that it meets the left side.
    found = touched((-0.004, HALF, 0.5 * math.pi), (4e-3, 4e-3, 0.03), (-HALF, 0.0, 0.0))
    np.testing.assert_allclose(places(found.answers[:1])[0], [-HALF + 0.003, HALF], atol=3e-3)


def test_without_a_direction_each_yaw_that_may_be_is_a_place():
    found = touched((0.0, 0.0, 0.0), (0.02, 0.02, 0.5), (-HALF, 0.0, 0.0), measurements=())
    yaws = np.array([answer.pose[2] for answer in found.answers])
    assert yaws.min() < -0.4 and yaws.max() > 0.4
    np.testing.assert_allclose(SQUARE.signed_distance(places(found.answers)), 0.0, atol=3e-3)


def test_a_disc_is_met_at_one_place_whatever_its_yaw():
    found = touched((0.004, 0.0, 0.0), (0.02, 0.02, 0.8), (-HALF, 0.0, 0.0), Disc(HALF))
    assert {round(float(np.hypot(*place)), 2) for place in places(found.answers)} == {HALF}
    assert all(abs(answer.pose[2]) < 0.1 and answer.covariance[2, 2] > 0.5 for answer in found.answers)
