"""What the tracker asks of a smoother."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate import se2
from palpate.errors import SettingError
from palpate.graph import factors
from palpate.graph.factors import ContactModel
from palpate.graph.noise import GraphNoise
from palpate.measurement import Feeling

Array = NDArray[np.float64]
SmootherName = Literal["fixed-lag", "isam2"]
OFFSET_SIGMA = 10.0
"""Standard deviation of the offset of all turns of a contact before the first one [rad]: three times pi says nothing of
an angle, and the system is determined without a turn."""


@dataclass(frozen=True)
class Belief:
    """What the graph says about its last step."""

    g: Array
    """Sensor pose in the object frame, (3,) [m, m, rad]."""
    e: Array
    """Sensor pose in the world, (3,) [m, m, rad]."""
    covariance: Array
    """Joint covariance (6, 6) of g and e, each in the tangent space at its estimate (right, body frame)."""


class Smoother(Protocol):
    """The graph of one contact after the other.

    A step that cannot be solved raises EstimationError; a direction or turn for a sensor with several tips raises
    SettingError.
    """

    def begin(self, sensor_pose: Array, object_pose: Array, covariance: Array, feeling: Feeling) -> None:
        """Start the graph of a new contact.

        It takes the measured sensor pose (3,), the object pose (3,), its covariance (3, 3) and what touch says, which
        at a first step cannot be relative.
        """
        ...

    def add(self, sensor_pose: Array, feeling: Feeling) -> None:
        """Add a step: the measured sensor pose (3,) and what touch says."""
        ...

    def belief(self) -> Belief:
        """Return the estimate at the last step."""
        ...

    def pushing_error(self) -> Array:
        """Return the pushing residual of the last step (3,) in standard deviations, that of the tip worst off."""
        ...

    def path(self) -> tuple[Array, Array]:
        """Return all steps of this contact as smoothed so far: g (N, 3) and e (N, 3)."""
        ...


def last_pushing_error(g: Array, e: Array, moved: float, tips: Sequence[ContactModel], noise: GraphNoise) -> Array:
    """Pushing residual (3,) in standard deviations between the last two of the steps (N, 3), of the tip worst off."""
    if len(g) < 2:
        return np.zeros(3)
    errors = [
        factors.pushing(g[-2], e[-2], g[-1], e[-1], tip)[0] / noise.pushing_sigmas(np.asarray(moved), tip)
        for tip in tips
    ]
    return np.abs(errors).max(axis=0)


def continued(g: Array) -> Array:
    """Guess the next pose (3,) after the last one or two (N, 3): the sensor goes on turning on the object as it did."""
    return se2.compose(g[-1], se2.between(g[0], g[-1]))


def check_tips(feeling: Feeling, tips: Sequence[ContactModel]) -> None:
    """Raise SettingError where touch says of one tip what nothing assigns to one of several."""
    if len(tips) > 1 and (feeling.direction is not None or feeling.turn is not None):
        raise SettingError(f"the sensor has {len(tips)} tips; touch can say direction and turn for one tip only")
