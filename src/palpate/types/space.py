"""Poses in space over time, and as poses in the plane in which sensor and object move.

The x axis of a plane is the x axis of the frame that poses are given in, laid into the plane; with the frame's own z
axis as the normal, poses in the plane have the x and y of the frame.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from palpate import checks
from palpate.arrays import Array, Flags, Times
from palpate.errors import FileError, SettingError
from palpate.geometry import se2
from palpate.types.choices import Placement
from palpate.types.images import camera_view
from palpate.types.measurements import finite_numbers

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

logger = logging.getLogger(__name__)

FARTHEST_GAP = 0.5
"""[s] between two poses of a moving frame, beyond which it is unknown in between."""
STEEPEST = 20.0
"""[deg] Largest angle of a sensor's x axis out of the plane, where its yaw is good, or z axis off the normal."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Poses of a frame at M times."""

    name: str
    """Name of the frame or its source, for errors."""
    position: Array
    """(M, 3) [m]."""
    rotation: "Rotation"
    """M rotations of SciPy."""
    known: Flags
    """(M,) false before the first pose, after the last and in long gaps, where the nearest pose is given."""

    def __getitem__(self, keep: Flags) -> "Placed":
        """Return the poses at flagged times (M,)."""
        rotation: Any = self.rotation[keep]  # pyright: ignore[reportArgumentType]
        return replace(self, position=self.position[keep], rotation=rotation, known=self.known[keep])

    def __matmul__(self, other: "Placed") -> "Placed":
        """Return a_T_c from a_T_b and b_T_c; one pose holds at all times."""
        position = self.position + self.rotation.apply(other.position)
        return Placed(self.name, position, self.rotation * other.rotation, self.known & other.known)

    def inverse(self) -> "Placed":
        """Return b_T_a from a_T_b."""
        back = self.rotation.inv()
        return Placed(self.name, -back.apply(self.position), back, self.known)


def placed_at(name: str, time: Times, numbers: Array, wanted: Times, is_static: bool = False) -> Placed:
    """Return poses, known at times (N,) [ns] in any order, at other times (M,) [ns].

    They are positions and quaternions x, y, z, w in rows (N, 7); of several at one time the last counts. Rows with NaN
    or a quaternion of zeros, as motion capture writes them, are not known. Positions are interpolated linearly,
    rotations at an even rate; a static pose, the last, holds at all times. Raises FileError if none is known, or where
    more than a tenth are too far or have a quaternion of another length than 1; fewer are not known, with a warning.
    """
    from scipy.spatial.transform import Rotation, Slerp

    is_lost = ~np.isfinite(numbers).all(axis=1) | (numbers[:, 3:] == 0.0).all(axis=1)
    if is_lost.all():
        raise FileError(f"{name}: none of {len(time)} poses is known: all hold NaN or a quaternion of zeros")
    near = np.asarray(checks.is_near(numbers).all(axis=1))
    length = np.linalg.norm(np.where(near[:, None], numbers[:, 3:], 0.0), axis=1)
    is_wrong = ~is_lost & ~(near & (np.abs(length - 1.0) < 1e-2))
    if is_wrong.any():
        first, count = int(np.argmax(is_wrong)), is_wrong.sum()
        found = f"{name}: pose {first} at {time[first] * 1e-9:.9f} s is {numbers[first].tolist()}"
        found += ", allowed are a finite position and a quaternion of length 1"
        if count > 0.1 * len(time):
            raise FileError(found)
        logger.warning("%s; %d of %d such poses are taken as unknown", found, count, len(time))
        is_lost |= is_wrong
    lost, time, numbers = np.sort(time[is_lost]), time[~is_lost], numbers[~is_lost]
    order = np.argsort(time, kind="stable")
    order = order[np.append(np.diff(time[order]) > 0, True)]
    time, position, turns = time[order], numbers[order, :3], Rotation.from_quat(numbers[order, 3:])
    if is_static or len(time) == 1:
        last = np.full(len(wanted), -1)
        return Placed(name, position[last], turns[last], (wanted == time[-1]) | is_static)  # pyright: ignore[reportArgumentType]
    seconds, asked = (time - time[0]) * 1e-9, (wanted - time[0]) * 1e-9
    inside = np.clip(asked, 0.0, seconds[-1])
    after = np.clip(np.searchsorted(time, wanted), 1, len(seconds) - 1)
    moved = np.linalg.norm(np.diff(position, axis=0), axis=1) > 1e-4
    moved |= (turns[:-1].inv() * turns[1:]).magnitude() > 1e-3
    is_gap = (moved & (np.diff(seconds) > FARTHEST_GAP)) | (np.diff(np.searchsorted(lost, time)) > 0)
    # A pose just at the time is known whatever comes before or after it.
    known = ((wanted >= time[0]) & (wanted <= time[-1]) & ~is_gap[after - 1]) | np.isin(wanted, time)
    between = np.column_stack([np.interp(inside, seconds, column) for column in position.T])
    return Placed(name, between, Slerp(seconds, turns)(inside), known)


def placed_now(name: str, numbers: Array) -> Placed:
    """Return a single pose (1, 7) for `placed_at`."""
    now = np.zeros(1, np.int64)
    return placed_at(name, now, numbers, now)


def onto_gel(placement: Placement) -> Callable[[Placed], Placed]:
    """Return the function that makes the gel's poses from those of its part; raises PalpateError on any bad choice."""
    offset, gel = placement.time_offset, None
    camera_view(placement.orientation)
    if placement.sensor_T_gel is not None:
        numbers = pose_numbers("sensor_T_gel", [placement.sensor_T_gel])
        checks.check_metres("sensor_T_gel", np.vstack([np.zeros(3), numbers[:, :3]]))
        gel = placed_now("sensor_T_gel", numbers)
    if checks.checked_number(placement.off_plane, 1e-9, checks.FARTHEST) is None:
        raise SettingError(f"off_plane is {placement.off_plane!r}; allowed is a length above 0 [m]")
    if checks.checked_number(offset, -checks.FARTHEST, checks.FARTHEST) is None:
        raise SettingError(f"time_offset is {offset!r}; allowed are up to {checks.FARTHEST:g} s, forwards or backwards")
    return lambda sensor: sensor if gel is None else sensor @ gel


class GelPoses:
    """Poses of a part of a robot, one after the other, as those of its gel in the plane through the first of them."""

    def __init__(self, placement: Placement) -> None:
        """Take the gel's pose on the part, and the normal of the plane and distances from it that are allowed."""
        self._onto_gel, self._placement = onto_gel(placement), placement
        if isinstance(placement.plane, str):
            raise SettingError("plane is fit, which needs all poses; allowed is its normal, as poses come one by one")
        self.plane: Plane | None = None
        """The plane, known from the first pose in space on."""

    def __call__(self, pose: ArrayLike, frame: str = "world") -> Array:
        """Return the gel's pose in the plane (3,). Raises FileError if a pose is none, or leaves frame or plane."""
        how = self._placement
        if how.sensor_T_gel is None and np.shape(pose) == (3,):
            return np.array(pose, np.float64)
        gel = self._onto_gel(placed_now("pose", pose_numbers("pose", [pose])))
        self.plane = plane = self.plane or plane_across(frame, how.plane, gel.position)
        if frame != plane.frame:
            raise FileError(f"pose: it is given in frame {frame!r}, the first was in {plane.frame!r}")
        placed = in_plane(plane, gel, how.off_plane)[0]
        upside_down(plane, gel)
        return placed


def gel_pose(pose: ArrayLike, sensor_T_gel: ArrayLike | None = None, plane: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Return the gel's pose in the plane of the push (3,) [m, m, rad] from that of the part of a robot that carries it.

    - pose: x, y, z, qx, qy, qz, qw or a 4x4 matrix, in the world; or x, y, theta.
    - sensor_T_gel: pose of the gel's frame in that of the part, in any of these forms: origin at the apex of the gel, x
      out of it, z up. None if `pose` is the gel's own.
    - plane: normal of the plane of the push. Raises FileError for a gel whose x axis is far out of it.
    """
    return GelPoses(Placement(sensor_T_gel=sensor_T_gel, plane=plane))(pose)  # pyright: ignore[reportArgumentType]


def pose_numbers(name: str, poses: ArrayLike | Sequence[ArrayLike]) -> Array:
    """Return poses of any kind as positions and quaternions x, y, z, w (N, 7); rows that hold NaN become NaN."""
    given = checks.as_array(name, poses)
    given = checks.checked_array(name, given, checks.NUMBERS, given.shape).astype(np.float64)
    if given.shape[1:] not in ((3,), (7,), (4, 4)):
        allowed = "(N, 3) of x, y, theta, (N, 7) of x, y, z, qx, qy, qz, qw, or (N, 4, 4)"
        raise FileError(f"{name}: found shape {given.shape}, expected {allowed}")
    numbers = np.full((len(given), 7), np.nan)
    good = np.isfinite(given).reshape(len(given), -1).all(axis=1)
    some = given[good]
    if given.shape[1:] == (7,):
        numbers[good] = some
    elif given.shape[1:] == (3,):
        if len(some) and (largest := np.abs(some[:, 2]).max()) > checks.TURNS:
            raise FileError(f"{name}: found angles up to {largest:.4g} rad: are these degrees? np.radians helps")
        half, zero = 0.5 * some[:, 2], np.zeros(len(some))
        numbers[good] = np.column_stack([some[:, :2], zero, zero, zero, np.sin(half), np.cos(half)])
    else:
        from scipy.spatial.transform import Rotation

        turn = some[:, :3, :3]
        rigid = np.isclose(turn @ turn.transpose(0, 2, 1), np.eye(3), atol=1e-3).all(axis=(1, 2))
        rigid &= (np.linalg.det(turn) > 0.0) & np.isclose(some[:, 3], [0.0, 0.0, 0.0, 1.0]).all(axis=1)
        checks.check_rows(name, some, rigid, "a rotation and a translation, the last row 0, 0, 0, 1")
        numbers[good] = np.column_stack([some[:, :3, 3], Rotation.from_matrix(turn).as_quat()])
    return numbers


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in a frame."""

    frame: str
    """The frame that poses are given in."""
    axes: Array
    """frame_R_plane, (3, 3): columns are the plane's x and y axes and its normal."""
    height: float
    """Distance of the plane from the frame's origin along the normal [m]."""


def plane_across(frame: str, normal: object, position: Array) -> Plane:
    """Return the plane with a normal (3,), of any length, at the median height of positions (N, 3) [m]."""
    z = finite_numbers(normal, (3,))
    if z is None or np.linalg.norm(z) < 1e-9:
        raise SettingError(f"plane is {normal!r}; allowed are fit, or three numbers that are not all 0: its normal")
    z = z / np.linalg.norm(z)
    # A frame whose x axis is the normal itself has its y axis in the plane.
    x = np.eye(3)[0 if abs(z[0]) < 0.99 else 1]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    axes = np.array([x, np.cross(z, x), z], np.float64).T
    return Plane(frame, axes, float(np.median(position @ z)))


def plane_through(what: str, frame: str, position: Array) -> Plane:
    """Return the plane closest to positions (N, 3) [m], with a warning that states it; `what` names them.

    Its normal points to the side of the frame's z axis. Raises FileError if they determine none.
    """
    _, spread, axes = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)
    width = float(spread[1] / np.sqrt(len(position))) if len(position) > 2 else 0.0
    if width < 2e-3:
        raise FileError(
            f"the sensor moves along a line, {width * 1e3:.1f} mm across, which determines no plane: give its normal, "
            "plane=(X, Y, Z) or --plane X Y Z"
        )
    plane = plane_across(frame, axes[2] if axes[2, 2] >= 0.0 else -axes[2], position)
    words = ", ".join(f"{each:.4f}" for each in plane.axes[:, 2])
    logger.warning("%s: the sensor moves in the plane of normal (%s)", what, words)
    return plane


def in_plane(plane: Plane, placed: Placed, off_plane: float, time: Times | None = None) -> Array:
    """Return poses as poses in the plane (N, 3) [m, m, rad], whose yaw is that of the x axis about the normal.

    Raises FileError where one is more than `off_plane` [m] off it or too steep, or they seem to be in millimetres. With
    their times (N,) [ns] they may all be at another height than the plane, and a warning tells where they are tilted.
    """
    what = placed.name
    checks.check_metres(what, placed.position)
    at, x_axis = placed.position @ plane.axes, placed.rotation.apply([1.0, 0.0, 0.0]) @ plane.axes
    if not len(at):
        return at
    off = np.abs(at[:, 2] - (plane.height if time is None else np.median(at[:, 2])))
    angle = np.degrees(np.arcsin(np.clip(x_axis[:, 2], -1.0, 1.0)))
    worst, steepest = int(np.argmax(off > off_plane)), int(np.argmax(np.abs(angle)))
    when = [" of the first", ""] if time is None else [f" at {each * 1e-9:.3f} s" for each in time[[worst, steepest]]]
    if off.max() > off_plane:
        raise FileError(
            f"{what} is {off[worst] * 1e3:.1f} mm off the plane{when[0]}, allowed are {off_plane * 1e3:g} mm"
            + "; off_plane (--off-plane METRES) allows more, plane (--plane) names another or fits one"
            * (time is not None)
        )
    if abs(angle[steepest]) > STEEPEST:
        raise FileError(
            f"{what} has its x axis {angle[steepest]:.1f} degrees out of the plane{when[-1]}, allowed are "
            f"{STEEPEST:.0f}; the x axis has to point out of the gel, along the plane; sensor_T_gel (--sensor-T-gel) "
            "takes the gel's pose on a flange"
        )
    if time is not None and abs(angle[steepest]) > 2.0:
        logger.warning("%s is tilted out of the plane by up to %.1f degrees", what, abs(angle[steepest]))
    return np.column_stack([at[:, :2], np.arctan2(x_axis[:, 1], x_axis[:, 0])])


def upside_down(plane: Plane, placed: Placed) -> Flags:
    """Return true where z axes point against a plane's normal. Raises FileError where they are far off its line."""
    upright = placed.rotation.apply(plane.axes[:, 2], inverse=True)[:, 2]
    if (roll := np.degrees(np.arccos(min(np.abs(upright).min(), 1.0)))) > STEEPEST:
        words = f"{placed.name} has its z axis up to {roll:.0f} degrees off the plane's normal, allowed are"
        raise FileError(f"{words} {STEEPEST:.0f}: is w the last of each quaternion?")
    return upright < 0.0


def out_of_plane(plane: Plane, pose: Array) -> tuple[Array, Array]:
    """Return the position (3,) [m] and the quaternion x, y, z, w (4,) of a pose in the plane (3,) [m, m, rad]."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(plane.axes) * Rotation.from_euler("z", pose[2])
    return plane.axes @ np.array([pose[0], pose[1], plane.height]), turn.as_quat()


def spatial_covariance(plane: Plane, pose: Array, covariance: Array) -> Array:
    """Return a covariance (6, 6) [m, rad] about the axes of the plane's frame, order x, y, z, turns about x, y, z.

    From a pose in the plane (3,) and its covariance (3, 3) in the tangent space at the pose (right, body frame), order
    x, y, theta. Directions out of the plane have zero.
    """
    axes_T_body = np.zeros((6, 3))
    axes_T_body[:3, :2] = plane.axes[:, :2] @ se2.rotation(pose[2])
    axes_T_body[3:, 2] = plane.axes[:, 2]
    return axes_T_body @ covariance @ axes_T_body.T


def flat(frame: str = "world") -> Plane:
    """Return the plane of the x and y axes of a frame."""
    return Plane(frame, np.eye(3), 0.0)
