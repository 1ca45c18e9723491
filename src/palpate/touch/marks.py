"""Marks on the gel: grains, dents and scratches, which come from one image to the next, are thin or small, and stay.

They are taken into the untouched gel as soon as they appear, in a contact as well, so that touch is read beside and
under them. A touch is wider, as the gel spreads it, and what it changes over a small area is smooth or moves. A mark
that goes again leaves in the same way.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Flags, Image, Levels
from palpate.compiled import compiled
from palpate.config import CONTACT_DETECTION
from palpate.touch.cells import cell_width
from palpate.touch.neighbours import largest_near, least_near, spots_of

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
    jumps = 2 * _jumps_in_every_other_row(_lines(image), _lines(before), _MARK.jump)
    if not _MARK.least_jumps <= jumps <= _MARK.most_moved * image.size:
        return None  # at once, as for most images
    change = image.astype(np.int16) - before
    jumped = _are_above(_MARK.jump, change)
    changed = _are_above(9 * EDGE, _sum_of_nine(change))
    cell = cell_width(*changed.shape)
    width = round(_MARK.thin * cell)
    inside_wide = least_near(changed, width)
    wide = largest_near(inside_wide[::-1, ::-1], width)[::-1, ::-1]  # turned, as an even width is off by half a pixel
    if np.count_nonzero(wide) > _MARK.most_moved * wide.size:
        return None
    spots = spots_of(changed)
    count = len(spots.area)
    jumps_of = np.bincount(spots.spot_of[jumped], minlength=count)
    are_thin = np.bincount(spots.spot_of[wide], minlength=count) == 0
    are_small = (spots.extent <= _MARK.small * cell).all(axis=1)
    are_sharp = (jumps_of >= _MARK.least_jumps) & (jumps_of > _MARK.sharp * spots.area)
    are_sharp[0] = False  # all that has not changed
    marks = np.zeros_like(changed)
    for spot in np.flatnonzero(are_sharp & (are_thin | are_small)):
        inside = spots.spot_of == spot
        around = largest_near(inside, 2 * round(cell) + 1) & changed
        if _is_brighter_or_darker(change[around]):
            marks |= inside
    return largest_near(marks, 3) if marks.any() else None


def with_marks(mean: Levels, marks: Flags, image: Image, before: Image) -> Levels:
    """Return the untouched gel (height, width, 3) with marks as they appear from one image to the next."""
    marked = mean.copy()
    marked[marks] += image[marks].astype(np.float32) - before[marks]
    return np.clip(marked, 0.0, 255.0)


def _lines(image: Image) -> Image:
    """Return the rows of an image (height, 3 * width) in one piece of memory."""
    return np.ascontiguousarray(image).reshape(len(image), -1)


@compiled(np.zeros((1, 1), np.uint8), np.zeros((1, 1), np.uint8), 0)
def _jumps_in_every_other_row(lines: Image, before: Image, jump: int) -> int:
    """Return the number of values that have changed by more than a jump [grey levels]."""
    count = 0
    for row in range(0, lines.shape[0], 2):
        for i in range(lines.shape[1]):
            count += max(lines[row, i], before[row, i]) - min(lines[row, i], before[row, i]) > jump
    return count


def _is_brighter_or_darker(change: NDArray[np.int16]) -> bool:
    """Return true if nearly all pixels (N, 3) have changed in one direction, in the colour that has changed most."""
    total = np.abs(change).sum(axis=0)
    return bool(abs(change.sum(axis=0)[total.argmax()]) > _MARK.one_way * total.max())


def _are_above(limit: int, change: NDArray[np.int16]) -> Flags:
    """Return true for pixels (height, width) with a channel that has changed by more than a limit."""
    are_above = np.abs(change) > limit
    return are_above[..., 0] | are_above[..., 1] | are_above[..., 2]


def _sum_of_nine(levels: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return the sum (height, width, 3) over the 3 x 3 pixels about each."""
    padded = np.pad(levels, ((1, 1), (1, 1), (0, 0)), mode="edge")
    of_rows = padded[:-2] + padded[1:-1] + padded[2:]
    return of_rows[:, :-2] + of_rows[:, 1:-1] + of_rows[:, 2:]
