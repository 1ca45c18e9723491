"""A curve around a pole, r(angle), and changes of r: periodic cubic B-splines of the angle.

The place on the curve is u, from 0 to K once around; a spline of K coefficients has a knot at each whole u.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.arrays import Array, Complex
from palpate.geometry.shapes import Polygon, Shape

KNOTS = 32
"""Coefficients of a spline around an outline: one for each 11 degrees of it."""
POINTS_PER_KNOT = 8
"""Points of a curve from knot to knot."""
POINTS = KNOTS * POINTS_PER_KNOT
"""Points of a curve."""
ANGLES = np.arange(POINTS) * (2.0 * math.pi / POINTS)
"""Angles of the points about the pole [rad]."""
WAYS = np.exp(1j * ANGLES)
"""Directions from the pole to the points."""
_LEAST = 0.004
"""[m] Least distance of a curve from its pole."""
_GRAZING = 0.2
"""Least part of a normal along the way from the pole that counts: less would make any height of no effect."""


@dataclass(frozen=True, eq=False)
class ClosedCurve:
    """A closed curve that every way from its pole meets once, counter-clockwise, in the object frame."""

    pole: complex
    """The pole [m]."""
    radii: Array
    """Distances (N,) [m] of the points from the pole."""

    @classmethod
    def around(cls, pole: complex, points: Complex) -> "ClosedCurve":
        """Return the curve that ways from a pole meet first on the closed line through points (M,) [m]."""
        return cls(pole, np.maximum(_met(pole, points), _LEAST))

    @classmethod
    def of(cls, shape: Shape) -> "ClosedCurve":
        """Return the curve of an outline about its centroid, or the nearest place inside it from which most is seen."""
        points = np.asarray(shape.outline(4 * POINTS) @ (1.0, 1j), np.complex128)
        return cls.around(best_pole(points, complex(*shape.centroid.tolist())), points)

    @cached_property
    def points(self) -> Complex:
        """Points (N,) [m]."""
        return np.asarray(self.pole + self.radii * WAYS, np.complex128)

    @cached_property
    def normals(self) -> Complex:
        """Outward unit normals at the points (N,)."""
        along = np.roll(self.points, -1) - np.roll(self.points, 1)
        return -1j * along / np.abs(along)

    @cached_property
    def outward(self) -> Array:
        """Parts (N,) of the normals along the ways from the pole: a change of r moves the outline by so much of it."""
        return np.maximum((self.normals.conjugate() * WAYS).real, _GRAZING)

    @cached_property
    def shape(self) -> Polygon:
        """The curve as an outline."""
        return Polygon(np.column_stack((self.points.real, self.points.imag)))

    def moved(self, coefficients: Array) -> "ClosedCurve":
        """Return the curve moved by the spline of coefficients (K,) [m]."""
        return ClosedCurve(self.pole, np.maximum(self.radii + BASIS_AT_POINTS @ coefficients, _LEAST))

    def about(self, pole: complex) -> tuple["ClosedCurve", Array]:
        """Return the same curve about another pole, and the matrix (K, K) that takes coefficients of small changes."""
        other = ClosedCurve.around(pole, self.points)
        from_pole = np.angle(other.points[::POINTS_PER_KNOT] - self.pole) % (2.0 * math.pi)
        place = from_pole * (POINTS / (2.0 * math.pi))
        share = np.interp(place, np.arange(POINTS + 1), np.append(self.outward, self.outward[0]))
        share /= other.outward[::POINTS_PER_KNOT]
        return other, TO_COEFFICIENTS @ (share[:, None] * basis(place / POINTS_PER_KNOT))

    def evenly(self) -> Array:
        """Return places (N,) among the points, 0 to N, that are evenly spaced along the curve."""
        closed = np.append(self.points, self.points[0])
        lengths = np.append(0.0, np.cumsum(np.abs(np.diff(closed))))
        return np.interp(np.arange(POINTS) * (lengths[-1] / POINTS), lengths, np.arange(POINTS + 1.0))


def basis(u: Array) -> Array:
    """Return the weights (M, K) of all coefficients at places u (M,)."""
    first = np.floor(u).astype(int)
    f = u - first
    rest = 1.0 - f
    weights = (rest**3 / 6.0, (4.0 - 6.0 * f**2 + 3.0 * f**3) / 6.0, (1.0 + 3.0 * f + 3.0 * f**2 - 3.0 * f**3) / 6.0)
    rows = np.zeros((len(u), KNOTS))
    for k, weight in enumerate((*weights, f**3 / 6.0)):
        rows[np.arange(len(u)), (first + k - 1) % KNOTS] += weight
    return rows


BASIS_AT_POINTS = basis(np.arange(POINTS) / POINTS_PER_KNOT)
"""Weights (N, K) of the coefficients at the points of a curve."""
TO_COEFFICIENTS = np.linalg.inv(basis(np.arange(KNOTS, dtype=float)))
"""Matrix (K, K) from values at the knots to coefficients."""


def circle(radius: float, center: complex, pole: complex) -> ClosedCurve:
    """Return a circle [m] about a pole inside it."""
    return ClosedCurve.around(pole, np.asarray(center + radius * WAYS, np.complex128))


def best_pole(points: Complex, center: complex) -> complex:
    """Return the place near the middle of a closed line (M,) from which its outside is met least at a grazing angle."""
    reach = float(np.abs(points - center).mean())
    steps = np.linspace(-0.6, 0.6, 9)
    tried = [
        center + reach * complex(x, y)
        for x in steps
        for y in steps
        if _is_inside(center + reach * complex(x, y), points)
    ]
    return max(tried, key=lambda pole: _seen(pole, points) - 0.1 * abs(pole - center) / reach, default=center)


def _seen(pole: complex, points: Complex) -> float:
    """Return the mean part of the normals of a line along the ways from a pole, weighted by length."""
    along = np.roll(points, -1) - points
    arm = points + 0.5 * along - pole
    part = (np.conj(-1j * along) * arm).real / np.maximum(np.abs(arm), 1e-9)
    return float(np.minimum(part, 0.5 * np.abs(along)).sum() / np.abs(along).sum())


def _is_inside(point: complex, points: Complex) -> bool:
    turns = np.angle((np.roll(points, -1) - point) / (points - point)).sum() / (2.0 * math.pi)
    return abs(turns) > 0.5


def _met(pole: complex, points: Complex) -> Array:
    """Return the distances (N,) at which ways from a pole first meet a closed line (M,) from outside."""
    start = (points - pole)[None] / WAYS[:, None]
    end = np.roll(start, -1, axis=1)
    crosses = (start.imag <= 0.0) & (end.imag > 0.0)
    share = start.imag / np.where(crosses, start.imag - end.imag, 1.0)
    at = np.where(crosses, start.real + share * (end.real - start.real), -np.inf)
    return at.max(axis=1)
