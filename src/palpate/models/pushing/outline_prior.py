"""Belief about an outline before it is touched, a curve and a Gaussian of heights, and of friction by an outline."""

import math
from dataclasses import dataclass, replace

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
from palpate.models.pushing.belief import Belief
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


@dataclass(frozen=True)
class _Forms:
    """Spread of the forms that objects have."""

    size: float = 0.3
    """Standard deviation of an object's radius, as a share of it and of the logarithm of largest over least width."""
    shift: float = 0.3
    """Standard deviation of an object's middle from where it was guessed, as a share of its radius."""
    form: float = 0.22
    """Standard deviation of an outline from a circle, as a share of its radius: an ellipse of 3 to 2, a square."""
    bend: float = 0.55
    """[rad] Angle around the object over which an outline keeps its distance from a circle."""
    sharp: float = 0.015
    """Standard deviation of an outline from point to point, as a share of its radius: corners."""
    sketch_bend: float = 0.45
    """[rad] Angle around the object over which the error of a sketch stays the same."""


_FORMS = _Forms()


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
        heights = given.sigma**2 * (0.95 * _along(apart, _FORMS.sketch_bend) + 0.05 * np.eye(KNOTS))
    else:
        least, largest = given.size
        radius = 0.5 * math.sqrt(least * largest)
        center = complex(radius - first_reach(given), 0.0)
        curve = circle(radius, center, 0.0j)
        angle = np.angle(curve.points[::POINTS_PER_KNOT] - center)
        apart = angle[:, None] - angle
        size = (_FORMS.size * radius * math.log(largest / least)) ** 2
        form = _FORMS.form**2 * _along(apart, _FORMS.bend) + _FORMS.sharp**2 * np.eye(KNOTS)
        heights = size + radius**2 * (_FORMS.shift**2 * np.cos(apart) + form)
    by_height = TO_COEFFICIENTS / curve.outward[::POINTS_PER_KNOT]
    return OutlinePrior(curve, by_height @ heights @ by_height.T)


def first_reach(given: Unknown) -> float:
    """Return the distance [m] of an unknown outline's pole from the place that is touched first."""
    return 0.7 * given.size[0]


def _along(apart: Array, length: float) -> Array:
    """Return the correlation of heights so far apart around the object [rad]."""
    return np.exp(-2.0 * np.square(np.sin(0.5 * apart) / length))


def with_friction(belief: Belief, curve: ClosedCurve, prior: ObjectPrior) -> Belief:
    """Return a belief (B,) in which friction with the table is what the outline says: all that a contact begins with.

    The centre of friction is at the centroid and the radius of friction is that of the curve, as well as the outline
    and its prior let know. What a contact taught of friction is left out, and so is that it tells of the outline: where
    neither is known, each would make the other too sure.
    """
    area = curve.shape.area
    center = complex(*curve.shape.centroid.tolist())
    lengths = 0.5 * np.abs(np.roll(curve.points, -1) - np.roll(curve.points, 1))
    weights = BASIS_AT_POINTS * (curve.outward * lengths / area)[:, None]
    arm = (curve.points - center) / curve.shape.friction_radius()
    by_heights = np.stack((weights.sum(axis=0), arm.real @ weights, arm.imag @ weights))
    places = np.array([RATIO_PLACE, CENTER_PLACE.start, CENTER_PLACE.start + 1])
    at = slice(3 + OUTLINE_PLACE.start, 3 + OUTLINE_PLACE.stop)
    covariance = belief.covariance.copy()
    by_outline = by_heights @ covariance[:, at, at] @ by_heights.T
    covariance[:, 3 + places, :] = 0.0
    covariance[:, :, 3 + places] = 0.0
    rows = np.ix_(np.arange(len(covariance)), 3 + places, 3 + places)
    covariance[rows] = by_outline + np.diag(np.square(prior.deviation[places]))
    values = belief.values.copy()
    values[:, places] = prior.mean[places]
    return replace(belief, values=values, covariance=covariance)


def deviation_at_points(covariance: Array, curve: ClosedCurve) -> Array:
    """Return the standard deviations (N,) [m] across a curve at its points, by a joint covariance (3 + V, 3 + V)."""
    at = slice(3 + OUTLINE_PLACE.start, 3 + OUTLINE_PLACE.stop)
    heights = np.einsum("ni,ij,nj->n", BASIS_AT_POINTS, covariance[at, at], BASIS_AT_POINTS)
    return curve.outward * np.sqrt(np.maximum(heights, 0.0))
