"""Half seconds in which the gel looks the same."""

import numpy as np

from palpate.touch.background import Background, Image, UntouchedImages
from palpate.touch.light import Levels, cells_of, share_unlike

FIRST_SECONDS, FEWEST = 0.5, 8
"""Time of frames that are taken as untouched where no background is given [s], and the fewest frames that will do."""
UNLIKE = np.float32(8.0)
"""[grey levels] between cells of frames that are not of one gel at rest."""
_MOVED = 0.01  # share of values so far off from which on something moves on the gel
_DARK = 5.0  # [grey levels] in the mean of an image before the light or the camera is on


def first_frames(rate: float) -> int:
    """Return how many frames are half a second at a rate [Hz]; never few."""
    return max(round(FIRST_SECONDS * rate), FEWEST)


def is_dark(image: Image | Levels) -> bool:
    """Whether the light or the camera is not on yet."""
    return float(image.mean()) < _DARK


class SteadyImages:
    """Gathers images until half a second of them, one after the other, are alike and not black."""

    def __init__(self, rate: float) -> None:
        """Take how many images come in a second [Hz]."""
        self._enough = first_frames(rate)
        self.forget()

    @property
    def is_empty(self) -> bool:
        """Whether the next image is the first."""
        return not self._seen.count

    def forget(self) -> None:
        """Begin anew with the next image."""
        self._seen = UntouchedImages()
        self._cells: Levels | None = None  # of the first

    def add(self, image: Image) -> Background | None:
        """Take the next image (height, width, 3); return what they look like once there are enough, and begin anew."""
        if is_dark(image):
            return None
        cells = cells_of(image)
        if self._cells is None or share_unlike(cells, self._cells, UNLIKE) > _MOVED:
            # Something moves, or the light is not yet what it will be.
            self.forget()
            self._cells = cells
        self._seen.add(image)
        if self._seen.count < self._enough:
            return None
        found = self._seen.background()
        self.forget()
        return found
