"""Belief about an outline before it is touched: its curve, and a Gaussian of the heights across it and of friction.

Where friction with the table acts follows from the outline: if this is larger, so is the radius of friction, and the
centre of friction is near its centroid. The joint covariance says so.
"""

import math
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array
from palpate.geometry.closed_curve import (
    ANGLES,
    BASIS_AT_POINTS,
    KNOTS,
    POINTS_PER_KNOT,
    TO_COEFFICIENTS,
    ClosedCurve,
    circle,
)
from palpate.models.pushing.outline_variable import OUTLINE, OUTLINE_MODEL
from palpate.models.pushing.priors import ObjectPrior
from palpate.models.pushing.variables import FRICTION_CENTER, FRICTION_RATIO
from palpate.types.outline import Sketch, Unknown

OUTLINE_PLACE = OUTLINE_MODEL.in_object[OUTLINE]
"""Places of the outline's coefficients among the object's variables."""
CENTER_PLACE = OUTLINE_MODEL.in_object[FRICTION_CENTER]
"""Places of the centre of friction."""
RATIO_PLACE = OUTLINE_MODEL.in_object[FRICTION_RATIO].start
"""Place of the logarithm of the ratio of friction."""
_SHIFT = 0.3
"""Standard deviation of an object's middle from where it was guessed, as a share of its radius."""
_FORM = 0.22
"""Standard deviation of an outline from a circle, as a share of its radius: an ellipse of 3 to 2, a square."""
_BEND = 0.55
"""[rad] Angle around the object over which an outline keeps its distance from a circle."""
_SHARP = 0.015
"""Standard deviation of an outline from point to point, as a share of its radius: corners."""
_SKETCH_BEND = 0.45
"""[rad] Angle around the object over which the error of a sketch stays the same."""


@dataclass(frozen=True, eq=False)
class OutlinePrior:
    """Belief about an outline before it is touched."""

    curve: ClosedCurve
    """The likeliest outline, about the origin of the object frame."""
    covariance: Array
    """Covariance (K, K) of the heights' coefficients [m^2]."""


def outline_prior(given: Unknown | Sketch) -> OutlinePrior:
    """Return the belief about an outline of which the size or a sketch is known.

    The pole of an outline of unknown size is the origin, half the least width from the place that is touched first,
    which lies in direction -x. The likeliest outline is a circle of a mean size about a point ahead of it.
    """
    if isinstance(given, Sketch):
        curve = ClosedCurve.of(given.shape)
        angle = ANGLES[::POINTS_PER_KNOT]
        apart = angle[:, None] - angle
        heights = given.sigma**2 * (0.95 * _along(apart, _SKETCH_BEND) + 0.05 * np.eye(KNOTS))
    else:
        least, largest = given.size
        radius = 0.25 * (least + largest)
        center = complex(radius - first_reach(given), 0.0)
        curve = circle(radius, center, 0.0j)
        angle = np.angle(curve.points[::POINTS_PER_KNOT] - center)
        apart = angle[:, None] - angle
        size = ((largest - least) / 6.0) ** 2
        form = _FORM**2 * _along(apart, _BEND) + _SHARP**2 * np.eye(KNOTS)
        heights = size + radius**2 * (_SHIFT**2 * np.cos(apart) + form)
    by_height = TO_COEFFICIENTS / curve.outward[::POINTS_PER_KNOT]
    return OutlinePrior(curve, by_height @ heights @ by_height.T)


def first_reach(given: Unknown) -> float:
    """Return the distance [m] of an unknown outline's pole from the place that is touched first."""
    return 0.7 * given.size[0]


def _along(apart: Array, length: float) -> Array:
    """Return the correlation of heights so far apart around the object [rad]."""
    return np.exp(-2.0 * np.square(np.sin(0.5 * apart) / length))


def with_outline(covariance: Array, prior: OutlinePrior, friction_radius: float) -> Array:
    """Return a joint covariance (3 + V, 3 + V) of pose and variables with that of the outline, and friction by it."""
    first = 3
    at = slice(first + OUTLINE_PLACE.start, first + OUTLINE_PLACE.stop)
    points = prior.curve.points
    area = prior.curve.shape.area
    lengths = 0.5 * np.abs(np.roll(points, -1) - np.roll(points, 1))
    weights = BASIS_AT_POINTS * (prior.curve.outward * lengths / area)[:, None]
    center = complex(*prior.curve.shape.centroid.tolist())
    by_heights = np.zeros((len(covariance), KNOTS))
    arm = (points - center) / friction_radius
    by_heights[first + CENTER_PLACE.start] = arm.real @ weights
    by_heights[first + CENTER_PLACE.start + 1] = arm.imag @ weights
    by_heights[first + RATIO_PLACE] = weights.sum(axis=0)
    by_heights[at] = np.eye(KNOTS)
    joint = covariance.copy()
    joint[at, :] = 0.0
    joint[:, at] = 0.0
    return joint + by_heights @ prior.covariance @ by_heights.T


def deviation_at_points(covariance: Array, curve: ClosedCurve) -> Array:
    """Return the standard deviations (N,) [m] across a curve at its points, from the joint covariance (3 + V, 3 + V)."""
    at = slice(3 + OUTLINE_PLACE.start, 3 + OUTLINE_PLACE.stop)
    heights = np.einsum("ni,ij,nj->n", BASIS_AT_POINTS, covariance[at, at], BASIS_AT_POINTS)
    return curve.outward * np.sqrt(np.maximum(heights, 0.0))
