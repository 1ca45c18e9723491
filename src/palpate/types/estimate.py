"""What the tracker says of the object at one frame."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.by_value import ByValue
from palpate.filter.consistency import Status
from palpate.types.answer import Answer
from palpate.types.ros_pose import RosPose, ros_pose

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Estimate(ByValue):
    """The object's pose at one frame, and what else is known of it.

    Two are equal if all their values are.
    """

    time: float
    """[s]"""
    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta; it spans all answers."""
    contact: bool
    """Whether the sensor touches the object."""
    status: Status
    """How far to trust it, in a word; see `estimation.diagnosis.Status`."""
    reason: str = ""
    """Why the status is what it is, or what of the stream is worse than it should be; empty where all is well."""
    answers: tuple[Answer, ...] = ()
    """All poses that may be the object's, the best first; one where nothing is doubtful."""
    friction: tuple[float, float] = (math.nan, math.nan)
    """Coulomb friction between sensor and object as learnt so far, with its standard deviation; by the best answer."""
    contact_point: Array | None = None
    """Where the sensor touches the object, (2,) [m], world frame, by the best answer; None between contacts. Of a wide
    pad or several tips it is the middle of what bears the load."""
    contact_normal: Array | None = None
    """The outline's outward normal there, (2,), world frame; None between contacts."""
    sliding: float = math.nan
    """How likely it is that the contact slides and does not hold, from 0 to 1, by the best answer: whether the pushing
    force is outside the friction cone. NaN where that is not known: between contacts, at the first frame of one, and
    by smoothers other than fixed-lag and batch."""
    touch_age: float = math.inf
    """How long ago the object was last touched [s]: 0 in contact, infinite before the first."""

    def to_ros(self) -> RosPose:
        """Return the pose in the plane z = 0 of the world, with its covariance about the world's axes as ROS has it.

        What leaves the plane, z and the turns about x and y, has variances of 0. ROS need not be installed.
        """
        return ros_pose(self.pose, self.covariance)
