"""Object pose measured by another source, such as a camera."""

import math
from typing import Any

import numpy as np

from palpate.arrays import Array
from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar
from palpate.manifolds.planar import Pose, Vector
from palpate.types.measurements import ObjectPose


def residual(now: Any, measured: Any) -> tuple[Scalar, ...]:
    """Return `Log(measured^-1 e g^-1)` [m, m, rad], which the measurement's covariance whitens."""
    known = Pose(Vector(measured.x, measured.y), measured.cos, measured.sin, measured.angle)
    world_T_object = now.e.compose(now.g.inverse())
    return known.between(world_T_object).log()


def numbers(measurement: ObjectPose) -> tuple[float, ...]:
    """Return the pose as position, cosine, sine and angle."""
    x, y, angle = measurement.pose.tolist()
    return x, y, math.cos(angle), math.sin(angle), angle


def root(measurement: ObjectPose) -> Array:
    """Return the inverse Cholesky root (3, 3) of the covariance."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(measurement.covariance)), np.float64)


OBJECT_POSE = Factor(
    "object_pose",
    residual,
    measurement=ObjectPose,
    data=("x", "y", "cos", "sin", "angle"),
    numbers=numbers,
    root=root,
)
