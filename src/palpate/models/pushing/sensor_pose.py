"""Measured sensor pose (paper Eq. 12)."""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar


def residual(now: Any) -> tuple[Scalar, ...]:
    """Return `Log(measured^-1 e)` [m, m, rad]."""
    return now.measured.between(now.e).log()


def variance(noise: Any) -> tuple[Scalar, ...]:
    """Return the variances of a robot's kinematics or motion capture."""
    return tuple(deviation**2 for deviation in noise.deviation)


def applies(now: Any) -> Any:
    """Return True while the sensor touches: between contacts the object stands in its place."""
    return now.is_resting < 0.5


SENSOR_POSE = Factor("sensor_pose", residual, variance, steps="every", applies=applies)
