"""What measured poses of the object contradict: what is known of it without them, or where the sensor touches it.

One frame may err, and a hand may move an object once. Where several of the last frames contradict by far more than
their standard deviations, either the measured pose or the estimate is wrong, and nobody knows which.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.graph.factors.factor import Step
from palpate.types.measurements import ObjectPose

Array = NDArray[np.float64]
_BEYOND = 5.0  # standard deviations of what is compared from which it contradicts
_FRAMES, _SEVERAL = 10, 3  # of so many of the last frames so many make it more than an error


@dataclass(frozen=True)
class Contradiction:
    """How far one thing contradicted another at the last frames at which they were compared."""

    apart: tuple[float, ...] = ()
    """Of each of these frames, the last one last [m]; 0 where both agree."""
    said: str = ""
    """The last one at which they do not, in words."""

    def compared(self, apart: float, deviations: float, said: str) -> "Contradiction":
        """Return the same after one more frame: so far apart [m], so many standard deviations, and that in words."""
        apart, said = (apart, said) if deviations > _BEYOND else (0.0, self.said)
        return Contradiction((*self.apart, apart)[-_FRAMES:], said)

    @property
    def doubt(self) -> float:
        """How far the object may be off for it [m]; 0 where too few of the last frames contradict."""
        return max(self.apart) if sum(one > 0.0 for one in self.apart) >= _SEVERAL else 0.0


def measured_poses(step: Step, thought: Sequence[Array]) -> list[tuple[Array, ObjectPose]]:
    """Return all that is measured of the object's pose at a step, each with where it was thought to be then (3,).

    It is given where it was thought to be (3,) at each of the step's times.
    """
    measured = [one for one in step.measurements if isinstance(one, ObjectPose) and step.is_at_hand(one)]
    places = step.places_of(measured)[:, 0] - 1
    return [(thought[place], one) for place, one in zip(places, measured, strict=True)]
