"""The plane in which sensor and object move, and poses in space as poses in it.

Its x axis is the x axis of the frame that poses are given in, laid into the plane; with the frame's own z axis as the
normal, poses in the plane have the x and y of the frame.
"""

import logging
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from palpate.checks import LONGEST
from palpate.errors import FileError, SettingError
from palpate.geometry import se2
from palpate.types.measurements import finite_numbers
from palpate.types.motion import Placed, Times
from palpate.types.units import check_metres

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]
Normal = tuple[float, float, float] | Literal["fit"]
"""The normal of a plane, or "fit" for the plane through the sensor's path."""

STEEPEST = np.radians(20.0)
"""Largest angle of an x axis out of the plane [rad]; beyond, its yaw is unreliable."""


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

    def __str__(self) -> str:
        """Return a description for people."""
        return f"plane {np.degrees(self.tilt):.1f} degrees off its xy plane at {self.height * 1e3:.1f} mm"


def checked_choices(plane: Normal, off_plane: float, time_offset: float) -> Normal:
    """Return the plane as "fit" or a tuple of its normal. Raises SettingError if one of the values is not allowed."""
    normal = None if isinstance(plane, str) else finite_numbers(plane, (3,))
    if normal is None and not (isinstance(plane, str) and plane == "fit"):
        raise SettingError(f"plane is {plane!r}; allowed are fit, or three numbers: its normal")
    length, shift = finite_numbers(off_plane, ()), finite_numbers(time_offset, ())
    if length is None or not length > 0.0:
        raise SettingError(f"off_plane is {off_plane!r}; allowed is a length above 0 [m]")
    if shift is None or abs(shift) > LONGEST:
        raise SettingError(f"time_offset is {time_offset!r}; allowed are up to {LONGEST:g} s, forwards or backwards")
    return "fit" if normal is None else (float(normal[0]), float(normal[1]), float(normal[2]))


def chosen_plane(what: str, normal: Normal, frame: str, sensor: Placed) -> Plane:
    """Return the plane of a normal, or the one that fits the sensor's path, with a warning that states it.

    `what` names the recording in warnings. Raises FileError where there is no such plane.
    """
    if normal != "fit":
        plane = plane_across(frame, np.array(normal, np.float64), sensor.position)
    else:
        plane = plane_through(frame, sensor.position)
        words = ", ".join(f"{each:.4f}" for each in plane.axes[:, 2])
        logger.warning("%s: the sensor moves in the %s, normal (%s)", what, plane, words)
    if (Rotation.from_quat(sensor.rotation).apply(plane.axes[:, 2], inverse=True)[:, 2] < 0.0).all():
        logger.warning(
            "%s: the sensor's z axis points against the plane's normal: if its images are not upside down with it, its "
            "frame is turned about x, or the quaternions have w first",
            what,
        )
    return plane


def planar(what: str, plane: Plane, time: Times, placed: Placed, off_plane: float) -> Array:
    """Return poses at times (N,) [ns] as poses in the plane (N, 3) [m, m, rad].

    Raises FileError where one is more than `off_plane` [m] off it or too steep, or they seem to be in millimetres;
    warns where some are tilted.
    """
    check_metres(what, placed.position)
    pose, height, angle = into_plane(plane, placed.position, placed.rotation)
    if not len(pose):
        return pose
    off = np.abs(height - np.median(height))
    if off.max() > off_plane:
        worst = int(np.argmax(off > off_plane))
        raise FileError(
            f"{what} is {off[worst] * 1e3:.1f} mm off the plane at {time[worst] * 1e-9:.3f} s, allowed are "
            f"{off_plane * 1e3:g} mm; off_plane (--off-plane METRES) allows more, plane (--plane) names another or "
            "fits one"
        )
    steepest = int(np.argmax(np.abs(angle)))
    degrees = float(np.degrees(angle[steepest]))
    if abs(angle[steepest]) > STEEPEST:
        raise FileError(
            f"{what} has its x axis {degrees:.1f} degrees out of the plane at {time[steepest] * 1e-9:.3f} s, allowed "
            f"are {np.degrees(STEEPEST):.0f}; the x axis has to point out of the gel, along the plane"
        )
    if abs(degrees) > 2.0:
        logger.warning("%s is tilted out of the plane by up to %.1f degrees", what, abs(degrees))
    return pose


def plane_across(frame: str, normal: Array, position: Array) -> Plane:
    """Return the plane with a normal (3,), of any length, at the median height of positions (N, 3) [m]."""
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
    """Return the plane closest to positions (N, 3) [m]; its normal points to the side of the frame's z axis.

    Raises FileError where they lie on a line.
    """
    _, spread, axes = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)
    width = float(spread[1] / np.sqrt(len(position))) if len(position) > 2 else 0.0
    if width < 2e-3:
        raise FileError(
            f"the sensor moves along a line, {width * 1e3:.1f} mm across, which determines no plane: give its normal, "
            "plane=(X, Y, Z) or --plane X Y Z"
        )
    return plane_across(frame, np.array(axes[2] if axes[2, 2] >= 0.0 else -axes[2], np.float64), position)


def into_plane(plane: Plane, position: Array, rotation: Array) -> tuple[Array, Array, Array]:
    """Return poses in the plane from frame_T_body, positions (N, 3) [m] and quaternions x, y, z, w (N, 4).

    They are plane_T_body (N, 3) [m, m, rad], whose yaw is that of the body's x axis about the normal, with heights (N,)
    [m] along the normal and angles (N,) [rad] of that x axis out of the plane.
    """
    at = position @ plane.axes
    x_axis = Rotation.from_quat(rotation).apply([1.0, 0.0, 0.0]) @ plane.axes
    yaw = np.arctan2(x_axis[:, 1], x_axis[:, 0])
    return np.column_stack([at[:, :2], yaw]), at[:, 2], np.arcsin(np.clip(x_axis[:, 2], -1.0, 1.0))


def out_of_plane(plane: Plane, pose: Array) -> tuple[Array, Array]:
    """Return positions (N, 3) [m] and quaternions x, y, z, w (N, 4) of poses in the plane (N, 3) [m, m, rad]."""
    height = np.full((len(pose), 1), plane.height)
    position = np.hstack([pose[:, :2], height]) @ plane.axes.T
    return position, (Rotation.from_matrix(plane.axes) * Rotation.from_euler("z", pose[:, 2:])).as_quat()


def spatial_covariance(plane: Plane, pose: Array, covariance: Array) -> Array:
    """Return covariances (N, 6, 6) [m, rad] about the axes of the plane's frame, order x, y, z, turns about x, y, z.

    From poses in the plane (N, 3) and their covariances (N, 3, 3) in the tangent space at the pose (right, body frame),
    order x, y, theta. Directions out of the plane have zero.
    """
    axes_T_body = np.zeros((len(pose), 6, 3))
    axes_T_body[:, :3, :2] = plane.axes[:, :2] @ se2.rotation(pose[:, 2])
    axes_T_body[:, 3:, 2] = plane.axes[:, 2]
    return axes_T_body @ covariance @ axes_T_body.transpose(0, 2, 1)


def flat(frame: str = "world") -> Plane:
    """Return the plane of the x and y axes of a frame."""
    return Plane(frame, np.eye(3), 0.0)
