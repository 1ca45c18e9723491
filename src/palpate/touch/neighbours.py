"""Filters over the neighbours of each pixel, and connected spots of a mask: what the gel's images need of OpenCV."""

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Flags, Image, Integers
from palpate.compiled import compiled, kernel

Pixels = TypeVar("Pixels", bound=NDArray[Any])


_AT_A_TIME = 1024  # values whose medians are found together


def largest_near(pixels: Pixels, width: int) -> Pixels:
    """Return the largest value (height, width, ...) in a square about each pixel, of this width [px]."""
    return _chosen_near(pixels, width, np.maximum)


def least_near(pixels: Pixels, width: int) -> Pixels:
    """Return the least value (height, width, ...) in a square about each pixel, of this width [px]."""
    return _chosen_near(pixels, width, np.minimum)


def closed(pixels: Pixels, width: int) -> Pixels:
    """Return pixels (height, width, ...) in which what is dark and narrower than a width [px] is filled."""
    return least_near(largest_near(pixels, width), width)


def opened(pixels: Pixels, width: int) -> Pixels:
    """Return pixels (height, width, ...) in which what is bright and narrower than a width [px] is removed."""
    # The second square is turned, as one of an even width is off by half a pixel.
    return _chosen_near(least_near(pixels, width), width, np.maximum, is_turned=True)


def _chosen_near(pixels: Any, width: int, choose: np.ufunc, is_turned: bool = False) -> Any:
    """Return the largest or least value in a square about each pixel; there is nothing beyond the border."""
    before = width // 2
    after = width - 1 - before
    wider = _beyond_the_border(pixels, after, before) if is_turned else _beyond_the_border(pixels, before, after)
    row = wider[0].size
    column = wider[0, 0].size
    # Rows lie one behind the other, as NumPy is quicker the longer they are. What begins in the last columns would
    # reach into the next row, and is cut off.
    chosen = wider.ravel()
    span = 1  # width of the squares that values are chosen from so far
    while span < width:
        step = min(span, width - span)
        chosen = choose(chosen[: -step * row], chosen[step * row :])
        chosen = choose(chosen[: -step * column], chosen[step * column :])
        span += step
    rows = np.empty((len(pixels), *wider.shape[1:]), pixels.dtype)
    rows.ravel()[: chosen.size] = chosen
    return rows[:, : pixels.shape[1]]


def _beyond_the_border(pixels: Any, before: int, after: int) -> Any:
    """Return pixels (height, width, ...) that go on as at the border, so many before the first and after the last.

    NumPy's `pad` takes five times as long.
    """
    height, width = pixels.shape[:2]
    rows = slice(before, before + height)
    columns = slice(before, before + width)
    wider = np.empty((before + height + after, before + width + after, *pixels.shape[2:]), pixels.dtype)
    wider[rows, columns] = pixels
    wider[:before, columns] = pixels[:1]
    wider[rows.stop :, columns] = pixels[-1:]
    wider[:, :before] = wider[:, before : before + 1]
    wider[:, columns.stop :] = wider[:, columns.stop - 1 : columns.stop]
    return wider


def median_near(image: Image, width: int) -> Image:
    """Return the median (rows, columns, 3) in a square about each pixel, of an odd width [px].

    Beyond the border the image goes on as at it.
    """
    rows, columns, _ = image.shape
    padded = _beyond_the_border(image, width // 2, width // 2)
    line = 3 * padded.shape[1]
    along = np.arange(width)
    shifts = (line * along[:, None] + 3 * along).ravel()
    medians = np.empty(rows * line, np.uint8)
    kept = np.empty((len(shifts) // 2 + 2, _AT_A_TIME), np.uint8)
    _set_medians(padded.ravel(), shifts, kept, medians[: padded.size - shifts[-1]])
    return medians.reshape(rows, -1, 3)[:, :columns]


_BYTES = np.zeros(1, np.uint8)  # examples of arrays that compiled functions take
_BYTES_IN_ROWS = np.zeros((1, 1), np.uint8)


@compiled(_BYTES, np.zeros(1, np.int64), _BYTES_IN_ROWS, _BYTES)
def _set_medians(
    values: NDArray[np.uint8], shifts: Integers, kept: NDArray[np.uint8], medians: NDArray[np.uint8]
) -> None:
    """Set the median of the values that lie behind each by these shifts, of which there are 2 n + 1.

    It is neither the least nor the greatest of any n + 2 of them. So these two are dropped and the next is taken, until
    one is left; for many values at a time, as the compiler turns that into vector instructions. `kept` (n + 2, many) is
    room.
    """
    most = kept.shape[1]
    for start in range(0, len(medians), most):
        count = min(most, len(medians) - start)
        for place in range(len(kept) - 1):
            _copy(values[start + shifts[place] :], kept[place], count)
        used = len(kept)
        for taken in range(used - 1, len(shifts)):
            _copy(values[start + shifts[taken] :], kept[used - 1], count)
            for place in range(used - 1):  # the greatest comes last
                _put_in_order(kept[place], kept[place + 1], count)
            for place in range(used - 2):  # and the least before it
                _put_in_order(kept[place + 1], kept[place], count)
            used -= 1
        _copy(kept[0], medians[start:], count)


@kernel
def _copy(source: NDArray[np.uint8], target: NDArray[np.uint8], count: int) -> None:
    for i in range(count):
        target[i] = source[i]


@kernel
def _put_in_order(low: NDArray[np.uint8], high: NDArray[np.uint8], count: int) -> None:
    """Exchange two values where the first is greater."""
    for i in range(count):
        least = min(low[i], high[i])
        high[i] = max(low[i], high[i])
        low[i] = least


@dataclass(frozen=True, eq=False)
class Spots:
    """Connected spots of a mask, corners included; the first, 0, is all that is not set."""

    spot_of: NDArray[np.int32]
    """Index of the spot of each pixel, (height, width)."""
    area: Integers
    """Pixels of each spot, (N,)."""
    extent: Integers
    """Height and width of each spot, (N, 2) [px]; zero for the first."""


def spots_of(mask: Flags) -> Spots:
    """Return the connected spots of a mask (height, width)."""
    rows, columns = mask.shape
    count = np.count_nonzero(mask)
    spot_of = np.zeros((rows + 1, columns + 2), np.int32)  # with room above and beside, so that there is no border
    area = np.zeros(1 + count, np.int64)
    bounds = np.empty((1 + count, 4), np.int64)
    room = np.empty(1 + count, np.int64)
    spots = 1 + _put_spots(np.ascontiguousarray(mask), spot_of, room, bounds, area)
    bounds[0] = (1, 1, 0, 0)
    area[0] = mask.size - count
    return Spots(spot_of[1:, 1:-1], area[:spots], bounds[:spots, 2:] - bounds[:spots, :2] + 1)


_INTEGERS = np.zeros(1, np.int64)


@compiled(np.zeros((1, 1), np.bool_), np.zeros((1, 1), np.int32), _INTEGERS, np.zeros((1, 1), np.int64), _INTEGERS)
def _put_spots(mask: Flags, spot_of: NDArray[np.int32], same_as: Integers, bounds: Integers, area: Integers) -> int:
    """Set the index of each spot's pixels, from 1 on, with what it covers, and return the number of spots.

    `spot_of` (1 + height, width + 2) lies one pixel lower and farther right than the mask. Of N pixels, `bounds` (1 +
    N, 4) are first row and column of each spot and the last ones, `area` (1 + N,) its pixels; `same_as` (1 + N,) is
    room: parts of a spot get numbers of their own, each of which is the same as a lower one if they meet.
    """
    rows, columns = mask.shape
    parts = _put_parts(mask, spot_of, same_as)
    spots = 0
    for part in range(1, parts + 1):  # from here on `same_as` is the index of the spot
        is_first = same_as[part] == part
        spots += is_first
        same_as[part] = spots if is_first else same_as[same_as[part]]
    for row in range(rows):
        for column in range(columns):
            if mask[row, column]:
                spot = same_as[spot_of[row + 1, column + 1]]
                spot_of[row + 1, column + 1] = spot
                of_spot = bounds[spot]
                if area[spot] == 0:
                    of_spot[0] = row
                    of_spot[1] = column
                    of_spot[3] = column
                area[spot] += 1
                of_spot[1] = min(of_spot[1], column)
                of_spot[2] = row
                of_spot[3] = max(of_spot[3], column)
    return spots


@kernel
def _put_parts(mask: Flags, part_of: NDArray[np.int32], same_as: Integers) -> int:
    """Set the part of each pixel by those above and to the left, and which parts meet; return the number of parts."""
    rows, columns = mask.shape
    count = 0
    for row in range(rows):
        above = part_of[row]
        now = part_of[row + 1]
        for column in range(columns):
            if not mask[row, column]:
                continue
            part = above[column + 1]  # which the pixels beside it belong to as well
            if part == 0:
                part = max(now[column], above[column])  # the same if both are set
                right = above[column + 2]
                if part > 0 and right > 0:
                    _join(same_as, part, right)
                part = max(part, right)
            if part == 0:
                count += 1
                same_as[count] = count
                part = count
            now[column + 1] = part
    return count


@kernel
def _join(same_as: Integers, part: int, other: int) -> None:
    """Let two parts be of one spot."""
    while same_as[part] != part:
        part = same_as[part]
    while same_as[other] != other:
        other = same_as[other]
    same_as[max(part, other)] = min(part, other)
