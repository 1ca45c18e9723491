"""An answer: one of several poses that may be the object's while touch cannot tell which."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.by_value import ByValue
from palpate.types.ros_pose import RosPose, ros_pose

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Answer(ByValue):
    """One pose that may be the object's."""

    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta."""
    weight: float
    """How likely it is among all answers, from 0 to 1."""

    def to_ros(self) -> RosPose:
        """Return the pose in the plane z = 0 of the world, with its covariance, as `Estimate.to_ros` does."""
        return ros_pose(self.pose, self.covariance)


Answers = tuple[tuple[Answer, ...], ...]
"""All answers at each of N frames, the best first; none at frames with one, which is the estimate."""
