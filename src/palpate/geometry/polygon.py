"""Geometry of a simple polygon given by its corners (N, 2) [m], counter-clockwise."""

import re

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.checks import FARTHEST, is_near
from palpate.errors import ShapeError

Array = NDArray[np.float64]


def checked_vertices(vertices: ArrayLike) -> tuple[tuple[float, float], ...]:
    """Return vertices (N, 2) [m] counter-clockwise, without repeats; raise ShapeError if that cannot be."""
    import shapely

    try:
        corners = np.asarray(vertices, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"polygon vertices are no numbers: {error}") from error
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise ShapeError(f"polygon vertices have shape {corners.shape}; they must be (N, 2)")
    if len(far := np.flatnonzero(~is_near(corners).all(axis=1))):
        found = tuple(corners[far[0]].tolist())
        raise ShapeError(f"polygon vertex {far[0]} is {found}; it must be finite, up to {FARTHEST:g} m")
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


def area_and_centroid(corners: Array) -> tuple[float, Array]:
    """Return the area [m^2] and its centroid (2,) [m]."""
    start = corners[0]  # near the polygon, so that a far origin costs no digits
    a = corners - start
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return 0.5 * float(cross.sum()), start + cross @ (a + b) / (3.0 * cross.sum())


def points_along(corners: Array, count: int) -> Array:
    """Return about `count` points (M, 2) [m] on the outline: corners and evenly spaced ones."""
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    parts = np.maximum(np.rint(count * lengths / lengths.sum()).astype(int), 1)
    edge = np.repeat(np.arange(len(corners)), parts)
    fraction = (np.arange(len(edge)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[edge]
    return corners[edge] + fraction[:, None] * edges[edge]


def mean_distance(corners: Array) -> float:
    """Return the mean distance from the centroid over the area [m].

    Over the triangle of an edge and the centroid the integral of the distance is h / 3 times that along the edge, where
    it is sqrt(h^2 + s^2) at a distance h from the centroid. h < 0 where the edge faces the centroid, so that the
    triangles add up for concave outlines too.
    """
    area, centroid = area_and_centroid(corners)
    a = corners - centroid
    b = np.roll(a, -1, axis=0)
    edges = b - a
    along = edges / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    h = a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0]

    def integral(end: Array) -> Array:
        s = (end * along).sum(axis=1)
        return 0.5 * (s * np.hypot(s, h) + h**2 * np.arcsinh(s / np.maximum(np.abs(h), 1e-250)))

    return float((h * (integral(b) - integral(a))).sum() / (3.0 * area))


def signed_distance(corners: Array, points: Array) -> Array:
    """Return the exact distances (M,) [m] of points (M, 2) from the outline, negative inside."""
    start_x, start_y = corners.T
    edge_x, edge_y = (np.roll(corners, -1, axis=0) - corners).T
    square_length = edge_x**2 + edge_y**2
    normal = np.column_stack((edge_y, -edge_x)) / np.sqrt(square_length)[:, None]
    at_start = normal + np.roll(normal, 1, axis=0)
    normals = np.stack((at_start, normal, np.roll(at_start, -1, axis=0)), axis=1)  # (N, 3, 2): of start, edge and end
    found = []
    for x, y in (part.T[:, :, None] for part in np.array_split(points, 1 + len(points) * len(corners) // 2**16)):
        # In parts whose arrays stay in the processor's cache: the nearest place on all edges.
        along = ((x - start_x) * edge_x + (y - start_y) * edge_y) / square_length
        along = np.minimum(np.maximum(along, 0.0), 1.0)
        off_x, off_y = x - start_x - along * edge_x, y - start_y - along * edge_y
        square = off_x**2 + off_y**2
        edge = square.argmin(axis=1)
        best = np.arange(len(x)), edge
        outward = normals[edge, (along[best] > 0.0).astype(int) + (along[best] == 1.0)]
        is_inside = off_x[best] * outward[:, 0] + off_y[best] * outward[:, 1] < 0.0
        found.append(np.where(is_inside, -1.0, 1.0) * np.sqrt(square[best]))
    return np.concatenate(found)
