"""The geometry of a simple polygon given by its corners (N, 2) [m], counter-clockwise."""

import re

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.checks import FARTHEST, is_near
from palpate.errors import SettingError, ShapeError

Array = NDArray[np.float64]

_SHARP = np.radians(30.0)  # turn of the outline from which on a vertex counts as a corner


def checked_vertices(vertices: ArrayLike) -> tuple[tuple[float, float], ...]:
    """Return vertices (N, 2) [m] counter-clockwise, without repeats; raise ShapeError if that cannot be."""
    import shapely

    try:
        corners = np.asarray(vertices, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"polygon vertices are no numbers: {error}") from error
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise ShapeError(f"polygon vertices have shape {corners.shape}; they must be (N, 2)")
    check_near(corners, "polygon vertex")
    extent = float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0
    # Drops repeats, the closing one too, and corners between which no edge has a direction.
    corners = corners[(np.abs(corners - np.roll(corners, -1, axis=0)) > 1e-12 * extent).any(axis=1)]
    if len(corners) < 3:
        raise ShapeError(f"polygon has {len(corners)} different vertices in a row; it needs 3 or more")
    if shapely.MultiPoint(corners).convex_hull.area <= 1e-12 * extent**2:
        raise ShapeError("polygon has no area: its vertices lie on one line")
    polygon = shapely.Polygon(corners)
    if not polygon.is_valid:
        place = re.search(r"\[(\S+) (\S+)\]", reason := shapely.is_valid_reason(polygon))
        at = f"near ({float(place[1]):.6g}, {float(place[2]):.6g})" if place else f"({reason})"
        raise ShapeError(f"polygon outline crosses or touches itself {at}; it must not")
    if not polygon.exterior.is_ccw:
        corners = np.roll(corners[::-1], 1, axis=0)  # the first stays first
    return tuple((x, y) for x, y in corners.tolist())


def check_near(points: Array, what: str) -> None:
    """Raise ShapeError unless points (N, 2) [m] are finite and no farther than a length can be."""
    near = is_near(points).all(axis=1)
    if not near.all():
        row = int(np.argmin(near))
        found = tuple(points[row].tolist())
        raise ShapeError(f"{what} {row} is {found}; it must be finite, up to {FARTHEST:g} m")


def area_and_centroid(corners: Array) -> tuple[float, Array]:
    """Return the area [m^2] and its centroid (2,) [m]."""
    start = corners[0]  # near the polygon, so that a far origin costs no digits
    a = corners - start
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return 0.5 * float(cross.sum()), start + cross @ (a + b) / (3.0 * cross.sum())


def checked_count(count: int) -> int:
    """Return the number of outline points; raise SettingError on fewer than 3."""
    if count < 3:
        raise SettingError(f"an outline has {count} points; it needs 3 or more")
    return count


def points_along(corners: Array, count: int) -> Array:
    """Return about `count` points (N, 2) [m] along the outline: corners and evenly spaced ones between."""
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    parts = np.maximum(np.rint(checked_count(count) * lengths / lengths.sum()).astype(int), 1)
    edge = np.repeat(np.arange(len(corners)), parts)
    fraction = np.concatenate([np.arange(n) / n for n in parts])
    return corners[edge] + fraction[:, None] * edges[edge]


def mean_distances(corners: Array) -> dict[str, float]:
    """Return the mean distance from the centroid over the area, along the edges and over the corners [m].

    Along an edge at distance h from the centroid the distance is sqrt(h^2 + s^2), whose integral is closed;
    the integral of distance over the triangle of edge and centroid is h / 3 times that, with h < 0 where the
    edge faces the centroid, so that the triangles add up for concave outlines too.
    """
    area, centroid = area_and_centroid(corners)
    a = corners - centroid
    b = np.roll(a, -1, axis=0)
    edges = b - a
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    along = edges / lengths[:, None]
    h = a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0]

    def integral(end: Array) -> Array:
        s = (end * along).sum(axis=1)
        return 0.5 * (s * np.hypot(s, h) + h**2 * np.arcsinh(s / np.maximum(np.abs(h), 1e-250)))

    over_edges = integral(b) - integral(a)
    return {
        "uniform": float((h * over_edges).sum() / (3.0 * area)),
        "rim": float(over_edges.sum() / lengths.sum()),
        "corner": float(np.hypot(a[:, 0], a[:, 1]).mean()),
    }


def sharp_corners(corners: Array) -> NDArray[np.intp]:
    """Return the indices of the corners that stick out and at which the outline turns by more than 30 degrees."""
    edges = np.roll(corners, -1, axis=0) - corners
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    turn = (angles - np.roll(angles, 1) + np.pi) % (2.0 * np.pi) - np.pi
    return np.flatnonzero(turn > _SHARP)
