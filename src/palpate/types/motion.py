"""Poses in space over time, and their interpolation."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from palpate.checks import is_near
from palpate.errors import FileError

Array = NDArray[np.float64]
Times = NDArray[np.int64]

LONGEST_GAP = 0.5
"""[s] between two poses of a moving frame, beyond which it is unknown in between."""


@dataclass(frozen=True, eq=False)
class Poses:
    """N poses of one frame in another, `frame_T_child`; they may have times of their own or hold at all times."""

    frame: str
    time: Times
    """(N,) strictly increasing [ns]"""
    position: Array
    """(N, 3) [m]"""
    rotation: Array
    """(N, 4) quaternions x, y, z, w"""


@dataclass(frozen=True, eq=False)
class Placed:
    """Poses of a frame at M times."""

    position: Array
    """(M, 3) [m]"""
    rotation: Array
    """(M, 4) quaternions x, y, z, w"""
    known: NDArray[np.bool_]
    """(M,) false before the first pose, after the last and in long gaps, where the nearest pose is given"""

    def __getitem__(self, keep: NDArray[np.bool_]) -> "Placed":
        """Return the poses at flagged times (M,)."""
        return Placed(self.position[keep], self.rotation[keep], self.known[keep])

    def __matmul__(self, other: "Placed") -> "Placed":
        """Return a_T_c from a_T_b and b_T_c."""
        turn = Rotation.from_quat(self.rotation)
        position = self.position + turn.apply(other.position)
        rotation = (turn * Rotation.from_quat(other.rotation)).as_quat()
        return Placed(position, rotation, self.known & other.known)

    def inverse(self) -> "Placed":
        """Return b_T_a from a_T_b."""
        back = Rotation.from_quat(self.rotation).inv()
        return Placed(-back.apply(self.position), back.as_quat(), self.known)


def poses_in_time(name: str, frame: str, time: Times, numbers: Array) -> Poses:
    """Return poses at times (N,) [ns], positions and quaternions x, y, z, w in rows (N, 7).

    They are sorted; of several at one time the last counts. Raises FileError that names them by `name` where numbers
    are not finite or a quaternion has not length 1.
    """
    near = np.asarray(is_near(numbers).all(axis=1))
    length = np.linalg.norm(np.where(near[:, None], numbers[:, 3:], 0.0), axis=1)
    good = near & (np.abs(length - 1.0) < 1e-2)
    if not good.all():
        wrong = int(np.argmin(good))
        raise FileError(
            f"{name}: pose {wrong} at {time[wrong] * 1e-9:.9f} s is {numbers[wrong].tolist()}, allowed are a finite "
            "position and a quaternion of length 1"
        )
    order = np.argsort(time, kind="stable")
    time, numbers = time[order], numbers[order]
    last = np.append(np.diff(time) > 0, True)
    return Poses(frame, time[last], numbers[last, :3], numbers[last, 3:])


def at_times(poses: Poses, time: Times) -> Placed:
    """Return interpolated poses at times (M,) [ns]: positions linear, rotations at an even rate."""
    if len(poses.time) == 1:
        return replace(always(poses, len(time)), known=time == poses.time)
    seconds, wanted = (poses.time - poses.time[0]) * 1e-9, (time - poses.time[0]) * 1e-9
    inside = np.clip(wanted, 0.0, seconds[-1])
    position = np.column_stack([np.interp(inside, seconds, column) for column in poses.position.T])
    after = np.clip(np.searchsorted(poses.time, time), 1, len(seconds) - 1)
    moved = np.linalg.norm(np.diff(poses.position, axis=0), axis=1) > 1e-4
    rotations = Rotation.from_quat(poses.rotation)
    moved |= (rotations[:-1].inv() * rotations[1:]).magnitude() > 1e-3
    lost = moved & (np.diff(seconds) > LONGEST_GAP)
    # A pose just at the time is known whatever comes before or after it.
    known = ((time >= poses.time[0]) & (time <= poses.time[-1]) & ~lost[after - 1]) | np.isin(time, poses.time)
    return Placed(position, Slerp(seconds, rotations)(inside).as_quat(), known)


def always(poses: Poses, count: int) -> Placed:
    """Return the last of poses that hold at all times, `count` times."""
    position, rotation = (np.repeat(values[-1:], count, axis=0) for values in (poses.position, poses.rotation))
    return Placed(position, rotation, np.ones(count, np.bool_))
