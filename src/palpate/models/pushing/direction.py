"""Contact direction: touch measures the direction in which a round tip is touched.

The true direction psi points from the tip's centre to the nearest outline point, opposite to the outward normal there,
seen in the sensor frame. It is absolute and does not drift: it determines yaw on a straight edge, and the place on a
round one.
"""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar, bearing, larger, sin, wrap
from palpate.types.measurements import ContactDirection


def residual(now: Any, measured: Any, direction_bias: Scalar, direction_scale: Scalar) -> tuple[Scalar]:
    """Return `psi + scale sin(psi) + bias - angle` [rad], wrapped.

    The scale multiplies the prediction and not the measured angle, whose noise would look like a scale; and the sine,
    since psi jumps behind the tip.
    """
    inward = now.g.rotate_back(-now.touch.normal)
    psi = bearing(inward.x, inward.y)
    return (wrap(psi + direction_scale * sin(psi) + direction_bias - measured.sign * measured.angle),)


def variance(measured: Any, noise: Any) -> tuple[Scalar]:
    """Return the variance, which is no less than that of the contact model."""
    return (larger(measured.variance, noise.floor**2) * noise.share,)


DIRECTION = Factor("direction", residual, variance, measurement=ContactDirection, data=("angle",), kernel="each")
