"""Outlines that are not known, or known as a sketch; and an outline as it was learnt by touch, with its band."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.arrays import Array, Flags
from palpate.checks import checked_number
from palpate.errors import SettingError
from palpate.geometry.shapes import Polygon, Shape, check_outline


@dataclass(frozen=True)
class _Limits:
    """Limits of what may be stated of an outline that is not known."""

    smallest: float = 0.02
    """[m] Least width of an object: that of a tip."""
    largest: float = 1.0
    """[m] Largest width of an object."""
    least_sigma: float = 2e-4
    """[m] Least deviation of a sketch; one that is better is an outline that is known."""
    largest_sigma: float = 0.25
    """Largest deviation of a sketch, as a share of its width."""
    widest_gap: float = 0.3
    """Longest part of an outline, as a share of it, that may be a guess between contacts from all sides."""
    hidden: float = 0.1
    """[rad] Largest angle by which a sketch's outline may go back, seen from its origin."""


_LIMITS = _Limits()


@dataclass(frozen=True)
class Unknown:
    """An object whose outline nobody knows. Raises SettingError on sizes that are not allowed."""

    size: tuple[float, float] = (0.05, 0.2)
    """Least and largest width that the object may have [m]."""

    def __post_init__(self) -> None:
        given: Any = self.size
        is_pair = isinstance(given, tuple | list) and len(given) == 2
        least = _LIMITS.smallest
        most = _LIMITS.largest
        checked = [checked_number(value, least, most) for value in given] if is_pair else []
        numbers = [value for value in checked if value is not None]
        if len(numbers) != 2 or not numbers[0] < numbers[1]:
            allowed = f"two widths from {least:g} to {most:g} m, the smaller first"
            raise SettingError(f"size of an unknown outline is {given!r} m; allowed are {allowed}")
        object.__setattr__(self, "size", tuple(numbers))

    @property
    def mean_width(self) -> float:
        """Mean of the least and the largest width [m]."""
        return 0.5 * sum(self.size)


@dataclass(frozen=True)
class Sketch:
    """An outline that is known roughly. Raises SettingError or ShapeError on values that are not allowed.

    Seen from the origin of the object frame, which lies inside of it, no part of the sketch hides another.
    """

    shape: Shape
    """The sketch."""
    sigma: float = 0.005
    """Standard deviation of the true outline across the sketch [m]."""

    def __post_init__(self) -> None:
        check_outline(self.shape)
        least = _LIMITS.least_sigma
        most = _LIMITS.largest_sigma * self.shape.extent
        sigma = checked_number(self.sigma, least, most)
        if sigma is None:
            allowed = f"{least:g} m to a quarter of its width, {most:.3g} m"
            raise SettingError(
                f"sigma of a sketch that is {self.shape.extent:.3g} m wide is {self.sigma!r}; allowed are {allowed}"
            )
        object.__setattr__(self, "sigma", sigma)
        if not self.shape.signed_distance(np.zeros(2)) < 0.0:
            raise SettingError(
                "the origin of the sketch lies outside of its outline; allowed is one inside (an SVG is put about its "
                "centroid, a CSV or JSON keeps its numbers)"
            )
        points = self.shape.outline(720)
        angle = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
        back = np.maximum.accumulate(angle) - angle
        if back.max() > _LIMITS.hidden:
            at = np.degrees(angle[int(np.argmax(back))]) % 360.0
            raise SettingError(
                f"seen from the sketch's origin, a part of its outline hides another at {at:.0f} degrees; allowed is "
                "one that every way from the origin meets once"
            )

    @property
    def pole(self) -> Array:
        """Point inside (2,) [m] about which its curve is drawn: the centroid or, where that is outside, the origin."""
        centroid = np.asarray(self.shape.centroid)
        return centroid if self.shape.signed_distance(centroid) < 0.0 else np.zeros(2)


@dataclass(frozen=True, eq=False)
class Outline:
    """An outline as it is known from touch, in the object frame."""

    points: Array
    """Points (N, 2) [m] on the outline, counter-clockwise, evenly spaced in angle about its origin from 0 on."""
    deviation: Array
    """Standard deviation of each point across the outline, (N,) [m]."""
    touched: Flags
    """True for points that were touched, (N,)."""
    origin: Array = field(default_factory=lambda: np.zeros(2))
    """Point inside (2,) [m] about which the points are: the object frame's origin, unless ground truth moved that."""

    @property
    def shape(self) -> Polygon:
        """The outline as that of a known object; raises ShapeError where it crosses itself."""
        return Polygon(self.points)

    @property
    def sigma(self) -> float:
        """Root mean square of the deviations [m]: that of the outline as a sketch."""
        return math.sqrt(float(np.mean(np.square(self.deviation))))

    @property
    def widest_gap(self) -> float:
        """Longest way from one touched point to the next, as a share of the outline."""
        places = np.flatnonzero(self.touched)
        if not len(places):
            return 1.0
        gaps = np.diff(np.append(places, places[0] + len(self.touched)))
        return float(gaps.max()) / len(self.touched)

    @property
    def guessed_share(self) -> float:
        """The widest gap, if it is too wide for a guess; else 0."""
        return self.widest_gap if self.widest_gap > _LIMITS.widest_gap else 0.0

    @property
    def normals(self) -> Array:
        """Outward normals (N, 2) at the points."""
        along = np.roll(self.points, -1, axis=0) - np.roll(self.points, 1, axis=0)
        return np.column_stack((along[:, 1], -along[:, 0])) / np.hypot(along[:, 0], along[:, 1])[:, None]

    def signed_distance(self, points: Array) -> Array:
        """Return the distance (P,) [m] of points (P, 2) from the outline, negative inside."""
        start = self.points
        side = np.roll(start, -1, axis=0) - start
        from_start = points[:, None] - start
        along = np.clip((from_start * side).sum(axis=2) / np.square(side).sum(axis=1), 0.0, 1.0)
        distance = np.hypot(*np.moveaxis(from_start - along[..., None] * side, 2, 0)).min(axis=1)
        angle = self._angles(points) - self._angles(start[:1])
        width = 2.0 * math.pi / len(start)
        first = np.floor(angle / width).astype(int) % len(start)  # of the side that the ray through a point meets
        x, y = np.moveaxis(points - start[first], 1, 0)
        is_inside = side[first, 0] * y - side[first, 1] * x > 0.0
        return np.where(is_inside, -distance, distance)

    def edges(self) -> tuple[Array, Array]:
        """Return the inner and the outer edge of the 95 % band, (N, 2) [m] each; they do not cross the origin."""
        from_origin = self.points - self.origin
        radius = np.hypot(from_origin[:, 0], from_origin[:, 1])
        outward = from_origin / radius[:, None]
        slant = np.maximum((outward * self.normals).sum(axis=1), 0.3)  # of the outline to the ray
        # As of the neighbour that is least slanted: a kink of a few points would make the band a spike.
        slant = np.max([np.roll(slant, shift) for shift in range(-2, 3)], axis=0)
        reach = 1.96 * self.deviation / slant
        inner = np.maximum(radius - reach, 0.0)
        return self.origin + inner[:, None] * outward, self.origin + (radius + reach)[:, None] * outward

    def _angles(self, points: Array) -> Array:
        """Return angles (P,) [rad] of points (P, 2) about the origin."""
        x, y = (points - self.origin).T
        return np.arctan2(y, x)
