"""Trajectory: the poses of an object over time, estimated by palpate or another program."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.checks import FARTHEST, FLAGS, NUMBERS, check_increasing, check_rows, checked_array, is_near
from palpate.errors import FileError


@dataclass(frozen=True, eq=False)
class Trajectory:
    """N poses of one object; raises FileError on fields that do not fit together."""

    time: NDArray[np.float64]
    """(N,) [s], strictly increasing"""
    pose: NDArray[np.float64]
    """world_T_object, (N, 3) [m, m, rad]"""
    covariance: NDArray[np.float64] | None = None
    """(N, 3, 3) [m, m, rad], of the tangent vector at the estimate (right, body frame), order x, y, theta"""
    contact: NDArray[np.bool_] | None = None
    """(N,) true while the sensor touched the object"""
    status: tuple[str, ...] | None = None
    """(N,) status of each estimate"""

    def __post_init__(self) -> None:
        time = checked_array("time", self.time, NUMBERS, ("N",)).astype(np.float64)
        if not len(time):
            raise FileError("time: found no poses, a trajectory needs at least one")
        check_increasing(time)
        n = len(time)
        pose = checked_array("pose", self.pose, NUMBERS, (n, 3)).astype(np.float64)
        check_rows("pose", pose, is_near(pose).all(axis=1), f"three numbers up to {FARTHEST:g}")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "pose", pose)
        if self.covariance is not None:
            covariance = checked_array("covariance", self.covariance, NUMBERS, (n, 3, 3)).astype(np.float64)
            check_rows("covariance", covariance, np.isfinite(covariance).all(axis=(1, 2)), "finite numbers")
            object.__setattr__(self, "covariance", covariance)
        if self.contact is not None:
            object.__setattr__(self, "contact", checked_array("contact", self.contact, FLAGS, (n,)))
        if self.status is not None:
            object.__setattr__(self, "status", tuple(self.status))
            if len(self.status) != n:
                raise FileError(f"status: found {len(self.status)} words for {n} times, expected one for each")

    def __len__(self) -> int:
        return len(self.time)
