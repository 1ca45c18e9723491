"""Marks on a gel's skin, as its camera sees them: grains of dust and dents, and scratches."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

GRAIN_RADIUS = (1.2, 3.0)
"""Of a grain or dent, from and to [px], as on seventeen real DIGITs."""
GRAIN_LEVELS = (-25.0, 60.0)
"""What it adds to each colour, from and to [grey levels]."""
_SCRATCH_WIDTH = (2.0, 4.0)  # [px]: no finer than the coating of 0.15 mm, and as wide as that of the bench of faults
_SCRATCH_LENGTH = (0.1, 0.5)  # of the image's width
_SCRATCH_LEVELS = (20.0, 60.0)  # [grey levels], darker or brighter; 60 is the bench of faults'


@dataclass(frozen=True)
class Mark:
    """One mark, and when it comes."""

    when: float
    """Share of the recording that is over when it comes, 0 to 1; then it stays."""
    place: tuple[float, float]
    """Where its middle is, in shares of the image's height and width from its upper left, 0 to 1."""
    width: float
    """Standard deviation of a grain, width of a scratch [px]."""
    length: float
    """Length of a scratch, in shares of the image's width; 0 of a grain."""
    angle: float
    """How a scratch's normal lies in the image, from its right downwards [rad]."""
    levels: tuple[float, float, float]
    """What it adds to red, green and blue [grey levels]."""

    def on(self, size: tuple[int, int]) -> NDArray[np.float64]:
        """Return what the mark adds to an image of so many rows and columns, (rows, columns, 3) [grey levels]."""
        at = (self.place[0] * size[0], self.place[1] * size[1])
        form = scratch(size, at, self.angle, self.width, self.length * size[1]) if self.length else None
        form = grain(size, at, self.width) if form is None else form
        return form[..., None] * np.array(self.levels)


def draw_mark(rng: np.random.Generator) -> Mark:
    """Draw a mark: a scratch as often as a grain."""
    when, row, column, angle = rng.uniform((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, math.pi)).tolist()
    if rng.random() < 0.5:
        red, green, blue = rng.uniform(*GRAIN_LEVELS, 3).tolist()
        return Mark(when, (row, column), rng.uniform(*GRAIN_RADIUS), 0.0, angle, (red, green, blue))
    level = float(rng.choice([-1.0, 1.0]) * rng.uniform(*_SCRATCH_LEVELS))
    width, length = rng.uniform(*_SCRATCH_WIDTH), rng.uniform(*_SCRATCH_LENGTH)
    return Mark(when, (row, column), width, length, angle, (level, level, level))


def grain(size: tuple[int, int], at: tuple[float, float], radius: float) -> NDArray[np.float64]:
    """Return the form of a grain, 0 to 1, in an image of so many rows and columns, at this row and column."""
    rows, columns = np.ogrid[: size[0], : size[1]]
    return np.exp(-0.5 * ((rows - at[0]) ** 2 + (columns - at[1]) ** 2) / radius**2)


def scratch(
    size: tuple[int, int], at: tuple[float, float], angle: float, width: float, length: float = math.inf
) -> NDArray[np.float64]:
    """Return the form of a scratch, 0 or 1, whose middle is at this row and column and whose normal has this angle."""
    down, right = np.ogrid[: size[0], : size[1]]
    down, right = down - at[0], right - at[1]
    across = np.cos(angle) * right + np.sin(angle) * down
    along = np.cos(angle) * down - np.sin(angle) * right
    return ((np.abs(across) < 0.5 * width) & (np.abs(along) < 0.5 * length)).astype(np.float64)
