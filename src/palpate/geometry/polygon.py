"""Geometry of a simple polygon given by its corners (N, 2) [m], counter-clockwise."""

import re

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.checks import FARTHEST, is_near
from palpate.errors import ShapeError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


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


def points_along(corners: Array, count: int) -> tuple[Array, Indices]:
    """Return about `count` points (M, 2) [m] on the outline, corners and evenly spaced ones, and their edges (M,)."""
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    parts = np.maximum(np.rint(count * lengths / lengths.sum()).astype(int), 1)
    edge = np.repeat(np.arange(len(corners)), parts)
    fraction = (np.arange(len(edge)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[edge]
    return corners[edge] + fraction[:, None] * edges[edge], edge


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


class PolygonDistance:
    """Exact signed distance from a polygon's outline, negative inside.

    Only edges near a point are looked at. A tree of samples along the outline finds them: with a largest interval h
    between samples, an edge at a distance d has a sample within sqrt(d^2 + h^2 / 4).
    """

    def __init__(self, corners: Array) -> None:
        edges = np.roll(corners, -1, axis=0) - corners
        self._start_x, self._start_y = np.ascontiguousarray(corners.T)
        self._edge_x, self._edge_y = np.ascontiguousarray(edges.T)
        self._length_squared = self._edge_x**2 + self._edge_y**2
        normal = np.column_stack((self._edge_y, -self._edge_x)) / np.sqrt(self._length_squared)[:, None]
        at_start = normal + np.roll(normal, 1, axis=0)
        self._normals = np.stack((at_start, normal, np.roll(at_start, -1, axis=0)), axis=1)
        """Outward normals at the start of each edge, along it and at its end (N, 3, 2)."""
        self._tree, self._samples, self._slack = None, 0, 0.0
        if len(corners) <= 24:  # all edges are looked at sooner
            return
        from scipy.spatial import KDTree

        samples, edge = points_along(corners, max(len(corners), 1000))
        interval = np.roll(samples, -1, axis=0) - samples
        self._slack = 0.25 * float((interval**2).sum(axis=1).max())
        self._edges_at, self._samples = np.column_stack((edge, np.roll(edge, 1))), len(samples)
        # Built thus it finds the nearest of 10 000 samples on a circle four times faster than a balanced tree.
        self._tree = KDTree(samples, leafsize=32, compact_nodes=False, balanced_tree=False)

    def __call__(self, points: Array) -> Array:
        """Return the distances (M,) [m] of points (M, 2)."""
        found = np.empty(len(points))
        count, unsure = 2 if self._tree else len(self._edge_x), np.arange(len(points))
        while len(unsure):
            size = len(unsure) * min(count, len(self._edge_x))
            parts = np.array_split(unsure, 1 + size // 2**16)  # whose arrays stay in the processor's cache
            unsure = np.concatenate([part[self._look(points[part], count, found, part)] for part in parts])
            count *= 2
        return found

    def _look(self, points: Array, count: int, found: Array, part: Indices) -> NDArray[np.bool_]:
        """Write the distances from the edges near points to `found`, and flag those near which there may be others."""
        if self._tree is None or count >= self._samples:
            edges, reach = np.arange(len(self._edge_x))[None], np.full(len(points), np.inf)
        else:
            distance, nearest = self._tree.query(points, count, workers=2)
            edges, reach = self._edges_at[np.asarray(nearest)[:, :-1]].reshape(len(points), -1), distance[:, -1] ** 2
        from_start_x, from_start_y = points[:, :1] - self._start_x[edges], points[:, 1:] - self._start_y[edges]
        edge_x, edge_y = self._edge_x[edges], self._edge_y[edges]
        along = (from_start_x * edge_x + from_start_y * edge_y) / self._length_squared[edges]
        along = np.minimum(np.maximum(along, 0.0), 1.0)
        off_x, off_y = from_start_x - along * edge_x, from_start_y - along * edge_y
        square = off_x**2 + off_y**2
        best = np.arange(len(points)), square.argmin(axis=1)
        edge, along, square = np.broadcast_to(edges, square.shape)[best], along[best], square[best]
        normal = self._normals[edge, (along > 0.0).astype(int) + (along == 1.0)]
        is_inside = off_x[best] * normal[:, 0] + off_y[best] * normal[:, 1] < 0.0
        found[part] = np.where(is_inside, -1.0, 1.0) * np.sqrt(square)
        return reach <= (square + self._slack) * (1.0 + 1e-9)
