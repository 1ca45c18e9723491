"""Images of the fingers of a hand, brought to one time: cameras have rates and delays of their own.

The hand is estimated at the time of the latest camera, so that no finger is ahead of another.
"""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from palpate.arrays import Image


@dataclass(frozen=True)
class _Patience:
    """Times for which the estimate of a hand waits for a finger. These are no settings."""

    slack: float = 8e-3
    """[s] by which an image may be newer than the time that is estimated: no frame lies between."""
    least_delay: float = 5e-3
    """[s] Delay of images from which the estimate waits for them."""
    most_delay: float = 0.8
    """[s] Delay of images up to which the estimate waits for them."""
    late: float = 0.1
    """[s] Delay of images from which it is named."""
    least_step: float = 1e-4
    """[s] from one time that is estimated to the next."""
    held: float = 0.15
    """[s] for which the last contact of a finger holds that gives nothing."""
    held_intervals: float = 3.0
    """The same in intervals between its images, of a slow camera."""


PATIENCE = _Patience()


class Seen(NamedTuple):
    """Contact of a finger at one time, by its image or by a flag."""

    time: float
    """[s]"""
    image: Image | None
    contact: bool | None


class ImageQueue:
    """Images and flags of one finger, until their time comes."""

    def __init__(self) -> None:
        self.delay = 0.0
        """Time of the last frame less that of the image that came with it [s]."""
        self.newest: float | None = None
        """Time of the newest image or flag [s]; None before the first."""
        self._waiting: deque[Seen] = deque()

    def is_alive(self, time: float) -> bool:
        """Return True if anything came of late, so that its delay counts at a time [s]."""
        return self.newest is not None and time - self.newest < PATIENCE.most_delay

    def add(self, seen: Seen, frame_time: float) -> None:
        """Add what came with a frame; an image of a time that came before is left out."""
        if self.newest is not None and seen.time <= self.newest:
            return
        delay = frame_time - seen.time
        self.delay = delay if delay > PATIENCE.least_delay else 0.0
        self.newest = seen.time
        self._waiting.append(seen)

    def take(self, time: float) -> Seen | None:
        """Return the newest that is of this time [s] or before; None if nothing came since the last."""
        taken = None
        while self._waiting and self._waiting[0].time <= time + PATIENCE.slack:
            taken = self._waiting.popleft()
        return taken
