"""Images of the fingers of a hand, brought to one time: cameras have rates and delays of their own.

The hand is estimated at the time of the latest camera, so that no finger is ahead of another.
"""

from collections import deque
from typing import NamedTuple

from palpate.arrays import Image

_SLACK = 8e-3
"""[s] by which an image may be newer than the time that is estimated: no frame lies between."""
_LEAST_DELAY = 5e-3
"""[s] Delay of images from which the estimate waits for them."""
MOST_DELAY = 0.8
"""[s] Delay of images up to which the estimate waits for them."""


class Seen(NamedTuple):
    """Contact of a finger at one time, by its image or by a flag."""

    time: float
    """[s]"""
    image: Image | None
    contact: bool | None


class ImageQueue:
    """What one finger has seen, until its time comes."""

    def __init__(self) -> None:
        self.delay = 0.0
        """Time of the last frame less that of the image that came with it [s]."""
        self.newest: float | None = None
        """Time of the newest image or flag [s]; None before the first."""
        self._waiting: deque[Seen] = deque()

    def is_alive(self, time: float) -> bool:
        """Return True if anything came of late, so that its delay counts at a time [s]."""
        return self.newest is not None and time - self.newest < MOST_DELAY

    def add(self, seen: Seen, frame_time: float) -> None:
        """Add what came with a frame; an image of a time that came before is left out."""
        if self.newest is not None and seen.time <= self.newest:
            return
        delay = frame_time - seen.time
        self.delay = delay if delay > _LEAST_DELAY else 0.0
        self.newest = seen.time
        self._waiting.append(seen)

    def take(self, time: float) -> Seen | None:
        """Return the newest that is of this time [s] or before; None if nothing came since the last."""
        taken = None
        while self._waiting and self._waiting[0].time <= time + _SLACK:
            taken = self._waiting.popleft()
        return taken
