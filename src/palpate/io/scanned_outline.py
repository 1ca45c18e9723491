"""The outline that noisy points of a scan lie along."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.checks import is_near
from palpate.errors import ShapeError
from palpate.geometry.polygon import check_near
from palpate.geometry.shapes import Polygon

Array = NDArray[np.float64]

POINTS = 50
"""Fewer are the corners of an outline rather than a scan."""
LEAST_NOISE = 2e-5
"""[m]"""
SIGMAS = 4.0
"""Standard deviations of the noise by which a point may be off a side of the outline."""


class ScannedShape(NamedTuple):
    """The outline along the points of a scan."""

    shape: Polygon
    noise: float
    """Standard deviation of the points from the outline [m]."""


def is_scan(points: Array) -> bool:
    """Return true if points (N, 2) [m] are many and noisy, so that they are no corners of an outline."""
    if len(points) < POINTS or not is_near(points).all():
        return False
    return LEAST_NOISE < _noise(_in_order(points)) < 0.01 * float(np.ptp(points, axis=0).max())


def shape_of_scan(points: ArrayLike) -> ScannedShape:
    """Return the simplest outline along noisy points (N, 2) [m] in the object frame, and their noise.

    Points follow one another round the object; or they are in any order, if all of the outline can be seen from its
    middle. Sides are fitted to the points along them. Raises ShapeError where the points are no outline.
    """
    import shapely

    given = np.asarray(points, np.float64)
    if given.ndim != 2 or given.shape[1] != 2 or len(given) < POINTS:
        raise ShapeError(f"a scan is {POINTS} or more points (N, 2), found shape {given.shape}")
    check_near(given, "a scan's point")
    ring = _in_order(given)
    ring = np.roll(ring, -int(np.argmax(np.linalg.norm(ring - ring.mean(axis=0), axis=1))), axis=0)
    noise = max(_noise(ring), LEAST_NOISE)
    closed = np.vstack([ring, ring[:1]])
    rough = shapely.get_coordinates(shapely.LineString(closed).simplify(SIGMAS * noise, preserve_topology=False))
    ends = [int(np.flatnonzero((ring == corner).all(axis=1))[0]) for corner in rough[:-1]]
    shape = Polygon(_corners(closed, _merged(closed, [*ends, len(ring)], noise), SIGMAS * noise))
    return ScannedShape(shape, float(np.sqrt(np.mean(shape.signed_distance(ring) ** 2))))


def _in_order(points: Array) -> Array:
    """Return the points as they are, or sorted by their angle about the middle if that makes the shorter way round."""
    off = points - points.mean(axis=0)
    turned = points[np.argsort(np.arctan2(off[:, 1], off[:, 0]))]

    def length(ring: Array) -> float:
        return float(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum())

    return points if length(points) <= length(turned) else turned


def _noise(ring: Array) -> float:
    """Return the standard deviation of points (N, 2) in order, across the outline.

    By fourth differences over a sixtieth of the way, in which straight sides and even curves cancel; their median, so
    that corners do not count. Their coefficients 1/4, -1, 3/2, -1, 1/4 make white noise 2.09 times as large.
    """
    apart = max(1, len(ring) // 60)
    before, after = np.roll(ring, apart, axis=0), np.roll(ring, -apart, axis=0)
    along = after - before
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    off = ring - 0.5 * (before + after)
    across = (off[:, 1] * along[:, 0] - off[:, 0] * along[:, 1]) / length
    fourth = across - 0.5 * (np.roll(across, apart) + np.roll(across, -apart))
    return float(1.4826 * np.median(np.abs(fourth)) / 2.09)


def _side(points: Array) -> tuple[Array, Array, Array]:
    """Return the straight line closest to points (n, 2): a point on it, its direction, and their distances (n,)."""
    middle = points.mean(axis=0)
    along = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    return middle, along, np.abs((points - middle) @ (-along[1], along[0]))


def _merged(closed: Array, ends: list[int], noise: float) -> list[int]:
    """Return the ends of sides along a closed ring of points; two sides that are one within the noise become one."""

    def looseness(first: int, last: int) -> float:
        off = _side(closed[first : last + 1])[2]
        return max(float(np.sqrt(np.mean(off**2))) / 1.2, float(off.max()) / SIGMAS) / noise

    while len(ends) > 4:
        joined = [looseness(first, last) for first, last in zip(ends[:-2], ends[2:], strict=True)]
        best = int(np.argmin(joined))
        if joined[best] > 1.0:
            break
        del ends[best + 1]
    return ends


def _corners(closed: Array, ends: list[int], farthest: float) -> Array:
    """Return the corners (K, 2) where the sides that end at these points of a closed ring meet."""
    sides = [_side(closed[first : last + 1]) for first, last in pairwise(ends)]
    corners = closed[ends[:-1]].copy()
    for index, corner in enumerate(corners):
        (a, u, _), (b, v, _) = sides[index - 1], sides[index]
        sine = float(u[0] * v[1] - u[1] * v[0])
        if abs(sine) > np.sin(np.radians(10.0)):
            between = b - a
            meeting = a + u * float(between[0] * v[1] - between[1] * v[0]) / sine
        else:
            meeting = 0.5 * (a + u * float((corner - a) @ u) + b + v * float((corner - b) @ v))
        if np.linalg.norm(meeting - corner) < 2.0 * farthest:
            corners[index] = meeting
    return corners
