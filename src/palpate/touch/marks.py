"""Marks on the gel: grains, dents and scratches, which come from one image to the next, are thin or small, and stay.

They are taken into the untouched gel as soon as they appear, in a contact as well, so that touch is read beside and
under them. A touch is wider, as the gel spreads it, and what it changes over a small area is smooth or moves. A mark
that goes again leaves in the same way.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Flags, Image, Levels
from palpate.compiled import compiled, kernel
from palpate.config import CONTACT_DETECTION
from palpate.touch.cells import cell_width
from palpate.touch.neighbours import largest_near, opened, spots_of

EDGE = round(CONTACT_DETECTION.significant * CONTACT_DETECTION.least_deviation)
"""Change [grey levels], in the mean over 3 x 3 pixels, from which a pixel belongs to a mark."""


@dataclass(frozen=True)
class _Appearance:
    """Limits by which a mark differs from a touch as it appears."""

    jump: int = 16
    """Change of a pixel from one image to the next [grey levels] that a mark makes and noise does not."""
    least_jumps: int = 6
    """Pixels of a mark with such a change; fewer are noise."""
    sharp: float = 0.2
    """Share of a mark's pixels with such a change. What a touch changes over so small an area has fewer, as the gel
    smooths it; with a share of 0 touches that slide are taken for marks."""
    one_way: float = 0.8
    """Share of the change of a mark, and of what has changed within a cell of it, that is left in the mean: a mark is
    brighter or darker all over. The imprint of a corner is as thin, but where it comes to is beside where it was."""
    thin: float = 1.0
    """Width of a scratch [cells], half a millimetre on a DIGIT, that none exceeds."""
    small: float = 2.0
    """Width and height of a grain [cells] that none exceeds."""
    most_moved: float = 0.04
    """Share of an image that changes more widely while a touch slides; where one begins or ends within one image, 0.07
    to 0.7 of real ones do, and what is small may be of it."""


_MARK = _Appearance()


def new_marks(image: Image, before: Image) -> Flags | None:
    """Return the pixels (height, width) of marks in an image (height, width, 3) that are not in the one before.

    None if there are none, or if a touch begins, ends or jumps, so that what is small may be of it.
    """
    lines = _lines(image)
    lines_before = _lines(before)
    jumps = 2 * _jumps_in_every_other_row(lines, lines_before, _MARK.jump)
    if not _MARK.least_jumps <= jumps <= _MARK.most_moved * image.size:
        return None  # at once, as for most images
    jumped = np.empty(image.shape[:2], np.bool_)
    changed = np.empty(image.shape[:2], np.bool_)
    sums = np.empty(lines.shape[1] + 6, np.int16)
    flags = np.empty(lines.shape[1], np.bool_)
    _find_changes(lines, lines_before, (_MARK.jump, 9 * EDGE), sums, flags, jumped, changed)
    part = _part_around(changed)
    marks = _marks_in(image[part], before[part], jumped[part], changed[part], image.shape[:2])
    if marks is None:
        return None
    changed[:] = False
    changed[part] = marks
    return changed


def _part_around(changed: Flags) -> tuple[slice, slice]:
    """Return the rows and columns with all that has changed, and one more on each side."""
    rows = np.flatnonzero(changed.any(axis=1))
    columns = np.flatnonzero(changed.any(axis=0))
    if not len(rows):
        return slice(0), slice(0)
    return slice(max(rows[0] - 1, 0), rows[-1] + 2), slice(max(columns[0] - 1, 0), columns[-1] + 2)


def _marks_in(image: Image, before: Image, jumped: Flags, changed: Flags, size: tuple[int, int]) -> Flags | None:
    """Return the pixels of marks in the changed part of an image of this size [px]; None as `new_marks` does."""
    cell = cell_width(*size)
    width = round(_MARK.thin * cell)
    most = _MARK.most_moved * size[0] * size[1]
    if np.count_nonzero(changed) > most and np.count_nonzero(opened(changed, width)) > most:
        return None  # before the search for spots, as a contact that begins has enough else to do
    spots = spots_of(changed)
    count = len(spots.area)
    jumps_of = np.bincount(spots.spot_of[jumped], minlength=count)
    are_sharp = (jumps_of >= _MARK.least_jumps) & (jumps_of > _MARK.sharp * spots.area)
    are_sharp[0] = False  # all that has not changed
    if not are_sharp.any():
        return None
    wide = opened(changed, width)
    are_small = np.asarray((spots.extent <= _MARK.small * cell).all(axis=1))
    marks = np.zeros_like(changed)
    for spot in np.flatnonzero(are_sharp):
        inside = spots.spot_of == spot
        is_thin = not (inside & wide).any()
        if not (is_thin or are_small[spot]):
            continue
        around = largest_near(inside, 2 * round(cell) + 1) & changed
        if _is_brighter_or_darker(image[around].astype(np.int16) - before[around]):
            marks |= inside
    return largest_near(marks, 3) if marks.any() else None


def put_marks(mean: Levels, marks: Flags, image: Image, before: Image) -> None:
    """Add marks as they appear from one image to the next to the mean (height, width, 3) of the untouched gel."""
    pixels = mean.reshape(-1, 3)
    places = np.flatnonzero(marks)
    change = image.reshape(-1, 3)[places].astype(np.float32) - before.reshape(-1, 3)[places]
    pixels[places] = np.clip(pixels[places] + change, 0.0, 255.0)


def _lines(image: Image) -> Image:
    """Return the rows of an image (height, 3 * width) in one piece of memory."""
    return np.ascontiguousarray(image).reshape(len(image), -1)


_LINES = np.zeros((1, 1), np.uint8)  # examples of arrays that compiled functions take
_MASK = np.zeros((1, 1), np.bool_)


@compiled(_LINES, _LINES, 0)
def _jumps_in_every_other_row(lines: Image, before: Image, jump: int) -> int:
    """Return the number of values that have changed by more than a jump [grey levels]."""
    count = 0
    for row in range(0, len(lines), 2):
        of_row = np.uint16(0)  # so small that the compiler adds many at a time
        for i in range(lines.shape[1]):
            of_row = np.uint16(of_row + (_distance(lines[row, i], before[row, i]) > np.uint8(jump)))
        count += int(of_row)
    return count


@compiled(_LINES, _LINES, (0, 0), np.zeros(1, np.int16), np.zeros(1, np.bool_), _MASK, _MASK)
def _find_changes(
    lines: Image,
    before: Image,
    limits: tuple[int, int],
    sums: NDArray[np.int16],
    flags: Flags,
    jumped: Flags,
    changed: Flags,
) -> None:
    """Set which pixels (height, width) have a channel that differs from the image before by more than limits.

    They jumped if their own difference exceeds the first limit, and changed if that of the sum over the 3 x 3 pixels
    about them exceeds the second. Beyond the border the image goes on as at it. `sums` (3 * width + 6,) and `flags` (3
    * width,) are room for a row.
    """
    height, width = changed.shape
    values = 3 * width
    for row in range(height):
        for i in range(values):
            flags[i] = _distance(lines[row, i], before[row, i]) > np.uint8(limits[0])
        _put_any_channel(flags, jumped[row])
        above = max(row - 1, 0)
        below = min(row + 1, height - 1)
        for i in range(values):
            now = np.int16(lines[above, i]) + lines[row, i] + lines[below, i]
            sums[3 + i] = now - before[above, i] - before[row, i] - before[below, i]
        for i in range(3):
            sums[i] = sums[3 + i]
            sums[values + 3 + i] = sums[values + i]
        for i in range(values):
            flags[i] = np.int16(abs(np.int16(sums[i] + sums[3 + i] + sums[6 + i]))) > np.int16(limits[1])
        _put_any_channel(flags, changed[row])


@kernel
def _distance(level: int, other: int) -> np.uint8:
    """Return how far two grey levels are apart; of few bits, so that the compiler takes many at a time."""
    return np.uint8(max(level, other) - min(level, other))


@kernel
def _put_any_channel(flags: Flags, pixels: Flags) -> None:
    """Set the pixels (width,) of which any channel of flags (3 * width,) is set."""
    for column in range(len(pixels)):
        pixels[column] = flags[3 * column] | flags[3 * column + 1] | flags[3 * column + 2]


def _is_brighter_or_darker(change: NDArray[np.int16]) -> bool:
    """Return true if nearly all pixels (N, 3) have changed in one direction, in the colour that has changed most."""
    total = np.abs(change).sum(axis=0)
    return bool(abs(change.sum(axis=0)[total.argmax()]) > _MARK.one_way * total.max())
