"""Outlines of objects: disc, rectangle, ellipse and polygon, in the object frame, in metres.

All have the same methods: `outline`, `signed_distance`, `area`, `centroid` and `friction_radius`.
"""

import math
import reprlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import Array
from palpate.checks import FARTHEST, METRES, are_in_range, checked_number, other_unit
from palpate.errors import SettingError, ShapeError
from palpate.geometry.se2 import wrap


class _Outline(ABC):
    """Base of all shapes; all but polygons are made of sizes and lie about the origin."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            length = checked_number(value, 1e-6, FARTHEST)
            if length is None:
                kind = type(self).__name__.lower()
                raise ShapeError(
                    f"{kind} {name} is {reprlib.repr(value)}; it must be a length from 1e-06 to {FARTHEST:g} m"
                )
            object.__setattr__(self, name, length)

    @property
    def centroid(self) -> Array:
        """Centroid of the area (2,) [m]."""
        return np.zeros(2)

    @property
    def extent(self) -> float:
        """The larger of the outline's widths along x and y [m]."""
        return float(np.ptp(self.outline(), axis=0).max())

    @abstractmethod
    def outline(self, count: int = 200) -> Array:
        """Return about `count` points (N, 2) [m] on the outline, counter-clockwise."""


class _Cornered(_Outline):
    """Base of rectangle and polygon."""

    @property
    @abstractmethod
    def corners(self) -> Array:
        """Corners (N, 2) [m], counter-clockwise."""

    @property
    def area(self) -> float:
        """Area [m^2]."""
        return _area_and_centroid(self.corners)[0]

    def outline(self, count: int = 200) -> Array:
        """Return about `count` points (N, 2) [m], counter-clockwise: the corners and points between them."""
        corners = self.corners
        edges = np.roll(corners, -1, axis=0) - corners
        lengths = np.hypot(edges[:, 0], edges[:, 1])
        parts = np.maximum(np.rint(count * lengths / lengths.sum()).astype(int), 1)
        edge = np.repeat(np.arange(len(corners)), parts)
        fraction = (np.arange(len(edge)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[edge]
        return corners[edge] + fraction[:, None] * edges[edge]

    def friction_radius(self) -> float:
        """Return c [m], the ratio of largest friction torque to largest friction force on the support.

        For an even pressure c is the mean distance from the centroid over the area. The area consists of a triangle
        from the centroid to each edge. Over a triangle the integral of the distance is h / 3 times its integral along
        the edge, where h is the distance of the centroid from the line of the edge, and the distance of a point at s
        along that line is sqrt(h^2 + s^2). h < 0 where the centroid lies outside of the edge, so that the triangles add
        up for concave outlines, too.
        """
        area, centroid = _area_and_centroid(self.corners)
        start = self.corners - centroid
        end = np.roll(start, -1, axis=0)
        edges = end - start
        direction = edges / np.hypot(edges[:, 0], edges[:, 1])[:, None]
        h = start[:, 0] * direction[:, 1] - start[:, 1] * direction[:, 0]

        def integral(point: Array) -> Array:
            """Return the integral of sqrt(h^2 + s^2) from s = 0 to a point of each edge (N, 2)."""
            s = (point * direction).sum(axis=1)
            return 0.5 * (s * np.hypot(s, h) + h**2 * np.arcsinh(s / np.maximum(np.abs(h), 1e-250)))

        return float((h * (integral(end) - integral(start))).sum() / (3.0 * area))


@dataclass(frozen=True)
class Disc(_Outline):
    """A disc about the origin."""

    radius: float
    """Radius [m]."""

    @property
    def area(self) -> float:
        """Area [m^2]."""
        return math.pi * self.radius**2

    def outline(self, count: int = 200) -> Array:
        """Return `count` points (count, 2) [m], counter-clockwise, equally spaced."""
        angle = np.arange(count) * (2.0 * math.pi / count)
        return self.radius * np.stack((np.cos(angle), np.sin(angle)), axis=-1)

    def signed_distance(self, points: ArrayLike) -> Array:
        """Return the distance (...) [m] of points (..., 2) from the outline, negative inside."""
        points = np.asarray(points, dtype=np.float64)
        return np.hypot(points[..., 0], points[..., 1]) - self.radius

    def friction_radius(self) -> float:
        """Return c [m], the ratio of largest friction torque to largest friction force; see `Rectangle`."""
        return 2.0 / 3.0 * self.radius


@dataclass(frozen=True)
class Rectangle(_Cornered):
    """A rectangle about the origin, its sides along the axes."""

    size_x: float
    """Full length along x [m]."""
    size_y: float
    """Full length along y [m]."""

    @property
    def corners(self) -> Array:
        """Corners (4, 2) [m], counter-clockwise."""
        return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (0.5 * self.size_x, 0.5 * self.size_y)

    def signed_distance(self, points: ArrayLike) -> Array:
        """Return the distance (...) [m] of points (..., 2) from the outline, negative inside."""
        points = np.asarray(points, dtype=np.float64)
        beyond_x = np.abs(points[..., 0]) - 0.5 * self.size_x
        beyond_y = np.abs(points[..., 1]) - 0.5 * self.size_y
        outside = np.hypot(np.maximum(beyond_x, 0.0), np.maximum(beyond_y, 0.0))
        return outside + np.minimum(np.maximum(beyond_x, beyond_y), 0.0)


@dataclass(frozen=True)
class Ellipse(_Outline):
    """An ellipse about the origin, its axes along x and y."""

    size_x: float
    """Full axis along x [m]."""
    size_y: float
    """Full axis along y [m]."""

    @property
    def area(self) -> float:
        """Area [m^2]."""
        return 0.25 * math.pi * self.size_x * self.size_y

    def outline(self, count: int = 200) -> Array:
        """Return `count` points (count, 2) [m] on the ellipse, counter-clockwise, evenly spaced along it."""
        a = 0.5 * self.size_x
        b = 0.5 * self.size_y
        angle = np.linspace(0.0, 2.0 * math.pi, 64 * count + 1)
        speed = np.hypot(a * np.sin(angle), b * np.cos(angle))  # of the point (a cos, b sin)
        arc = np.append(0.0, np.cumsum(speed[:-2:2] + 4.0 * speed[1::2] + speed[2::2]))  # by Simpson's rule
        angle = np.interp(np.arange(count) * (arc[-1] / count), arc, angle[::2])
        return np.stack((a * np.cos(angle), b * np.sin(angle)), axis=-1)

    def signed_distance(self, points: ArrayLike) -> Array:
        """Return the distance (...) [m] of points (..., 2) from the outline, negative inside.

        Follows D. Eberly, "Distance from a point to an ellipse, an ellipsoid, or a hyperellipsoid", with
        Newton steps: the function is convex and the start lies left of its root, so they cannot overshoot.
        """
        points = np.abs(np.asarray(points, dtype=np.float64))
        long_axis = 0 if self.size_x >= self.size_y else 1
        long = 0.5 * max(self.size_x, self.size_y)
        short = 0.5 * min(self.size_x, self.size_y)
        p = points[..., long_axis] / short
        # A point on the long axis may have two nearest points; a shift far below rounding picks one.
        q = np.maximum(points[..., 1 - long_axis] / short, 1e-20)
        r = (long / short) ** 2
        # The nearest point is (r p / (u + r - 1), q / u); u is 1 on the outline and smaller inside.
        scaled = p * long / short
        u = np.array(np.maximum(q, scaled - (r - 1.0)))
        moving = np.ones_like(u, np.bool_)
        for _ in range(100):
            before = u[moving]
            s = scaled[moving] / (before + (r - 1.0))
            t = q[moving] / before
            step = 0.5 * (s * s + t * t - 1.0) / (s * s / (before + (r - 1.0)) + t * t / before)
            u[moving] = before + step
            moving[moving] = step > 1e-15 * before
            if not moving.any():
                break
        return short * (u - 1.0) * np.hypot(p / (u + (r - 1.0)), q / u)

    def friction_radius(self) -> float:
        """Return c [m], the ratio of largest friction torque to largest friction force; see `Rectangle`."""
        angle = np.arange(0.0, 2.0 * math.pi, 0.001 * math.pi)
        speed = np.hypot(self.size_x * np.sin(angle), self.size_y * np.cos(angle))
        return float(speed.mean()) / 3.0  # the ellipse stretched to the unit disc makes it the perimeter over 3 pi


@dataclass(frozen=True, init=False)
class Polygon(_Cornered):
    """A simple polygon, convex or not, at any place in the object frame."""

    vertices: tuple[tuple[float, float], ...]
    """Corners (x, y) [m], counter-clockwise, the first not repeated at the end."""

    def __init__(self, vertices: ArrayLike) -> None:
        """Take corners (N, 2) [m] in either order, closed or not; raise ShapeError if they are no outline."""
        object.__setattr__(self, "vertices", _checked_vertices(vertices))

    @cached_property
    def corners(self) -> Array:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Corners (N, 2) [m], counter-clockwise."""
        return np.array(self.vertices)

    @property
    def centroid(self) -> Array:
        """Centroid of the area (2,) [m]."""
        return _area_and_centroid(self.corners)[1]

    def signed_distance(self, points: ArrayLike) -> Array:
        """Return the distance (...) [m] of points (..., 2) from the outline, negative inside."""
        import shapely

        from palpate.geometry.polygon_distance import distances

        points = np.asarray(points, dtype=np.float64)
        distance = distances(points.reshape(-1, 2), self.corners).reshape(points.shape[:-1])
        return np.where(shapely.contains_xy(self._area, points[..., 0], points[..., 1]), -distance, distance)

    @cached_property
    def _area(self) -> Any:
        import shapely

        area = shapely.Polygon(self.corners)
        shapely.prepare(area)
        return area


def _checked_vertices(vertices: ArrayLike) -> tuple[tuple[float, float], ...]:
    """Return vertices (N, 2) [m] counter-clockwise, without repeats; raise ShapeError if that cannot be."""
    import shapely

    try:
        corners = np.asarray(vertices, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"polygon vertices are no numbers: {error}") from error
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise ShapeError(f"polygon vertices have shape {corners.shape}; they must be (N, 2)")
    is_in_range = are_in_range(corners).all(axis=1)
    if not is_in_range.all():
        index = int(np.argmin(is_in_range))
        vertex = tuple(corners[index].tolist())
        raise ShapeError(f"polygon vertex {index} is {vertex}; it must be finite, up to {FARTHEST:g} m")
    extent = float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0
    # Repeated corners are dropped, a closing one too, and those so close that their edge has no direction.
    edges = np.abs(corners - np.roll(corners, -1, axis=0))
    corners = corners[(edges > 1e-12 * extent).any(axis=1)]
    if len(corners) < 3:
        raise ShapeError(f"polygon has {len(corners)} different vertices in a row; it needs 3 or more")
    if shapely.MultiPoint(corners).convex_hull.area <= 1e-12 * extent**2:
        raise ShapeError("polygon has no area: its vertices lie on one line")
    polygon = shapely.Polygon(corners)
    if not polygon.is_valid:
        raise ShapeError(f"polygon outline crosses or touches itself; it must not: {shapely.is_valid_reason(polygon)}")
    outline = shapely.get_coordinates(shapely.orient_polygons(polygon))[:-1]
    return tuple((x, y) for x, y in outline.tolist())


def _area_and_centroid(corners: Array) -> tuple[float, Array]:
    """Return the area [m^2] and its centroid (2,) [m]."""
    start = corners[0]  # near the polygon, so that a far origin costs no digits
    a = corners - start
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return 0.5 * float(cross.sum()), start + cross @ (a + b) / (3.0 * cross.sum())


Shape = Disc | Rectangle | Ellipse | Polygon
_SHAPES: dict[str, type[Shape]] = {kind.__name__.lower(): kind for kind in (Disc, Rectangle, Ellipse, Polygon)}


def shape_to_dict(shape: Shape) -> dict[str, Any]:
    """Return the shape as plain data for JSON, for example {"type": "disc", "radius": 0.088}."""
    return {"type": type(shape).__name__.lower(), **asdict(shape)}


def scaled(shape: Shape, scale: float) -> Shape:
    """Return the shape with every length times a scale; its origin stays where it is."""
    return replace(shape, **{name: np.multiply(value, scale).tolist() for name, value in asdict(shape).items()})


def shape_from_dict(data: Mapping[str, Any]) -> Shape:
    """Return the shape that `shape_to_dict` wrote; raise ShapeError on a wrong type or field."""
    values = dict(data) if isinstance(data, Mapping) else {}
    name = str(values.pop("type", None))
    kind = _SHAPES.get(name)
    if kind is None:
        raise ShapeError(f"shape is {reprlib.repr(data)}; it must be an object whose type is {', '.join(_SHAPES)}")
    needed = {field.name for field in fields(kind)}
    if values.keys() != needed:
        raise ShapeError(f"a {name} has the fields {sorted(needed)}, not {sorted(values)}")
    return kind(**values)


def wrong_width(shape: Shape, unit: str | None = None) -> str:
    """Return a sentence if an outline is too large or small to be pushed, with units that may be meant; else "".

    `unit` is the one in which the outline was read, by default metres.
    """
    width = shape.extent
    if 0.005 <= width <= 2.0:
        return ""
    question = other_unit(width / METRES[unit or "m"], 0.02, 1.0)
    return f"the outline is {width:g} m wide, allowed are 0.005 to 2 m{question}"


def check_outline(shape: object) -> None:
    """Raise SettingError unless a value is an outline, ShapeError if it is too large or small to be pushed."""
    if not isinstance(shape, Shape):
        raise SettingError(
            f"shape is {shape!r}; it must be an outline, which palpate.load_shape reads from a name or a file"
        )
    wrong = wrong_width(shape)
    if wrong:
        raise ShapeError(wrong)


def sharp_corners(corners: Array) -> NDArray[np.intp]:
    """Return the first and last vertex (K, 2) of corners that stick out, where the outline turns by over 30 degrees.

    Bends within 1 mm are one corner to a gel, such as those of a chamfer, or of a fillet drawn in short edges.
    """
    edges = np.roll(corners, -1, axis=0) - corners
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    perimeter = lengths.sum()
    arc_length = np.cumsum(lengths) - lengths  # from the first vertex to each
    bends = np.flatnonzero(np.abs(wrap(angles - np.roll(angles, 1))) > np.radians(1.0))
    to_next_bend = np.diff(arc_length[bends], append=arc_length[bends[:1]] + perimeter)
    is_last = to_next_bend > 1e-3
    first = bends[np.roll(is_last, 1)]
    last = bends[is_last]
    if len(last) and last[0] < first[0]:  # a corner that begins before the first vertex and ends after it
        last = np.roll(last, -1)
    is_short = (arc_length[last] - arc_length[first]) % perimeter < 1e-3  # otherwise it is a curve
    is_sharp = wrap(angles[last] - angles[first - 1]) > np.radians(30.0)
    return np.column_stack([first, last])[is_short & is_sharp]
