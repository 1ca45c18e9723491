"""Cells of images, and the light in an image relative to the light in that of the untouched gel.

A cell is the mean over a square part of an image; 30 cells lie along the shorter side. Cells have less noise than
pixels, so a touch of 0.1 mm shows. Nothing is lost: the gel spreads every touch over more than a cell of 0.6 mm.
"""

import math
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Image, Integers, Levels, Records
from palpate.compiled import compiled, kernel
from palpate.config import CONTACT_DETECTION
from palpate.touch.neighbours import median_near

Pixels = TypeVar("Pixels", bound=NDArray[Any])
Light = NDArray[np.float64]
"""(channels, 3): the plane of relative brightness over an image, by its value in the middle and its changes from there
to the right border and to the lower one."""

ACROSS = 30
"""Cells along the shorter side of an image."""
NEIGHBOURS = 5
"""Width of the median filter that removes scratches [thirds of a cell]: what fills less than half of it disappears."""
LARGEST_LIGHT_CHANGE = 3.0
"""Factor by which the light may change either way while the gel still shows."""
MOST_LIGHT_FITS = 8
"""Most fits of the light in one channel of an image."""
SETTLED_LIGHT = 1e-3
"""Change of the light, relative to the untouched gel's, that ends the fits: a quarter of a grey level."""
_OUTLIER = 0.5 * CONTACT_DETECTION.significant * CONTACT_DETECTION.least_deviation
"""[grey levels] Residual of the light's plane at which a cell has half its weight: half of what is significant."""


def is_dark(image: Image | Levels) -> bool:
    """Return true if light or camera are not on yet: a mean below 5 grey levels."""
    return float(image.mean()) < 5.0


def is_flat(image: Image | Levels) -> bool:
    """Return true if all levels of an image, or of its cells, lie within 4, as in black and saturated images."""
    return float(np.ptp(image)) < 4.0


def is_grey(image: Image | Levels) -> bool:
    """Return true if all channels of an image (height, width, 3) are equal, also in a black one."""
    if image.ndim != 3:
        return False
    sparse = sparse_pixels(image)
    # The first row tells at once of nearly all images with colours.
    return not any(np.count_nonzero(pixels[..., 1:] != pixels[..., :1]) for pixels in (sparse[:1], sparse))


def sparse_pixels(image: Pixels) -> Pixels:
    """Return one pixel of each cell of an image (height, width, 3): enough to see if two images are the same."""
    step = int(cell_width(*image.shape[:2]))
    return image[::step, ::step]  # pyright: ignore[reportReturnType]


def unlike_sparsely(image: Image, before: Image) -> float:
    """Return the share of values in the sparse pixels of an image that differ from those before, which they replace."""
    step = int(cell_width(*image.shape[:2]))
    return _replace_sparse(np.ascontiguousarray(image), step, before) / before.size


def cell_width(height: int, width: int) -> float:
    """Return the width of a cell [px] in an image of this size [px]."""
    return max(min(height, width) / ACROSS, 1.0)


def third_of_cell(height: int, width: int) -> float:
    """Return the width of a third of a cell [px], the finest detail that is used."""
    return cell_width(height, width) / 3.0


def cells_of(image: Image | Levels) -> Levels:
    """Return the cells (rows, columns, 3) of an image (height, width, 3)."""
    height, width = image.shape[:2]
    pixels = cell_width(height, width)
    return area_means(image, round(height / pixels), round(width / pixels))


def wide_cells_of(image: Image | Levels) -> Levels:
    """Return the cells of an image (height, width, 3) without details thinner than half a cell, such as scratches.

    Images of so few pixels that a third of a cell has less than one are not filtered.
    """
    height, width = image.shape[:2]
    pixels = cell_width(height, width)
    sample = third_of_cell(height, width)
    if sample < 1.0:
        return cells_of(image)
    samples = np.rint(area_means(image, round(height / sample), round(width / sample))).astype(np.uint8)
    return area_means(median_near(samples, NEIGHBOURS), round(height / pixels), round(width / pixels))


def area_means(image: Image | Levels, rows: int, columns: int) -> Levels:
    """Return the means (rows, columns, 3) of an image (height, width, 3) over areas of equal size.

    The result is that of OpenCV's INTER_AREA, in a quarter of the time. Its channels lie apart, see `channels_apart`.
    """
    height, width, _ = image.shape
    lines = np.ascontiguousarray(image).reshape(height, 3 * width)
    means = np.empty((3, rows, columns), np.float32)
    weights = np.empty((columns, width // columns + 2), np.float32)
    bounds = np.empty((2, columns), np.int64)
    are_pixels = lines.dtype == np.uint8
    are_rows_whole = are_pixels and height % rows == 0 and height // rows <= _MOST_ROWS
    sums = np.empty(3 * width if are_rows_whole else 0, np.uint16)
    write = _area_means_of_pixels if are_pixels else _area_means_of_levels
    write(lines, weights, bounds, sums, np.empty(3 * width, np.float32), means)
    return means.transpose(1, 2, 0)


def channels_apart(levels: Levels) -> Levels:
    """Return levels (rows, columns, 3) with each channel in one piece of memory, as compiled functions read them."""
    return _by_channel(levels).transpose(1, 2, 0)


def compare(
    cells: Levels, untouched: Levels, tolerance: Levels | np.float32, start: Light | None = None
) -> tuple[float, Light]:
    """Return the share of values of cells (rows, columns, 3) off the untouched gel's by over a tolerance.

    The untouched gel is taken in the light of the cells, which is fitted from `start` on as by `light_in`, and returned
    as well.
    """
    tolerances = tolerance if isinstance(tolerance, np.ndarray) else np.full_like(cells, tolerance)
    levels = _by_channel(cells)
    untouched_levels = _by_channel(untouched)
    planes = _median_light(levels, untouched_levels) if start is None else start.copy()
    changed = _fit_and_count_changed(levels, untouched_levels, planes, np.empty((3, 4)), _by_channel(tolerances))
    return changed / cells.size, planes


def light_in(cells: Levels, untouched: Levels) -> Light:
    """Return the light in cells (rows, columns, 3) relative to the untouched gel's, a plane for each channel.

    The planes are fitted robustly, so that a touch of less than half of the pad does not change them. The fit starts at
    the median.
    """
    levels = _by_channel(cells)
    untouched_levels = _by_channel(untouched)
    planes = _median_light(levels, untouched_levels)
    _fit_light(levels, untouched_levels, planes, np.empty((3, 4)))
    return planes


def _median_light(levels: Levels, untouched: Levels) -> Light:
    """Return the light in levels (channels, rows, columns) by the median, the same all over the image."""
    planes = np.zeros((len(levels), 3))
    planes[:, 0] = np.median(levels / np.maximum(untouched, np.float32(1.0)), axis=(1, 2))
    return planes


def change_in_light(image: Levels, untouched: Levels, light: Light) -> Levels:
    """Return the change (rows, columns, 3) of an image from the untouched gel in a light; its channels lie apart."""
    change = np.empty((image.shape[2], *image.shape[:2]), np.float32)
    _put_change(_by_channel(image), _by_channel(untouched), light, change)
    return change.transpose(1, 2, 0)


def move_towards(levels: Levels, image: Image, part: float) -> None:
    """Move levels towards an image of the same shape by a fraction of the way, in place."""
    _move_towards(levels.reshape(-1), image.reshape(-1), part)


def _by_channel(levels: Levels) -> Levels:
    """Return levels (rows, columns, 3) as (3, rows, columns); those that lie so already are not copied."""
    return np.ascontiguousarray(levels.transpose(2, 0, 1))


_PLANE = np.zeros((1, 1))  # examples of arrays that compiled functions take
_LEVELS = np.zeros((1, 1, 1), np.float32)


@kernel
def _put_sum_of_rows(lines: Records, top: float, bottom: float, line: Levels) -> None:
    """Write the sum (3 width,) of the rows of pixels between two heights, those at the borders in part."""
    line[:] = np.float32(0.0)
    for y in range(int(top), min(math.ceil(bottom - 1e-9), len(lines))):
        weight = np.float32(min(y + 1.0, bottom) - max(float(y), top))
        for i in range(len(line)):  # one long loop, which the compiler turns into vector instructions
            line[i] += weight * np.float32(lines[y, i])


@kernel
def _put_sum_of_whole_rows(lines: Records, first: int, beyond: int, sums: Records, line: Levels) -> None:
    """Write the same of whole rows, which are summed as whole numbers in half the time."""
    sums[:] = 0
    for y in range(first, beyond):
        for i in range(len(sums)):
            sums[i] += np.uint16(lines[y, i])
    for i in range(len(sums)):
        line[i] = np.float32(sums[i])


def _put_area_means(
    lines: Records, weights: Levels, bounds: Integers, sums: Records, line: Levels, out: Levels
) -> None:
    """Write the means (3, rows, columns) over areas: first down each column of pixels, then along the row of sums.

    `lines` (height, 3 width) are the pixels; `weights` (columns, pixels of an area), `bounds` (2, columns), `sums` and
    `line` (3 width,) are room. There are `sums` where areas have whole rows of pixels alone.
    """
    _, rows, columns = out.shape
    height = len(lines)
    width = lines.shape[1] // 3
    area_height = height / rows
    area_width = width / columns
    first = bounds[0]
    beyond = bounds[1]  # the pixel behind each area
    for column in range(columns):
        left = column * area_width
        right = (column + 1) * area_width
        first[column] = int(left)
        beyond[column] = min(math.ceil(right - 1e-9), width)
        for x in range(first[column], beyond[column]):
            weight = (min(x + 1.0, right) - max(float(x), left)) / (area_height * area_width)
            weights[column, x - first[column]] = np.float32(weight)
    for row in range(rows):
        if len(sums):
            _put_sum_of_whole_rows(lines, row * (height // rows), (row + 1) * (height // rows), sums, line)
        else:
            _put_sum_of_rows(lines, row * area_height, (row + 1) * area_height, line)
        for column in range(columns):
            # Three sums side by side: an addition to one need not wait for the last addition to another.
            red = np.float32(0.0)
            green = np.float32(0.0)
            blue = np.float32(0.0)
            for x in range(first[column], beyond[column]):
                weight = weights[column, x - first[column]]
                red += weight * line[3 * x]
                green += weight * line[3 * x + 1]
                blue += weight * line[3 * x + 2]
            out[0, row, column] = red
            out[1, row, column] = green
            out[2, row, column] = blue


_MOST_ROWS = np.iinfo(np.uint16).max // 255
"""Rows of pixels whose sums fit into 16 bits."""
_ROOM = (np.zeros((1, 1), np.float32), np.zeros((1, 1), np.int64), np.zeros(1, np.uint16), np.zeros(1, np.float32))
_area_means_of_pixels = compiled(np.zeros((1, 1), np.uint8), *_ROOM, _LEVELS, name="means_of_pixels")(_put_area_means)
_area_means_of_levels = compiled(np.zeros((1, 1), np.float32), *_ROOM, _LEVELS, name="means_of_levels")(_put_area_means)


@compiled(_LEVELS, _LEVELS, _PLANE, _LEVELS)
def _put_change(image: Levels, untouched: Levels, light: Light, out: Levels) -> None:
    """Write an image less the untouched gel (channels, rows, columns) in a light."""
    channels, rows, columns = untouched.shape
    for channel in range(channels):
        plane = light[channel]
        for row in range(rows):
            y = _middle(row, rows)
            for column in range(columns):
                factor = _brightness(plane, _middle(column, columns), y)
                out[channel, row, column] = image[channel, row, column] - factor * untouched[channel, row, column]


@compiled(_LEVELS, _LEVELS, _PLANE, _PLANE, _LEVELS)
def _fit_and_count_changed(cells: Levels, untouched: Levels, light: Light, system: Light, tolerance: Levels) -> int:
    """Fit the light, and return the count of values (channels, rows, columns) off the gel's by over a tolerance.

    `light` (channels, 3) is close already; `system` (3, 4) is room.
    """
    channels, rows, columns = cells.shape
    count = 0
    for channel in range(channels):
        plane = light[channel]
        _fit_plane(cells[channel], untouched[channel], plane, system)
        for row in range(rows):
            y = _middle(row, rows)
            for column in range(columns):
                factor = _brightness(plane, _middle(column, columns), y)
                change = cells[channel, row, column] - factor * untouched[channel, row, column]
                count += abs(change) > tolerance[channel, row, column]
    return count


@compiled(np.zeros(1, np.float32), np.zeros(1, np.uint8), 0.0)
def _move_towards(levels: Levels, image: Image, part: float) -> None:
    """Move levels (N,) towards an image in one pass, in a seventh of the time of NumPy's three."""
    share = np.float32(part)
    for i in range(len(levels)):
        levels[i] += share * (np.float32(image[i]) - levels[i])


@compiled(np.zeros((1, 1, 1), np.uint8), 0, np.zeros((1, 1, 1), np.uint8))
def _replace_sparse(image: Image, step: int, sparse: Image) -> int:
    """Set sparse pixels to those of an image, one in so many, and return the count of values that change."""
    count = 0
    rows, columns, channels = sparse.shape
    for row in range(rows):
        for column in range(columns):
            for channel in range(channels):
                level = image[row * step, column * step, channel]
                count += sparse[row, column, channel] != level
                sparse[row, column, channel] = level
    return count


@kernel
def _middle(index: int, count: int) -> float:
    """Return the middle of a row or column of an image, from -1 to 1."""
    return (2 * index + 1) * (1.0 / count) - 1.0


@kernel
def _brightness(plane: Light, x: float, y: float) -> Any:
    """Return the brightness of a plane at a place of an image relative to the untouched gel's, in its limits."""
    brightness = plane[0] + plane[1] * x + plane[2] * y
    return np.float32(min(max(brightness, 1.0 / LARGEST_LIGHT_CHANGE), LARGEST_LIGHT_CHANGE))


_IN_ANY_ORDER = {"reassoc"}
"""Numba's option for a function whose sums may be taken in any order, and so several terms at a time."""


@compiled(_LEVELS, _LEVELS, _PLANE, _PLANE)
def _fit_light(cells: Levels, untouched: Levels, light: Light, system: Light) -> None:
    """Fit the light (channels, 3) in cells (channels, rows, columns), as `_count_changed` does."""
    for channel in range(len(cells)):
        _fit_plane(cells[channel], untouched[channel], light[channel], system)


@partial(kernel, fastmath=_IN_ANY_ORDER)
def _fit_plane(cells: Levels, untouched: Levels, plane: Light, system: Light) -> None:
    """Fit the plane (3,) of one channel's light, which is close already; `system` (3, 4) is room."""
    for _ in range(MOST_LIGHT_FITS):
        _sum_normal_equations(cells, untouched, plane, system)
        _solve(system)
        step = system[:, 3]
        for i in range(3):
            plane[i] += step[i]
        if max(abs(step[0]), abs(step[1]), abs(step[2])) < SETTLED_LIGHT:
            break


@partial(kernel, fastmath=_IN_ANY_ORDER)
def _sum_normal_equations(cells: Levels, untouched: Levels, plane: Light, system: Light) -> None:
    """Set `system` (3, 4) to the normal equations of the step of a plane (3,), right side last, for one channel.

    Cells count less the farther they are off the plane.
    """
    rows, columns = cells.shape
    system[:] = 0.0
    for i in range(3):
        system[i, i] = 1.0  # so that a black channel has a solution
    for row in range(rows):
        y = _middle(row, rows)
        brightness_of_row = plane[0] + plane[2] * y
        # Sums over the row of the weight w and of the weighted residual r, each with powers of x.
        w = 0.0
        w_x = 0.0
        w_x_x = 0.0
        r = 0.0
        r_x = 0.0
        for column in range(columns):
            x = _middle(column, columns)
            level = np.float64(untouched[row, column])
            residual = cells[row, column] - (brightness_of_row + plane[1] * x) * level
            robust_level = level / (1.0 + (residual / _OUTLIER) ** 2)
            weight = robust_level * level
            weighted_residual = robust_level * residual
            w += weight
            w_x += weight * x
            w_x_x += weight * x * x
            r += weighted_residual
            r_x += weighted_residual * x
        system[0, 0] += w
        system[0, 1] += w_x
        system[0, 2] += w * y
        system[1, 1] += w_x_x
        system[1, 2] += w_x * y
        system[2, 2] += w * y * y
        system[0, 3] += r
        system[1, 3] += r_x
        system[2, 3] += r * y


@partial(kernel, fastmath=_IN_ANY_ORDER)
def _solve(system: Light) -> None:
    """Solve three symmetric equations (3, 4) by Gauss-Jordan elimination; the solution becomes the last column.

    NumPy's solver would take five seconds to compile.
    """
    for i in range(3):
        for j in range(3):
            if j == i:
                continue
            factor = system[min(i, j), max(i, j)] / system[i, i]  # symmetric: only the upper half is kept up to date
            for k in range(i + 1, 4):
                system[j, k] -= factor * system[i, k]
    for i in range(3):
        system[i, 3] /= system[i, i]
