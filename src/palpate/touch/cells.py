"""Images: their cells, and the light in them relative to the untouched gel's.

A cell is the mean over an area of an image, 30 across its shorter side. Cells have less noise than pixels, so a touch
of 0.1 mm shows, and the gel spreads every touch over more than a cell of 0.6 mm.
"""

import math
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Image, Levels, Records
from palpate.compiled import compiled
from palpate.config import CONTACT_DETECTION

Pixels = TypeVar("Pixels", bound=NDArray[Any])
Light = NDArray[np.float64]
"""(channels, 3): relative brightness in the middle of an image, and its change to the right and to the lower border."""

ACROSS = 30
"""Cells over the shorter side of an image."""
NEIGHBOURS = 5
"""Thirds of cells across a square in which what fills less than half, as a scratch, is thinner than a touch."""
LARGEST_LIGHT_CHANGE = 3.0
"""Factor by which the light may change either way while the gel still shows."""
MOST_LIGHT_FITS = 8
"""Most fits of the light in one channel of an image."""
SETTLED_LIGHT = 1e-3
"""Change of the light, relative to the untouched gel's, that ends the fits: a quarter of a grey level."""
_OUTLIER = 0.5 * CONTACT_DETECTION.significant * CONTACT_DETECTION.least_deviation
"""[grey levels] off the light's plane from which a cell hardly counts: half of what is significant."""


def is_dark(image: Image | Levels) -> bool:
    """Return true if light or camera are not on yet: a mean below 5 grey levels."""
    return float(image.mean()) < 5.0


def is_flat(image: Image | Levels) -> bool:
    """Return true if an image, or its cells, have one level within 4, as black and saturated ones have."""
    return float(np.ptp(image)) < 4.0


def is_grey(image: Image | Levels) -> bool:
    """Return true if all channels of an image (height, width, 3) are equal, also in a black one."""
    if image.ndim != 3:
        return False
    sparse = sparse_pixels(image)
    red, green, blue = (sparse[..., channel] for channel in range(3))
    return bool((red == green).all() and (green == blue).all())


def sparse_pixels(image: Pixels) -> Pixels:
    """Return one pixel a cell of an image (height, width, 3), which shows its colours and if it is another."""
    step = int(cell_width(*image.shape[:2]))
    return image[::step, ::step]  # pyright: ignore[reportReturnType]


def cell_width(height: int, width: int) -> float:
    """Return the width of a cell [px] in an image of this size [px]."""
    return max(min(height, width) / ACROSS, 1.0)


def third_of_cell(height: int, width: int) -> float:
    """Return the width of a third of a cell [px], the finest that is looked at."""
    return cell_width(height, width) / 3.0


def cells_of(image: Image | Levels) -> Levels:
    """Return the cells (rows, columns, 3) of an image (height, width, 3)."""
    pixels = cell_width(*image.shape[:2])
    return area_means(image, round(image.shape[0] / pixels), round(image.shape[1] / pixels))


def wide_cells_of(image: Image) -> Levels:
    """Return the cells of an image (height, width, 3) without what is thinner than half a cell, such as a scratch.

    Images of few pixels stay as they are.
    """
    import cv2

    height, width = image.shape[:2]
    pixels, sample = cell_width(height, width), third_of_cell(height, width)
    if sample < 1.0:
        return cells_of(image)
    samples = np.rint(area_means(image, round(height / sample), round(width / sample))).astype(np.uint8)
    thick = np.asarray(cv2.medianBlur(samples, NEIGHBOURS), np.uint8)
    return area_means(thick, round(height / pixels), round(width / pixels))


def area_means(image: Image | Levels, rows: int, columns: int) -> Levels:
    """Return the means (rows, columns, 3) of an image (height, width, 3) over areas of equal size.

    The result is that of OpenCV's INTER_AREA, in a quarter of the time.
    """
    return _area_means(np.ascontiguousarray(image), rows, columns)


def compare(cells: Levels, untouched: Levels, tolerance: Levels | np.float32) -> float:
    """Return the share of values of cells (rows, columns, 3) that are off the untouched gel's in their light.

    The light relative to the untouched gel's is a plane over the image, fitted robustly to each channel, so a touch of
    less than half of the pad does not matter.
    """
    return np.count_nonzero(np.abs(change_in_light(cells, untouched)) > tolerance) / cells.size


def change_in_light(image: Levels, untouched: Levels, columns: int | None = None) -> Levels:
    """Return the change (rows, width, 3) of an image from the untouched gel in its light.

    The light is found in so many columns, by default in all.
    """
    seen, known = image, untouched
    if columns is not None:
        seen, known = (area_means(each, len(each), columns) for each in (image, untouched))
    return _change(image, untouched, _planes(seen, known))


def _planes(cells: Levels, untouched: Levels) -> Light:
    """Return the light in cells relative to the untouched gel's, by reweighted least squares from the median on."""
    seen, known = (np.ascontiguousarray(each.transpose(2, 0, 1)) for each in (cells, untouched))
    planes, count = np.zeros((len(seen), 3)), known[0].size
    middle = [(count - 1) // 2, count // 2]
    ratios = np.partition((seen / np.maximum(known, np.float32(1.0))).reshape(len(seen), -1), middle)
    planes[:, 0] = ratios[:, middle].mean(axis=1)
    _fit(seen, known, planes, np.empty((3, 4)))
    return planes


@compiled
def _area_means(image: Records, rows: int, columns: int) -> Records:
    height, width, _ = image.shape
    out = np.empty((rows, columns, 3), np.float32)
    lines = image.reshape(height, 3 * width)
    down, across = height / rows, width / columns
    shares = np.empty((columns, int(across) + 2), np.float32)  # of each pixel in its column
    for column in range(columns):
        left, right = column * across, (column + 1) * across
        for x in range(int(left), min(math.ceil(right - 1e-9), width)):
            share = (min(x + 1.0, right) - max(float(x), left)) / (down * across)
            shares[column, x - int(left)] = np.float32(share)
    line = np.empty(3 * width, np.float32)
    for row in range(rows):
        top, bottom = row * down, (row + 1) * down
        line[:] = np.float32(0.0)
        for y in range(int(top), min(math.ceil(bottom - 1e-9), height)):
            share = np.float32(min(y + 1.0, bottom) - max(float(y), top))
            for i in range(3 * width):  # one long loop, which the compiler turns into vector instructions
                line[i] += share * np.float32(lines[y, i])
        for column in range(columns):
            first = int(column * across)
            red = green = blue = np.float32(0.0)  # three sums at a time, as each waits for its last addition
            for x in range(first, min(math.ceil((column + 1) * across - 1e-9), width)):
                share = shares[column, x - first]
                red += share * line[3 * x]
                green += share * line[3 * x + 1]
                blue += share * line[3 * x + 2]
            out[row, column, 0], out[row, column, 1], out[row, column, 2] = red, green, blue
    return out


@compiled
def _change(image: Records, untouched: Records, light: Light) -> Records:
    rows, columns, channels = untouched.shape
    out = np.empty((rows, columns, channels), np.float32)
    for row in range(rows):
        down = 2.0 * (row + 0.5) / rows - 1.0
        for column in range(columns):
            right = 2.0 * (column + 0.5) / columns - 1.0
            for channel in range(channels):
                part = light[channel, 0] + light[channel, 1] * right + light[channel, 2] * down
                part = np.float32(min(max(part, 1.0 / LARGEST_LIGHT_CHANGE), LARGEST_LIGHT_CHANGE))
                out[row, column, channel] = image[row, column, channel] - part * untouched[row, column, channel]
    return out


@partial(compiled, fastmath={"reassoc"})  # sums may be taken in any order, and so several terms at a time
def _fit(cells: Levels, untouched: Levels, planes: Light, system: Light) -> None:
    """Fit the planes of cells (channels, rows, columns), which are close already; `system` (3, 4) is room."""
    channels, rows, columns = cells.shape
    for channel in range(channels):
        middle, right, down = planes[channel, 0], planes[channel, 1], planes[channel, 2]
        seen, known = cells[channel], untouched[channel]
        for _ in range(MOST_LIGHT_FITS):
            system[:] = 0.0
            for i in range(3):
                system[i, i] = 1.0  # so that a black channel has a fit
            for row in range(rows):
                y = 2.0 * (row + 0.5) / rows - 1.0
                at, total, along, along_twice, off_total, off_along = middle + down * y, 0.0, 0.0, 0.0, 0.0, 0.0
                for column in range(columns):
                    x = 2.0 * (column + 0.5) / columns - 1.0
                    level = np.float64(known[row, column])
                    off = seen[row, column] - (at + right * x) * level
                    part = level / (1.0 + (off / _OUTLIER) ** 2)
                    weight, part = part * level, part * off
                    total += weight
                    along += weight * x
                    along_twice += weight * x * x
                    off_total += part
                    off_along += part * x
                system[0, 0] += total
                system[0, 1] += along
                system[0, 2] += total * y
                system[1, 1] += along_twice
                system[1, 2] += along * y
                system[2, 2] += total * y * y
                system[0, 3] += off_total
                system[1, 3] += off_along
                system[2, 3] += off_total * y
            for i in range(3):  # NumPy's solver would take five seconds to compile
                for j in range(3):
                    share = system[min(i, j), max(i, j)] / system[i, i] if j != i else 0.0
                    for k in range(i + 1, 4):
                        system[j, k] -= share * system[i, k]
            for i in range(3):
                system[i, 3] /= system[i, i]
            middle, right, down = middle + system[0, 3], right + system[1, 3], down + system[2, 3]
            if max(abs(system[0, 3]), abs(system[1, 3]), abs(system[2, 3])) < SETTLED_LIGHT:
                break
        planes[channel, 0], planes[channel, 1], planes[channel, 2] = middle, right, down
