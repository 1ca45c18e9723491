"""Whether the sensor touches the object since before it was known how the gel looks untouched.

It was at the object while the first images came, which count as untouched, and went on into it before a touch was felt.
"""

_REASON = "in contact before it was known how the gel looks untouched: touch tells nothing until the sensor lets go"
_NEAR = 3.0  # [standard deviations] of the gap to the object below which a sensor may touch it
_IN = 5e-3  # [m] in the object, from which it does: mounting and outline may be off by some millimetres


class UnfeltTouch:
    """Follows one stream until it is known that its first images showed no touch."""

    def __init__(self, is_doubtful: bool) -> None:
        """Take whether the first images may show a touch."""
        self.is_doubtful = is_doubtful
        """Whether they may still."""
        self._was_near = False  # whether the sensor was at the object before the gel was known
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
            self._was_near |= length < _NEAR * deviation
        elif felt or not self._was_near:
            self.is_doubtful = False
        return self.is_doubtful and length < -max(deviation, _IN)

    def end(self) -> None:
        """The sensor lets go, and how the gel looks untouched is learnt anew."""
        self.is_doubtful = self.now = False
