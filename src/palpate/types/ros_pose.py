"""A pose in the plane and its covariance as ROS messages have them. ROS need not be installed."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class RosPose(NamedTuple):
    """A pose in space as ROS messages have it."""

    position: Array
    """x, y, z (3,) [m]."""
    orientation: Array
    """Quaternion x, y, z, w (4,)."""
    covariance: Array
    """(36,), row by row: about the axes of the header's frame, order x, y, z [m], turns about x, y, z [rad]."""


def ros_pose(pose: Array, covariance: Array) -> RosPose:
    """Return a pose in the plane z = 0 of the world, with its covariance about the world's axes.

    From the pose (3,) [m, m, rad] and its covariance (3, 3), tangent space at the pose (right, body frame). What leaves
    the plane, z and the turns about x and y, has variances of 0.
    """
    from palpate.types.plane import flat, out_of_plane, spatial_covariance

    plane = flat()
    (position,), (orientation,) = out_of_plane(plane, pose[None])
    return RosPose(position, orientation, spatial_covariance(plane, pose[None], covariance[None]).reshape(36))
