"""What the tracker asks of a smoother."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.graph.factors import ContactModel, touching
from palpate.graph.noise import GraphNoise
from palpate.graph.pushing import ANGLE_STEPS, pushing, pushing_angle
from palpate.recording.measurements import Feeling

Array = NDArray[np.float64]
SmootherName = Literal["fixed-lag", "isam2", "batch", "particle-filter"]
OFFSET_SIGMA = 10.0
"""Standard deviation of the offset of all turns of a contact before the first one [rad]: three times pi says nothing of
an angle, and the system is determined without a turn."""


LASTING = 6
"""Unknowns that last from contact to contact: the bias of directions [rad], the depth of contacts [m] and friction."""
DEPTH = 1
"""Which of them is the depth."""
FRICTION = slice(2, 6)
"""Those of friction among them; see `pushing.pushing`."""


@dataclass(frozen=True)
class Known:
    """What is known of the object when a contact begins."""

    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    lasting: Array
    """(LASTING,)"""
    covariance: Array
    """Joint covariance of both, (3 + LASTING, 3 + LASTING); of the pose in the tangent space there (right, body frame).
    """

    def loosened(self, covariance: Array) -> "Known":
        """The same with the pose less certain by a covariance (3, 3)."""
        joint = self.covariance.copy()
        joint[:3, :3] += covariance
        return replace(self, covariance=joint)


@dataclass(frozen=True)
class Belief:
    """What the graph says about its last step."""

    g: Array
    """Sensor pose in the object frame, (3,) [m, m, rad]."""
    e: Array
    """Sensor pose in the world, (3,) [m, m, rad]."""
    lasting: Array
    """(LASTING,)"""
    covariance: Array
    """Joint covariance (6 + LASTING, 6 + LASTING) of g, e, each in the tangent space at its estimate (right, body
    frame), and what lasts."""

    @property
    def known(self) -> Known:
        """What it says of the object."""
        # o = e g^-1: o moves by Ad_g (d_e - d_g)
        by_g = se2.adjoint(self.g)
        by_all = np.zeros((3 + LASTING, 6 + LASTING))
        by_all[:3, :3], by_all[:3, 3:6], by_all[3:, 6:] = -by_g, by_g, np.eye(LASTING)
        covariance = by_all @ self.covariance @ by_all.T
        pose = se2.compose(self.e, se2.inverse(self.g))
        return Known(pose, self.lasting, 0.5 * (covariance + covariance.T))


class Smoother(Protocol):
    """The graph of one contact after the other.

    A step that cannot be solved raises EstimationError; a direction or turn for a sensor with several tips raises
    SettingError.
    """

    def begin(self, sensor_pose: Array, known: Known, feeling: Feeling) -> None:
        """Start the graph of a new contact.

        It takes the measured sensor pose (3,), what is known of the object and what touch says, which at a first step
        cannot be relative.
        """
        ...

    def add(self, sensor_pose: Array, feeling: Feeling) -> None:
        """Add a step: the measured sensor pose (3,) and what touch says."""
        ...

    def belief(self) -> Belief:
        """Return the estimate at the last step."""
        ...

    def pushing_error(self) -> Array:
        """Return the pushing residual of the last step (4,) in standard deviations, that of the tip worst off."""
        ...

    def path(self) -> tuple[Array, Array]:
        """Return all steps of this contact as smoothed so far: g (N, 3) and e (N, 3)."""
        ...


def last_pushing_error(
    g: Array, e: Array, lasting: Array, moved: float, tips: Sequence[ContactModel], noise: GraphNoise
) -> Array:
    """Pushing residual (4,) in standard deviations between the last two of the steps (N, 3), of the tip worst off."""
    if len(g) < 2:
        return np.zeros(4)
    friction, last = lasting[FRICTION], np.array([moved])
    g, e = g[-ANGLE_STEPS - 1 :], e[-ANGLE_STEPS - 1 :]  # as far back as the angle of the last step looks
    errors = []
    for tip in tips:
        touch = touching(g, tip)
        angle = pushing_angle(g, e, touch, tip, friction)[-1:]
        residual, _ = pushing(g[-2:-1], e[-2:-1], g[-1:], e[-1:], touch[-1:], tip, friction, np.sign(angle))
        weight = noise.pushing_weight(np.zeros((1, 4)), last, tip, angle, friction[-1])
        errors.append(residual[0] * np.sqrt(weight[0]))
    return np.abs(errors).max(axis=0)


def continued(g: Array) -> Array:
    """Guess the next pose (3,) after the last one or two (N, 3): the sensor goes on turning on the object as it did."""
    return se2.compose(g[-1], se2.between(g[0], g[-1]))


def check_tips(feeling: Feeling, tips: Sequence[ContactModel]) -> None:
    """Raise SettingError where touch says of one tip what nothing assigns to one of several."""
    if len(tips) > 1 and (feeling.direction is not None or feeling.turn is not None):
        raise SettingError(f"the sensor has {len(tips)} tips; touch can say direction and turn for one tip only")
