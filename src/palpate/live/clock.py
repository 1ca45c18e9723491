"""The time that images, poses and estimates of a live session share."""

import time


class Clock:
    """Goes on from a time [s] evenly, whatever is done to the clock of the computer."""

    def __init__(self, start: float) -> None:
        """Begin at `start` [s], now."""
        self._offset = start - time.monotonic()

    def now(self) -> float:
        """The time [s]."""
        return time.monotonic() + self._offset
