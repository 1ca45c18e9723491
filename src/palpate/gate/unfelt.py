"""Whether the sensor touches the object since before it was known how the gel looks untouched.

It was at the object while the first images came, which count as untouched, and went on into it before a touch was felt.
"""

from collections import deque

from palpate.touch.steady import first_frames

_REASON = "in contact before it was known how the gel looks untouched: touch tells nothing until the sensor lets go"
_NEAR = 3.0  # [standard deviations] of the gap to the object below which a sensor may touch it
_IN = 5e-3  # [m] in the object, from which it does: mounting and outline may be off by some millimetres


class UnfeltTouch:
    """Follows one stream until it is known that its first images showed no touch."""

    def __init__(self, is_doubtful: bool, rate: float) -> None:
        """Take whether the first images may show a touch, and how many come in a second [Hz]."""
        self.is_doubtful = is_doubtful
        """Whether they may still."""
        # Whether the sensor was at the object at each of the images that are taken as untouched, but for the last one.
        self._near: deque[bool] = deque(maxlen=first_frames(rate) - 1)
        self.now = False
        """Whether the object is touched so at the last frame that was taken."""

    @property
    def reason(self) -> str:
        """What is said of such a touch, nothing where there is none."""
        return _REASON if self.now else ""

    def sees(self, gap: tuple[float, float], felt: bool, is_gel_known: bool) -> bool:
        """Return whether the object is touched so; gap is how far off the sensor is, and the deviation of that [m]."""
        if self.now:
            return True
        length, deviation = gap
        if not is_gel_known:
            self._near.append(length < _NEAR * deviation)
        elif felt or not all(self._near):  # on its way to the object it touched nothing
            self.is_doubtful = False
        return self.is_doubtful and length < -max(deviation, _IN)

    def end(self) -> None:
        """The sensor lets go, and how the gel looks untouched is learnt anew."""
        self.is_doubtful = self.now = False
