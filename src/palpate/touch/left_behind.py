"""What a touch that has ended leaves behind: light that drifted meanwhile, a mark, a gel that comes back slowly."""

from collections import deque

import numpy as np

from palpate.touch.light import Levels, share_unlike
from palpate.touch.steady import first_frames

_PART = 0.08  # of the most that showed of the touch within half a second, above which it may go on
_MOST = 0.02  # share of significant values above which a touch may go on, however much of it showed before
_ENOUGH = 5  # images in a row: a touch that rolls over a corner shows as little for fewer


class LeftBehind:
    """Tells from one touched image after the other when nothing shows any more but what the touch has left behind.

    That is little, all of a sudden, and it stays where it is; a touch that goes on is seen to grow, to wane or to move.
    """

    def __init__(self, rate: float) -> None:
        """Take how many images come in a second [Hz]."""
        self._seen: deque[tuple[float, Levels]] = deque(maxlen=first_frames(rate))

    def add(self, share: float, cells: Levels, tolerance: Levels, enough: float) -> bool:
        """Take the next touched image; return whether the touch has ended.

        `share` is that of its values that are significantly off the untouched gel, `cells` (rows, columns, 3) are its
        own, `tolerance` is what they are off at least by then [grey levels], and `enough` the share of them that has
        to change where something moves.
        """
        self._seen.append((share, cells))
        if len(self._seen) <= _ENOUGH or share >= _MOST:
            return False
        shares = np.array([each for each, _ in self._seen])
        if shares[-_ENOUGH:].max() >= min(_PART * shares.max(), _MOST):
            return False
        return share_unlike(cells, self._seen[-_ENOUGH][1], tolerance) <= enough

    def forget(self) -> None:
        """Begin anew, for nothing touches."""
        self._seen.clear()
