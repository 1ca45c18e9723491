"""Turn: touch measures the sensor's yaw in the object frame, up to an offset that is constant within a contact."""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar, wrap
from palpate.models.pushing.direction import variance
from palpate.types.measurements import Turn


def residual(now: Any, measured: Any, turn_offset: Scalar) -> tuple[Scalar]:
    """Return `theta - offset - angle` [rad], wrapped, with theta the yaw of g."""
    return (wrap(now.g.angle - turn_offset - measured.sign * measured.angle),)


TURN = Factor("turn", residual, variance, measurement=Turn, data=("angle",), kernel="each")
