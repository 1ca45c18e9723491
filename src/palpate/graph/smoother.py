"""What the tracker asks of a smoother."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate import se2
from palpate.graph import factors
from palpate.graph.factors import ContactModel
from palpate.graph.noise import GraphNoise
from palpate.measurement import RelativePoses

Array = NDArray[np.float64]
SmootherName = Literal["fixed-lag", "isam2"]


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
    """The graph of one contact after the other. A step that cannot be solved raises EstimationError."""

    def begin(self, sensor_pose: Array, object_pose: Array, covariance: Array) -> None:
        """Start the graph of a new contact: measured sensor pose (3,), object pose (3,) and its covariance (3, 3)."""
        ...

    def add(self, sensor_pose: Array, relative: RelativePoses | None) -> None:
        """Add a step: the measured sensor pose (3,) and what touch says of earlier steps of this contact."""
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
