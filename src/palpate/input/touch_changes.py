"""Changes of a touch while the sensor's pose stands: they tell a robot that waits from a pose stream that is frozen.

While a sensor pushes on, the imprint moves and turns in its image, unless the contact sticks and nothing turns. When it
stops, the gel relaxes within a few frames, and then the image stays.
"""

from collections import deque

import numpy as np

from palpate.arrays import Levels
from palpate.config import CONTACT_DETECTION
from palpate.touch.background import Background, first_frames
from palpate.touch.cells import compare

_SHOWS_MOTION = 2.0 * CONTACT_DETECTION.start
"""Share of an image's values that change in half a second of motion, from which a touch shows that the sensor moves:
twice that of the smallest touch, which is what has to change while the pose stands."""


class TouchChanges:
    """The last second of images of one contact."""

    def __init__(self, rate: float) -> None:
        """Take the sensor's frame rate [Hz]."""
        self._window = first_frames(rate)  # half a second
        self._cells: deque[Levels] = deque(maxlen=2 * self._window)
        self._noise = np.zeros(1, np.float32)  # [grey levels] of each value of an image
        self._moving = 0.0  # change in half a second before the pose stood

    def add(self, cells: Levels, untouched: Background) -> None:
        """Add the cells of the image of another frame of the contact."""
        self._cells.append(cells)
        self._noise = untouched.noise

    def clear(self) -> None:
        """Forget the contact, as it is over or has no images."""
        self._cells.clear()
        self._moving = 0.0

    def go_on(self, stood: int, settles: int) -> bool | None:
        """Return True if the touch goes on changing while the pose stands, for the last `stood` frames.

        The first `settles` of them are left for the gel to relax. None if touch does not tell, as it did not change
        before either.
        """
        if stood == settles:
            self._moving = self._change(stood + self._window, stood)
        if self._change(min(stood - settles, self._window), 0) > CONTACT_DETECTION.start:
            return True
        return False if self._moving > _SHOWS_MOTION else None

    def _change(self, first: int, last: int) -> float:
        """Return the share of values that changed from one image to another, so many before the newest."""
        if not last < first < len(self._cells):
            return 0.0
        of_difference = np.sqrt(2.0) * np.maximum(self._noise, CONTACT_DETECTION.least_deviation)
        tolerance = np.asarray(CONTACT_DETECTION.significant * of_difference, np.float32)
        return compare(self._cells[-1 - last], self._cells[-1 - first], tolerance)[0]
