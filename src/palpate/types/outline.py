"""Outlines that are not known, or known as a sketch; and an outline as it was learnt by touch, with its band."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.arrays import Array, Flags
from palpate.checks import checked_number
from palpate.errors import SettingError
from palpate.geometry.shapes import Polygon, Shape, check_outline

SMALLEST = 0.02
"""[m] Least width of an object whose outline is unknown: that of a tip."""
LARGEST = 1.0
"""[m] Largest width of such an object."""
OUTLINE_ERRORS = ("outline_rms_mm", "outline_all_rms_mm", "outline_in_95")
"""Errors of a learnt outline in a summary, which need the true one."""
LACKS_DIRECTIONS = (
    "an unknown outline needs touch images or contact directions; contact flags alone do not tell its form"
)
"""Sentence on an outline that nothing tells of."""


@dataclass(frozen=True)
class Unknown:
    """An object whose outline nobody knows. Raises SettingError on sizes that are not allowed."""

    size: tuple[float, float] = (0.05, 0.2)
    """Least and largest width that the object may have [m]."""

    def __post_init__(self) -> None:
        given: Any = self.size
        is_pair = isinstance(given, tuple | list) and len(given) == 2
        checked = [checked_number(value, SMALLEST, LARGEST) for value in given] if is_pair else []
        numbers = [value for value in checked if value is not None]
        if len(numbers) != 2 or not numbers[0] < numbers[1]:
            allowed = f"two widths from {SMALLEST:g} to {LARGEST:g} m, the smaller first"
            raise SettingError(f"size of an unknown outline is {given!r}; allowed are {allowed}")
        object.__setattr__(self, "size", tuple(numbers))


@dataclass(frozen=True)
class Sketch:
    """An outline that is known roughly. Raises SettingError on a deviation that is not allowed."""

    shape: Shape
    """The sketch."""
    sigma: float = 0.005
    """Standard deviation of the true outline across the sketch [m]."""

    def __post_init__(self) -> None:
        check_outline(self.shape)
        widest = 0.25 * self.shape.extent
        sigma = checked_number(self.sigma, 2e-4, widest)
        if sigma is None:
            allowed = f"0.0002 m to a quarter of the sketch's width, {widest:.3g} m"
            raise SettingError(f"sigma of a sketch is {self.sigma!r}; allowed are {allowed}")
        object.__setattr__(self, "sigma", sigma)


@dataclass(frozen=True, eq=False)
class Outline:
    """An outline as it is known from touch, in the object frame."""

    points: Array
    """Points (N, 2) [m] around the outline, counter-clockwise, evenly spaced."""
    deviation: Array
    """Standard deviation of each point across the outline, (N,) [m]."""
    touched: Flags
    """True for points that were touched, (N,)."""

    @property
    def shape(self) -> Polygon:
        """The outline as that of a known object; raises ShapeError where it crosses itself."""
        return Polygon(self.points)

    @property
    def sigma(self) -> float:
        """Root mean square of the deviations [m]: that of the outline as a sketch."""
        return math.sqrt(float(np.mean(np.square(self.deviation))))
