"""The plane in which sensor and object move, and poses in space as poses in it.

Its x axis is the x axis of the frame that poses are given in, laid into the plane; with the frame's own z axis as the
normal, poses in the plane have the x and y of the frame.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from palpate.errors import FileError
from palpate.geometry import se2

Array = NDArray[np.float64]

NARROW = 2e-3
"""[m] standard deviation across the way of the sensor, below which that way is a line and tells no plane."""


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in a frame."""

    frame: str
    """The frame that poses are given in."""
    axes: Array
    """frame_R_plane, (3, 3): columns are the plane's x and y axes and its normal."""
    height: float
    """Distance of the plane from the frame's origin along the normal [m]."""

    @property
    def tilt(self) -> float:
        """Angle between the normal and the frame's z axis [rad]."""
        return float(np.arccos(np.clip(self.axes[2, 2], -1.0, 1.0)))


def plane_across(frame: str, normal: Array, position: Array) -> Plane:
    """The plane with a normal (3,), of any length, at the median height of positions (N, 3) [m]."""
    length = np.linalg.norm(normal)
    if not np.isfinite(normal).all() or length < 1e-9:
        raise FileError(f"the plane's normal is {normal.tolist()}, allowed are three numbers that are not all 0")
    z = normal / length
    # A frame whose x axis is the normal itself has its y axis in the plane.
    x = np.eye(3)[0 if abs(z[0]) < 0.99 else 1]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    axes = np.array([x, np.cross(z, x), z], np.float64).T
    return Plane(frame, axes, float(np.median(position @ z)))


def plane_through(frame: str, position: Array) -> Plane:
    """The plane that comes closest to positions (N, 3) [m]; its normal has the frame's z axis on its side.

    Raises FileError where they lie on a line.
    """
    _, spread, axes = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)
    width = float(spread[1] / np.sqrt(len(position))) if len(position) > 2 else 0.0
    if width < NARROW:
        raise FileError(
            f"the sensor moves along a line, {width * 1e3:.1f} mm across, which tells no plane: give its normal, "
            "--plane X Y Z"
        )
    return plane_across(frame, np.array(axes[2] if axes[2, 2] >= 0.0 else -axes[2], np.float64), position)


def into_plane(plane: Plane, position: Array, rotation: Array) -> tuple[Array, Array, Array]:
    """Poses in space as poses in the plane.

    From frame_T_body, positions (N, 3) [m] and quaternions x, y, z, w (N, 4). Returns plane_T_body (N, 3) [m, m, rad],
    whose yaw is that of the body's x axis about the normal; heights (N,) [m] along the normal; and the angle (N,) [rad]
    of that x axis out of the plane.
    """
    at = position @ plane.axes
    x_axis = Rotation.from_quat(rotation).apply([1.0, 0.0, 0.0]) @ plane.axes
    yaw = np.arctan2(x_axis[:, 1], x_axis[:, 0])
    return np.column_stack([at[:, :2], yaw]), at[:, 2], np.arcsin(np.clip(x_axis[:, 2], -1.0, 1.0))


def out_of_plane(plane: Plane, pose: Array) -> tuple[Array, Array]:
    """Poses in the plane (N, 3) [m, m, rad] as poses in space: positions (N, 3) [m], quaternions x, y, z, w (N, 4)."""
    height = np.full((len(pose), 1), plane.height)
    position = np.hstack([pose[:, :2], height]) @ plane.axes.T
    return position, (Rotation.from_matrix(plane.axes) * Rotation.from_euler("z", pose[:, 2:])).as_quat()


def spatial_covariance(plane: Plane, pose: Array, covariance: Array) -> Array:
    """The covariances (N, 6, 6) [m, rad] about the axes of the plane's frame, order x, y, z, turns about x, y, z.

    From poses in the plane (N, 3) and their covariances (N, 3, 3) in the tangent space at the pose (right, body frame),
    order x, y, theta. What leaves the plane has none: zero.
    """
    axes_T_body = np.zeros((len(pose), 6, 3))
    axes_T_body[:, :3, :2] = plane.axes[:, :2] @ se2.rotation(pose[:, 2])
    axes_T_body[:, 3:, 2] = plane.axes[:, 2]
    return axes_T_body @ covariance @ axes_T_body.transpose(0, 2, 1)


def flat(frame: str = "world") -> Plane:
    """The plane of the x and y axes of a frame."""
    return Plane(frame, np.eye(3), 0.0)
