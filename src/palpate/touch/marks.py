"""Marks on the gel: grains, dents and scratches, which come from one image to the next, are thin or small, and stay.

They are taken into the untouched gel as soon as they appear, in a contact as well, so that touch is read beside and
under them. A touch is wider, as the gel spreads it, and what it changes over a small area is smooth or moves. A mark
that goes again leaves in the same way.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Image, Levels
from palpate.config import CONTACT_DETECTION
from palpate.touch.cells import cell_width

JUMP = 16
"""Change of a pixel from one image to the next [grey levels] that a mark makes and noise does not."""
LEAST_JUMPS = 6
"""Pixels of a mark with such a change; fewer are noise."""
SHARP = 0.2
"""Share of a mark's pixels with such a change. What a touch changes over so small an area has fewer, as the gel smooths
it; with a share of 0 touches that slide are taken for marks."""
ONE_WAY = 0.8
"""Share of the change of a mark, and of what has changed within a cell of it, that is left in the mean: a mark is
brighter or darker all over. The imprint of a corner is as thin, but where it comes to is beside where it was."""
EDGE = round(CONTACT_DETECTION.significant * CONTACT_DETECTION.least_deviation)
"""Change [grey levels], in the mean over 3 x 3 pixels, from which a pixel belongs to a mark."""
THIN = 1.0
"""Width of a scratch [cells], half a millimetre on a DIGIT, that none exceeds."""
SMALL = 2.0
"""Width and height of a grain [cells] that none exceeds."""
MOST_MOVED = 0.04
"""Share of an image that changes more widely while a touch slides; where one begins or ends within one image, 0.07 to
0.7 of real ones do, and what is small may be of it."""

Mask = NDArray[np.bool_]


def new_marks(image: Image, before: Image) -> Mask | None:
    """Return the pixels (height, width) of marks in an image (height, width, 3) that are not in the one before.

    None if there are none, or if a touch begins, ends or jumps, so that what is small may be of it.
    """
    import cv2

    every_other_row = cv2.absdiff(image[::2], before[::2]).reshape(-1, 3 * image.shape[1])
    jumps = 2 * cv2.countNonZero(cv2.threshold(every_other_row, JUMP, 1, cv2.THRESH_BINARY)[1])
    if not LEAST_JUMPS <= jumps <= MOST_MOVED * image.size:
        return None  # at once, as for most images
    jumped = _are_above(JUMP, cv2.absdiff(image, before))
    changed = _are_above(EDGE, cv2.absdiff(cv2.blur(image, (3, 3)), cv2.blur(before, (3, 3))))
    cell = cell_width(*changed.shape)
    square = np.ones((round(THIN * cell),) * 2, np.uint8)
    wide = np.asarray(cv2.morphologyEx(changed, cv2.MORPH_OPEN, square))
    if cv2.countNonZero(wide) > MOST_MOVED * wide.size:
        return None
    count, spot_of, stats, _ = cv2.connectedComponentsWithStats(changed)
    jumps_of = np.bincount(spot_of[jumped > 0], minlength=count)
    are_thin = np.bincount(spot_of[wide > 0], minlength=count) == 0
    are_small = (stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]] <= SMALL * cell).all(axis=1)
    are_sharp = (jumps_of >= LEAST_JUMPS) & (jumps_of > SHARP * stats[:, cv2.CC_STAT_AREA])
    are_sharp[0] = False  # all that has not changed
    marks = np.zeros_like(changed)
    reach = np.ones((2 * round(cell) + 1,) * 2, np.uint8)
    for spot in np.flatnonzero(are_sharp & (are_thin | are_small)):
        inside = (spot_of == spot).astype(np.uint8)
        around = (np.asarray(cv2.dilate(inside, reach), np.uint8) & changed) > 0
        if _is_brighter_or_darker(image[around].astype(np.int32) - before[around]):
            marks |= inside
    return np.asarray(cv2.dilate(marks, np.ones((3, 3), np.uint8))) > 0 if marks.any() else None


def with_marks(mean: Levels, marks: Mask, image: Image, before: Image) -> Levels:
    """Return the untouched gel (height, width, 3) with marks as they appear from one image to the next."""
    marked = mean.copy()
    marked[marks] += image[marks].astype(np.float32) - before[marks]
    return np.clip(marked, 0.0, 255.0)


def _is_brighter_or_darker(change: NDArray[np.int32]) -> bool:
    """Return true if nearly all pixels (N, 3) have changed in one direction, in the colour that has changed most."""
    total = np.abs(change).sum(axis=0)
    return bool(abs(change.sum(axis=0)[total.argmax()]) > ONE_WAY * total.max())


def _are_above(limit: int, levels: Any) -> NDArray[np.uint8]:
    """Return 1 for pixels (height, width) with a channel above a limit, 0 for others."""
    import cv2

    red, green, blue = cv2.split(levels)
    largest = cv2.max(cv2.max(red, green), blue)
    return np.asarray(cv2.threshold(largest, limit, 1, cv2.THRESH_BINARY)[1], np.uint8)
