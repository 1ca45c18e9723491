"""Output of the tracker: the object's pose at one frame with its covariance, and its trajectory over time."""

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.checks import FLAGS, NUMBERS, check_rows, checked_array, checked_poses, checked_times
from palpate.errors import FileError

Array = NDArray[np.float64]
Status = Literal["resting", "tracking", "ambiguous", "strained", "uncertain", "displaced", "indeterminate", "faulty"]
"""Reliability of an estimate, which `docs/guide/status.md` describes; REASONS has each in short."""
REASONS: dict[Status, str] = {
    "resting": "",
    "tracking": "",
    "ambiguous": "several poses fit what was measured",
    "strained": "touch and pushing contradict each other, or did before",
    "uncertain": "the covariance is too large to be reliable",
    "displaced": "the object was moved while nothing touched it",
    "indeterminate": "the graph had no solution and began anew",
    "faulty": "implausible input",
}
"""Reason of each status, for an estimate that has no closer one."""


class RosPose(NamedTuple):
    """A pose in space as ROS messages have it. ROS need not be installed."""

    position: Array
    """x, y, z (3,) [m]."""
    orientation: Array
    """Quaternion x, y, z, w (4,)."""
    covariance: Array
    """(36,), row by row: about the axes of the header's frame, order x, y, z [m], turns about x, y, z [rad]."""


class _PlanarPose:
    """A pose in the plane with its covariance; equal to another if all values are, NaN being equal to NaN."""

    pose: Array
    covariance: Array

    def to_ros(self) -> RosPose:
        """Return the pose in the plane z = 0 of the world, with its covariance about the world's axes as ROS has it.

        Directions out of the plane, z and the turns about x and y, have variances of 0.
        """
        from palpate.types.space import flat, out_of_plane, spatial_covariance

        plane = flat()
        (position,), (orientation,) = out_of_plane(plane, self.pose[None])
        spatial = spatial_covariance(plane, self.pose[None], self.covariance[None])
        return RosPose(position, orientation, spatial.reshape(36))

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and all(map(_are_same, vars(self).values(), vars(other).values()))

    __hash__ = None  # pyright: ignore[reportAssignmentType]  # arrays may be changed


def _are_same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_are_same, one, other))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return type(one) is type(other) and np.array_equal(one, other, equal_nan=True)
    return bool(one == other or (one != one and other != other))


@dataclass(frozen=True, eq=False)
class Answer(_PlanarPose):
    """One of several poses that the object may have while touch cannot decide between them."""

    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta."""
    weight: float
    """Probability among all answers, from 0 to 1."""


Answers = tuple[tuple[Answer, ...], ...]
"""All answers at each of N frames, the best first; none at frames with one, which is the estimate."""


@dataclass(frozen=True, eq=False)
class Estimate(_PlanarPose):
    """The object's pose at one frame, with its uncertainty and status."""

    time: float
    """[s]"""
    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    covariance: Array
    """(3, 3), tangent space at the pose (right, body frame), order x, y, theta; it spans all answers."""
    contact: bool
    """True while the sensor touches the object."""
    status: Status
    """Degree of trust; see `palpate.types.estimate.Status`."""
    reason: str = ""
    """Reason of the status, or a fault of the input stream; empty if there is none."""
    answers: tuple[Answer, ...] = ()
    """All poses that the object may have, the best first; one where nothing is ambiguous."""
    friction: tuple[float, float] = (math.nan, math.nan)
    """Coulomb friction between sensor and object as learnt so far, with its standard deviation; by the best answer."""
    contact_point: Array | None = None
    """Contact point on the outline, (2,) [m], world frame, by the best answer; None between contacts. For a wide pad or
    several tips it is the middle of the loaded part."""
    contact_normal: Array | None = None
    """Outward normal of the outline there, (2,), world frame; None between contacts."""
    sliding: float = math.nan
    """Probability that the contact slides, that is, that the pushing force is outside the friction cone, by the best
    answer. NaN where it is unknown: between contacts and at the first frame of one."""
    touch_age: float = math.inf
    """Time since the object was last touched [s]: 0 in contact, infinite before the first."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """N poses of one object, estimated by palpate or another program; raises FileError on fields that do not fit."""

    time: Array
    """(N,) [s], strictly increasing."""
    pose: Array
    """world_T_object, (N, 3) [m, m, rad]."""
    covariance: Array | None = None
    """(N, 3, 3) [m, m, rad], of the tangent vector at the estimate (right, body frame), order x, y, theta."""
    contact: NDArray[np.bool_] | None = None
    """(N,) true while the sensor touched the object."""
    status: tuple[str, ...] | None = None
    """(N,) status of each estimate."""
    reason: tuple[str, ...] | None = None
    """(N,) reason of each status, empty if there is none."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", checked_times(self.time, "a trajectory"))
        n = len(self.time)
        object.__setattr__(self, "pose", checked_poses("pose", self.pose, n))
        if self.covariance is not None:
            covariance = checked_array("covariance", self.covariance, NUMBERS, (n, 3, 3)).astype(np.float64)
            check_rows("covariance", covariance, np.isfinite(covariance).all(axis=(1, 2)), "finite numbers")
            object.__setattr__(self, "covariance", covariance)
        if self.contact is not None:
            object.__setattr__(self, "contact", checked_array("contact", self.contact, FLAGS, (n,)))
        for name in ("status", "reason"):
            if (words := getattr(self, name)) is not None:
                object.__setattr__(self, name, tuple(words))
                if len(words) != n:
                    raise FileError(f"{name}: found {len(words)} words for {n} times, expected one for each")

    def __len__(self) -> int:
        return len(self.time)
