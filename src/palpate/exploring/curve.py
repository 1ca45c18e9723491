"""The outline as a curve: that of the centre of a round tip that touches it, by the logarithm of its radius.

A tip that goes around an object draws a curve that is smoother than the outline, as corners become arcs; its normals
are those of the outline. The radius is seen from a pole inside. Its logarithm is that of a base curve, a sketch's or
the unit circle, and a sum of harmonics, so that the distance and the direction of a contact are nearly linear in the
coefficients.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Complex
from palpate.geometry.shapes import Shape


@dataclass(frozen=True)
class _Settings:
    """Settings of the curve."""

    harmonics: int = 24
    """Number of harmonics: the 24th has waves of 2 cm on a curve of 16 cm."""
    roughness: float = 0.9
    """Standard deviation of a coefficient times the square of its order: twice that of random polygons, ellipses and
    stars, as forms with arms have more."""
    off_center: float = 0.03
    """Standard deviation of the first harmonic, which a pole near the centroid leaves small."""
    detail: float = 4.0
    """Order up to which the harmonics of a sketch's error are about alike: what is off is off over an eighth of it."""
    base_points: int = 360
    """Number of points of a base curve."""


_SETTINGS = _Settings()
_ORDERS: Array = np.arange(1, _SETTINGS.harmonics + 1).astype(np.float64)
COEFFICIENTS = 1 + 2 * len(_ORDERS)
"""Number of coefficients of a curve: mean, cosines, sines."""


class Waves(NamedTuple):
    """Rows that take coefficients to the logarithm of the radius at B angles and to its derivatives by the angle."""

    value: Array
    """(B, COEFFICIENTS)."""
    slope: Array
    """(B, COEFFICIENTS) [1/rad]."""
    bend: Array
    """(B, COEFFICIENTS) [1/rad^2]."""


def waves(angle: Array) -> Waves:
    """Return the rows at angles (B,) [rad] about the pole."""
    cosine = np.cos(angle[:, None] * _ORDERS)
    sine = np.sin(angle[:, None] * _ORDERS)
    one = np.ones((len(angle), 1))
    value = np.hstack((one, cosine, sine))
    slope = np.hstack((0.0 * one, -_ORDERS * sine, _ORDERS * cosine))
    bend = np.hstack((0.0 * one, -(_ORDERS**2) * cosine, -(_ORDERS**2) * sine))
    return Waves(value, slope, bend)


def form_deviations() -> Array:
    """Return standard deviations (COEFFICIENTS - 1,) of an unknown form's harmonics."""
    of_order = _SETTINGS.roughness / _ORDERS**2
    of_order[0] = _SETTINGS.off_center
    return np.tile(of_order, 2)


def deviations_about(sigma: float) -> Array:
    """Return standard deviations (COEFFICIENTS,) by which the radius has a relative deviation sigma at every angle."""
    of_order = 1.0 / (1.0 + np.square(_ORDERS / _SETTINGS.detail))
    share = np.concatenate(((math.sqrt(0.5),), np.tile(of_order, 2)))  # of mean, cosines and sines
    of_any_angle = 0.5 + np.square(of_order).sum()
    return sigma * share / math.sqrt(of_any_angle)


class Course(NamedTuple):
    """The logarithm of the radius of curves at angles, with its derivatives by the angle."""

    logarithm: Array
    """Logarithm of the radius in metres."""
    slope: Array
    """[1/rad]."""
    bend: Array
    """[1/rad^2]."""


@dataclass(frozen=True, eq=False)
class BaseCurve:
    """A curve about the pole that others deviate from, drawn by points as exactly as a sketch is."""

    table: Array
    """(3, N): the course at even angles from 0 on."""

    def at(self, angle: Array) -> Course:
        """Return its course at angles (B,) [rad]."""
        count = self.table.shape[1]
        place = np.mod(angle, 2.0 * np.pi) * (count / (2.0 * np.pi))
        before = np.floor(place).astype(np.int64)
        share = place - before
        logarithm, slope, bend = (1.0 - share) * self.table[:, before % count] + share * self.table[
            :, (before + 1) % count
        ]
        return Course(logarithm, slope, bend)


UNIT_CIRCLE = BaseCurve(np.zeros((3, 1)))
"""The base of unknown forms, the logarithm of whose radius is 0."""


def base_about(shape: Shape, pole: complex, reach: float) -> BaseCurve:
    """Return the curve at a distance reach [m] outside of an outline, as it is first met on the way to the pole."""
    count = _SETTINGS.base_points
    step = 2.0 * np.pi / count
    way = np.exp(1j * step * np.arange(count))
    inside = np.zeros(count)
    outside = np.full(count, 2.0 * shape.extent + reach)
    for _ in range(40):  # bisection, to the last digit
        middle = 0.5 * (inside + outside)
        points = pole + middle * way
        is_inside = shape.signed_distance(np.column_stack((points.real, points.imag))) < reach
        inside = np.where(is_inside, middle, inside)
        outside = np.where(is_inside, outside, middle)
    here = np.log(inside)
    after = np.roll(here, -1)
    before = np.roll(here, 1)
    slope = (after - before) / (2.0 * step)
    bend = (after - 2.0 * here + before) / step**2
    return BaseCurve(np.stack((here, slope, bend)))


def outline_radii(
    base: BaseCurve, coefficients: Array, covariance: Array, pole: Complex, reach: float, angle: Array
) -> tuple[Array, Array]:
    """Return radius and deviation across (B, N) [m] of the outlines in B curves, at angles (N,) about the origin.

    The curves are about a base; `coefficients` are (B, COEFFICIENTS), `covariance` theirs, `pole` (B,) is complex [m]
    in the object frame, and `reach` is the distance of the curve from the outline.
    """
    rows = waves(angle)
    drawn = base.at(angle)
    logarithm = drawn.logarithm + coefficients @ rows.value.T
    slope = drawn.slope + coefficients @ rows.slope.T
    variance = ((rows.value @ covariance) * rows.value).sum(axis=2)
    radius = np.exp(logarithm)
    outward = np.exp(1j * (angle - np.arctan(slope)))
    points = pole[:, None] + radius * np.exp(1j * angle) - reach * outward
    across = radius * np.sqrt(variance) / np.sqrt(1.0 + slope**2)
    radii = np.empty(radius.shape)
    deviations = np.empty(radius.shape)
    for row in range(len(radius)):
        seen = np.unwrap(np.angle(points[row]))
        twice = np.append(seen, seen + 2.0 * np.pi)
        # Where a curve goes back, seen from the origin, the nearest of its ways there and back counts.
        is_ahead = twice >= np.maximum.accumulate(twice)
        is_behind = twice <= np.minimum.accumulate(twice[::-1])[::-1]
        radii[row] = np.inf
        for is_kept in (is_ahead[len(seen) :], is_behind[: len(seen)]):
            distance = np.interp(angle, seen[is_kept], np.abs(points[row][is_kept]), period=2.0 * np.pi)
            deviation = np.interp(angle, seen[is_kept], across[row][is_kept], period=2.0 * np.pi)
            deviations[row] = np.where(distance < radii[row], deviation, deviations[row])
            radii[row] = np.minimum(distance, radii[row])
    return radii, deviations
