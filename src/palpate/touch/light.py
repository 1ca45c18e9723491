"""How bright the light in an image is, relative to that of the untouched gel.

It is told by cells, the means over areas of an image, 30 across: they have less noise than pixels, so that a touch of
0.1 mm shows, and the gel spreads every touch over more than a cell of 0.6 mm.
"""

import numpy as np
from numpy.typing import NDArray

from palpate.graph.compiled import Records, compiled, compiled_to_sum
from palpate.touch.area import area_means

Levels = NDArray[np.float32]
Light = NDArray[np.float64]
"""(channels, 3): how bright the light is in the middle of an image, 1 as untouched, and by how much brighter at its
right and its lower border."""

_CELLS = 30  # over the shorter side
_SAMPLES = 3  # across a cell, where thin lines are left out
_NEIGHBOURS = 5  # samples across, the middle one of which is taken: a line of half a cell is less than half of them
_FLAT = 2.0  # [grey levels] of a cell off the light's plane, above which it hardly tells of the light
_FITS, _SETTLED = 8, 1e-3  # most reweighted fits of the light's plane, and the change of light that is none
_DIMMEST, _BRIGHTEST = 0.3, 3.0  # times the untouched gel's light


def cell_width(height: int, width: int) -> float:
    """Return how many pixels the cells of an image are across."""
    return max(min(height, width) / _CELLS, 1.0)


def cells_of(image: NDArray[np.uint8] | Levels) -> Levels:
    """Return the means over the cells of an image (height, width, 3): (rows, columns, 3)."""
    return area_means(image, *_cells(*image.shape[:2]))


def wide_cells_of(image: NDArray[np.uint8]) -> Levels:
    """Return the cells of an image (height, width, 3) without what is thinner than half a cell, as a scratch is.

    The gel spreads every touch over more. Images of few pixels stay as they are.
    """
    import cv2

    height, width = image.shape[:2]
    thinned = cell_width(height, width) / _SAMPLES
    if thinned < 1.0:
        return cells_of(image)
    samples = np.rint(area_means(image, round(height / thinned), round(width / thinned))).astype(np.uint8)
    return area_means(np.asarray(cv2.medianBlur(samples, _NEIGHBOURS), np.uint8), *_cells(height, width))


def _cells(height: int, width: int) -> tuple[int, int]:
    """Rows and columns of the cells of an image."""
    pixels = cell_width(height, width)
    return round(height / pixels), round(width / pixels)


def light_of(cells: Levels, untouched: Levels) -> Light:
    """Return the light in an image's cells (rows, columns, 3), relative to that in the untouched gel's.

    It is a plane over the image for each channel, fitted robustly: a touch of less than half of the pad does not sway
    it.
    """
    return _planes(cells, untouched)


def lit(untouched: Levels, light: Light) -> Levels:
    """Return the untouched gel's levels (height, width, 3), of any size, in another light."""
    out = np.empty(untouched.shape, np.float32)
    _put_lit(untouched, light, out)
    return out


def share_unlike(cells: Levels, untouched: Levels, tolerance: Levels | np.float32) -> float:
    """Return the share of values that are off the untouched gel's, in the image's light, by more than a tolerance."""
    return share_off(cells, untouched, light_of(cells, untouched), tolerance)


def share_off(cells: Levels, untouched: Levels, light: Light, tolerance: Levels | np.float32) -> float:
    """Return the same in a light that is known."""
    return float((np.abs(cells - lit(untouched, light)) > tolerance).mean())


@compiled
def _put_lit(untouched: Records, light: Light, out: Levels) -> None:
    rows, columns, channels = untouched.shape
    for row in range(rows):
        down = 2.0 * (row + 0.5) / rows - 1.0
        for column in range(columns):
            right = 2.0 * (column + 0.5) / columns - 1.0
            for channel in range(channels):
                part = light[channel, 0] + light[channel, 1] * right + light[channel, 2] * down
                part = np.float32(min(max(part, _DIMMEST), _BRIGHTEST))
                out[row, column, channel] = part * untouched[row, column, channel]


@compiled_to_sum
def _planes(cells: Records, untouched: Records) -> Records:
    """See light_of. By reweighted least squares: what is off the plane by more than _FLAT counts for little."""
    rows, columns, channels = cells.shape
    planes = np.zeros((channels, 3))
    for channel in range(channels):
        seen, known = np.ascontiguousarray(cells[:, :, channel]), np.ascontiguousarray(untouched[:, :, channel])
        middle, right, down = np.median(seen / np.maximum(known, np.float32(1.0))), 0.0, 0.0
        for _ in range(_FITS):
            square, pull = np.eye(3), np.zeros(3)  # with ones, so that a black channel has a fit
            for row in range(rows):
                y = 2.0 * (row + 0.5) / rows - 1.0
                at, total, along, along_twice, off_total, off_along = middle + down * y, 0.0, 0.0, 0.0, 0.0, 0.0
                for column in range(columns):
                    x = 2.0 * (column + 0.5) / columns - 1.0
                    level = np.float64(known[row, column])
                    off = seen[row, column] - (at + right * x) * level
                    part = level / (1.0 + (off / _FLAT) ** 2)
                    weight, part = part * level, part * off
                    total += weight
                    along += weight * x
                    along_twice += weight * x * x
                    off_total += part
                    off_along += part * x
                square[0, 0] += total
                square[0, 1] += along
                square[0, 2] += total * y
                square[1, 1] += along_twice
                square[1, 2] += along * y
                square[2, 2] += total * y * y
                pull[0] += off_total
                pull[1] += off_along
                pull[2] += off_total * y
            _solve(square, pull)
            middle, right, down = middle + pull[0], right + pull[1], down + pull[2]
            if max(abs(pull[0]), abs(pull[1]), abs(pull[2])) < _SETTLED:
                break
        planes[channel, 0], planes[channel, 1], planes[channel, 2] = middle, right, down
    return planes


@compiled
def _solve(square: Records, pull: Records) -> None:
    """Put what solves a positive definite system, of whose matrix the upper half counts, in the place of `pull`.

    By elimination: NumPy's solver would take five seconds to compile.
    """
    size = len(pull)
    for i in range(size):
        for j in range(i + 1, size):
            share = square[i, j] / square[i, i]
            for k in range(j, size):
                square[j, k] -= share * square[i, k]
            pull[j] -= share * pull[i]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            pull[i] -= square[i, j] * pull[j]
        pull[i] /= square[i, i]
