"""Decision whether touch images lie turned by half a turn or mirrored, which only the object can show.

Touch then measures the other side of the tip. Until this is decided, each contact has a second group of hypotheses that
takes all of touch with the opposite sign. Of the two groups the wrong one is soon contradicted by how the object moves.
"""

import math

_WAIT = 0.48  # [s] for which one group is contradicted and the other is not: 15 frames at 30 Hz
MIRRORED = (
    "touch fits the push only with the images turned by half a turn or mirrored, so they are taken that way; confirm "
    "it with palpate calibrate --presses, for the outline may be mirrored or the first pose wrong instead"
)
"""Sentence for users whose images are mirrored."""


class MirroredImages:
    """State of the decision."""

    def __init__(self, is_open: bool) -> None:
        self.is_open = is_open
        """True until it is decided."""
        self.is_mirrored = False
        """The decision."""
        self.end_contact()

    def end_contact(self) -> None:
        """Forget a contact that is over."""
        self._contradicted = False, False  # in this contact: images as they are, and mirrored
        self._since = math.inf  # [s] time of the first contradiction

    def decide(self, contradicted: tuple[bool, bool], is_mirrored_sure: bool, time: float) -> None:
        """Decide if one group is contradicted and the other is not for a while, or if both are.

        `contradicted` is that of images as they are and mirrored. The mirrored group must be sure of its pose: if it
        needs several hypotheses, something else is wrong.
        """
        before = self._contradicted
        as_is, mirrored = self._contradicted = before[0] or contradicted[0], before[1] or contradicted[1]
        if as_is or mirrored:
            self._since = min(self._since, time)
        if as_is and mirrored:
            self.is_open = False
        elif time - self._since > _WAIT and (is_mirrored_sure or mirrored):
            self.is_open, self.is_mirrored = False, as_is
