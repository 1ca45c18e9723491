"""Whether images lie turned by half a turn or mirrored, which nothing but the object can tell.

Touch is then felt on the other side of the tip's middle. So in each contact, until it is settled, a second estimator
follows that is told all of it mirrored. Of the two, the wrong one is soon contradicted by how the object is pushed.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

from palpate.errors import EstimationError
from palpate.filter.hypothesis_bank import Hypotheses
from palpate.types.frame import Frame
from palpate.types.measurements import ContactDirection, ContactPlace, Measurement, RelativePoses, Turn

logger = logging.getLogger(__name__)

_WAIT = 0.48  # [s] in which one must be contradicted and the other not: 15 frames at 30 Hz, as in `hypotheses`
_REASON = (
    "touch fits the push only with the images turned by half a turn or mirrored, so they are taken that way; confirm "
    "it with palpate calibrate --presses, for the outline may be mirrored or the first pose wrong instead"
)


class MirroredImages:
    """Follows a stream as its images are and as if they were mirrored, until one of both is contradicted."""

    def __init__(self, looks: bool) -> None:
        """Take whether to find out; otherwise images lie as they should."""
        self.is_turned = False
        self._is_settled = not looks
        self._other: Hypotheses | None = None  # is told all of this contact mirrored
        self._contradicted = (False, False)  # in this contact: what is told as it is, and mirrored
        self._since = math.inf  # [s] since when one of both is

    @property
    def reason(self) -> str:
        """What was found, in a sentence; nothing where images lie as they should, as far as is known."""
        return _REASON if self.is_turned else ""

    def believed(self, told: Sequence[Measurement]) -> Sequence[Measurement]:
        """Return what to believe of what touch tells."""
        return [mirrored(one) for one in told] if self.is_turned else told

    def see(self, estimator: Hypotheses, frame: Frame, told: Sequence[Measurement]) -> Hypotheses:
        """Take what touch tells of a frame, before the estimator does; return the one to go on with.

        That is another one, which has taken all frames so far, where images turn out to be mirrored.
        """
        if self._is_settled:
            return estimator
        if not estimator.in_contact and estimator.is_sure and any(isinstance(one, ContactDirection) for one in told):
            self._other = estimator.copied()
        other = self._other
        if other is None:
            return estimator
        if other.in_contact:
            self._compare(estimator, other, frame.time)
        if self._is_settled or not _takes(other, frame, told):
            self._other = None
        if self.is_turned:
            logger.warning("frame at %.3f s: %s", frame.time, _REASON)
        return other if self.is_turned else estimator

    def end_contact(self) -> None:
        """Forget this contact: the next frame begins another."""
        self._other, self._contradicted, self._since = None, (False, False), math.inf

    def _compare(self, as_told: Hypotheses, other: Hypotheses, time: float) -> None:
        """Settle it where one was contradicted and the other is not for a while, or both were.

        What is mirrored must leave nothing in doubt then: where several answers are needed there, too, it is something
        else that is wrong.
        """
        before = self._contradicted
        self._contradicted = before[0] or as_told.is_contradicted, before[1] or other.is_contradicted
        if any(self._contradicted):
            self._since = min(self._since, time)
        if all(self._contradicted):
            self._is_settled = True
        elif time - self._since > _WAIT and (other.is_sure or self._contradicted[1]):
            self._is_settled, self.is_turned = True, self._contradicted[0]


def _takes(other: Hypotheses, frame: Frame, told: Sequence[Measurement]) -> bool:
    """Tell an estimator all of a frame mirrored; return whether the object may be where it is thought to be then."""
    try:
        other.touch(frame.sensor_pose, (*(mirrored(one) for one in told), *frame.measurements), frame.time)
    except EstimationError:
        return False
    return not other.is_displaced


def mirrored(said: Measurement) -> Measurement:
    """Return what touch would tell if the image lay turned by half a turn."""
    if isinstance(said, ContactDirection | Turn):
        return replace(said, angle=-said.angle)
    if isinstance(said, ContactPlace):
        return replace(said, place=-said.place)
    if isinstance(said, RelativePoses):
        return replace(said, pose=said.pose * (1.0, -1.0, -1.0))
    return said
