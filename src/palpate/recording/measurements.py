"""What touch can say about one frame: made by `palpate.touch`, taken by `palpate.graph`."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError


@dataclass(frozen=True)
class RelativePoses:
    """Sensor-in-object poses of the current frame as seen from P earlier frames of the same contact (paper Eq. 6)."""

    back: NDArray[np.int_]
    """How many frames ago the earlier frame was, (P,) int, at least 1."""
    pose: NDArray[np.float64]
    """`g_earlier^-1 g_now`, (P, 3) [m, m, rad]."""
    covariance: NDArray[np.float64]
    """(P, 3, 3), in the tangent space at the pose, order x, y, theta; large in x and y where only yaw is told."""


@dataclass(frozen=True)
class ContactDirection:
    """Where on its round surface the tip is touched: along the outline's inward normal at the touched point.

    It is absolute, so it does not drift: yaw on a straight edge, the place along a round one. Raises EstimationError
    on an angle or variance that cannot be used.
    """

    angle: float
    """Seen from the tip's centre of curvature in the sensor frame [rad]: 0 at the apex (+x), positive towards +y."""
    variance: float
    """[rad^2]"""

    def __post_init__(self) -> None:
        _check("contact direction", self.angle, self.variance)


@dataclass(frozen=True)
class Turn:
    """Yaw of the sensor in the object frame, up to an offset that is unknown and the same for the whole contact.

    Raises EstimationError on an angle or variance that cannot be used.
    """

    angle: float
    """The yaw of g less the offset [rad]."""
    variance: float
    """[rad^2]"""

    def __post_init__(self) -> None:
        _check("turn", self.angle, self.variance)


@dataclass(frozen=True)
class Feeling:
    """All that touch says of one frame; an empty one says nothing."""

    relative: RelativePoses | None = None
    """Against earlier frames of this contact; None at its first."""
    direction: ContactDirection | None = None
    """Where the tip is touched."""
    turn: Turn | None = None
    """How the sensor has turned on the object in this contact."""


def _check(what: str, angle: float, variance: float) -> None:
    if not (math.isfinite(angle) and 0.0 < variance < math.inf):
        raise EstimationError(
            f"{what} has angle {angle!r} and variance {variance!r}; they must be finite, the variance above 0"
        )
