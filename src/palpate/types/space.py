"""Poses in space over time, and their projection to the plane in which sensor and object move.

The x axis of a plane is the projection of the x axis of the frame in which poses are given; if the normal is the z axis
of that frame, poses in the plane have the x and y of the frame.
"""

import logging
from collections.abc import Callable, Iterable, Sequence
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
from palpate.types.stray_poses import MANY, check_one_at_a_time, stray_poses

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

logger = logging.getLogger(__name__)

FARTHEST_GAP = 0.5
"""[s] Longest time between two poses of a moving frame over which poses are interpolated."""
MOST_WRONG = 0.1
"""Share of poses that may be wrong and cost only themselves."""
STEEPEST = 20.0
"""[deg] Largest angle of a sensor's x axis out of the plane, or of its z axis from the normal: its yaw is then good."""


SAME_PLACE = 1e-4
"""[m] Largest difference of static poses that are the same, but for rounding."""
SAME_ANGLE = 1e-3
"""[rad] The same of their rotations."""


class NoneKnown(FileError):
    """A stream of poses of which none is known."""


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
    """(M,) false before the first pose, after the last and in long gaps; the pose there is only the nearest one."""

    def __getitem__(self, keep: Flags) -> "Placed":
        """Return the poses at flagged times (M,)."""
        rotation: Any = self.rotation[keep]  # pyright: ignore[reportArgumentType]
        return replace(self, position=self.position[keep], rotation=rotation, known=self.known[keep])

    def __matmul__(self, other: "Placed") -> "Placed":
        """Return a_T_c from a_T_b and b_T_c; where one of both is a single pose, it holds at all times."""
        position = self.position + self.rotation.apply(other.position)
        return Placed(self.name, position, self.rotation * other.rotation, self.known & other.known)

    def inverse(self) -> "Placed":
        """Return b_T_a from a_T_b."""
        back = self.rotation.inv()
        return Placed(self.name, -back.apply(self.position), back, self.known)


def placed_at(name: str, time: Times, numbers: Array, wanted: Times, is_static: bool = False) -> Placed:
    """Return the poses of a frame at times (M,) [ns] from those at other times (N,) [ns], which do not go back.

    Given poses are rows (N, 7), position and quaternion x, y, z, w; of several at one time the last counts. Rows with
    NaN or a quaternion of zeros, which motion capture writes when it has lost the frame, are unknown. Positions are
    interpolated linearly, rotations at a constant rate; the last pose of a static frame holds at all times.

    Raises FileError if no pose is known, or if more than a tenth are too far, have a quaternion of another length than
    1, or leap to and fro; fewer such poses are taken as unknown, with a warning.
    """
    from scipy.spatial.transform import Rotation

    is_lost = _lost_poses(name, time, numbers)
    lost_time = np.sort(time[is_lost])
    time = time[~is_lost]
    numbers = numbers[~is_lost]
    order = np.argsort(time, kind="stable")
    is_last_at_its_time = np.append(np.diff(time[order]) > 0, True)
    if not is_static:
        check_one_at_a_time(name, time[order], numbers[order, :3])
    order = order[is_last_at_its_time]
    time = time[order]
    position = numbers[order, :3]
    rotation = Rotation.from_quat(numbers[order, 3:])
    if is_static or len(time) == 1:
        last = np.full(len(wanted), -1)
        return Placed(name, position[last], rotation[last], (wanted == time[-1]) | is_static)  # pyright: ignore[reportArgumentType]
    is_stray = stray_poses(name, time, position, rotation)
    lost_time = np.sort(np.r_[lost_time, time[is_stray]])
    rotation_kept: Any = rotation[~is_stray]  # pyright: ignore[reportArgumentType]
    return _interpolated(name, time[~is_stray], position[~is_stray], rotation_kept, lost_time, wanted)


def check_unchanged(name: str, time: Times, numbers: Array) -> None:
    """Raise FileError if a static pose was sent again, at times (N,) [ns], with another value (N, 7)."""
    from scipy.spatial.transform import Rotation

    kept = np.isfinite(numbers).all(axis=1) & (numbers[:, 3:] != 0.0).any(axis=1)
    known = numbers[kept]
    if len(known) < 2:
        return
    way = np.linalg.norm(known[:, :3] - known[0, :3], axis=1)
    turn = (Rotation.from_quat(known[0, 3:]).inv() * Rotation.from_quat(known[:, 3:])).magnitude()
    has_changed = (way > SAME_PLACE) | (turn > SAME_ANGLE)
    if not has_changed.any():
        return
    first = int(np.argmax(has_changed))
    raise FileError(
        f"{name} are static and were sent again at {time[kept][first] * 1e-9:.3f} s with another value, "
        f"{1e3 * way[first]:.1f} mm and {np.degrees(turn[first]):.1f} degrees off: was the mounting changed or "
        "calibrated anew? Allowed is one value: cut the bag there into two recordings"
    )


def _lost_poses(name: str, time: Times, numbers: Array) -> Flags:
    """Return flags (N,) of poses (N, 7) that are unknown; see `placed_at` for the errors and the warning."""
    is_lost = ~np.isfinite(numbers).all(axis=1) | (numbers[:, 3:] == 0.0).all(axis=1)
    if is_lost.all():
        raise NoneKnown(f"{name}: none of {len(time)} poses is known: all hold NaN or a quaternion of zeros")
    is_in_range = np.asarray(checks.are_in_range(numbers).all(axis=1))
    length = np.linalg.norm(np.where(is_in_range[:, None], numbers[:, 3:], 0.0), axis=1)
    is_wrong = ~is_lost & ~(is_in_range & (np.abs(length - 1.0) < 1e-2))
    if not is_wrong.any():
        return is_lost
    first = int(np.argmax(is_wrong))
    count = is_wrong.sum()
    problem = (
        f"{name}: pose {first} at {time[first] * 1e-9:.9f} s is {numbers[first].tolist()}, allowed are a finite "
        "position and a quaternion of length 1"
    )
    if count > MOST_WRONG * len(time):
        raise FileError(problem)
    logger.warning("%s; %d of %d such poses are taken as unknown", problem, count, len(time))
    return is_lost | is_wrong


def _interpolated(
    name: str, time: Times, position: Array, rotation: "Rotation", lost_time: Times, wanted: Times
) -> Placed:
    """Return poses at times (M,) [ns] between those at increasing times (N,), two or more.

    They are unknown where a pose was lost in between, and in gaps longer than FARTHEST_GAP in which the frame moved.
    """
    from scipy.spatial.transform import Slerp

    seconds = (time - time[0]) * 1e-9
    inside = np.clip((wanted - time[0]) * 1e-9, 0.0, seconds[-1])
    has_moved = np.linalg.norm(np.diff(position, axis=0), axis=1) > 1e-4
    has_moved |= (rotation[:-1].inv() * rotation[1:]).magnitude() > 1e-3
    has_lost = np.diff(np.searchsorted(lost_time, time)) > 0
    is_gap = (has_moved & (np.diff(seconds) > FARTHEST_GAP)) | has_lost
    after = np.clip(np.searchsorted(time, wanted), 1, len(seconds) - 1)
    is_covered = (wanted >= time[0]) & (wanted <= time[-1]) & ~is_gap[after - 1]
    # At the very time of a given pose it is known, whatever comes before or after.
    known = is_covered | np.isin(wanted, time)
    between = np.column_stack([np.interp(inside, seconds, column) for column in position.T])
    return Placed(name, between, Slerp(seconds, rotation)(inside), known)


def placed_now(name: str, numbers: Array) -> Placed:
    """Return a single pose (1, 7) for `placed_at`."""
    now = np.zeros(1, np.int64)
    return placed_at(name, now, numbers, now)


def onto_gel(placement: Placement) -> Callable[[Placed], Placed]:
    """Return the function from poses of the part that carries the gel to poses of the gel.

    Raises PalpateError if any choice of the placement is not allowed.
    """
    camera_view(placement.orientation)
    gel = None
    if placement.sensor_T_gel is not None:
        numbers = pose_numbers("sensor_T_gel", [placement.sensor_T_gel])
        checks.check_metres("sensor_T_gel", np.vstack([np.zeros(3), numbers[:, :3]]))
        gel = placed_now("sensor_T_gel", numbers)
    if checks.checked_number(placement.off_plane, 1e-9, checks.FARTHEST) is None:
        raise SettingError(f"off_plane is {placement.off_plane!r}; allowed is a length above 0 [m]")
    if checks.checked_number(placement.time_offset, -checks.FARTHEST, checks.FARTHEST) is None:
        raise SettingError(
            f"time_offset is {placement.time_offset!r}; allowed are up to {checks.FARTHEST:g} s, forwards or backwards"
        )
    if gel is None:
        return lambda sensor: sensor
    return lambda sensor: sensor @ gel


class GelPoses:
    """Conversion of poses of a robot's part, one by one, to poses of its gel in the plane through the first of them."""

    def __init__(self, placement: Placement) -> None:
        """Take the gel's pose on the part, the normal of the plane, and the largest distance from it."""
        self._onto_gel = onto_gel(placement)
        self._placement = placement
        if isinstance(placement.plane, str):
            raise SettingError("plane is fit, which needs all poses; allowed is its normal, as poses come one by one")
        self.plane: Plane | None = None
        """The plane; None before the first pose in space."""
        self.is_upside_down = False
        """True if the z axis of the latest gel points against the plane's normal."""

    def __call__(self, pose: ArrayLike, frame: str = "world") -> Array:
        """Return the gel's pose in the plane (3,) [m, m, rad].

        Raises FileError if the pose is not one, is given in another frame than the first, or leaves the plane.
        """
        if self._placement.sensor_T_gel is None and np.shape(pose) == (3,):
            return np.array(pose, np.float64)
        gel = self._onto_gel(placed_now("pose", pose_numbers("pose", [pose])))
        if self.plane is None:
            self.plane = plane_across(frame, self._placement.plane, gel.position)
        if frame != self.plane.frame:
            raise FileError(f"pose: it is given in frame {frame!r}, the first was in {self.plane.frame!r}")
        planar_pose = in_plane(self.plane, gel, self._placement.off_plane)[0]
        self.is_upside_down = bool(upside_down(self.plane, gel)[0])
        return planar_pose


def gel_pose(pose: ArrayLike, sensor_T_gel: ArrayLike | None = None, plane: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Return the gel's pose in the plane of the push (3,) [m, m, rad] from that of the part of a robot that carries it.

    - pose: x, y, z, qx, qy, qz, qw or a 4x4 matrix, in the world; or x, y, theta.
    - sensor_T_gel: pose of the gel's frame in that of the part, in any of these forms: origin at the apex of the gel, x
      out of it, z up. None if `pose` is the gel's own.
    - plane: normal of the plane of the push.

    Raises FileError if the gel's x axis is far out of the plane.
    """
    return GelPoses(Placement(sensor_T_gel=sensor_T_gel, plane=plane))(pose)  # pyright: ignore[reportArgumentType]


COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Names of columns of poses, in their order."""


def pose_numbers(name: str, poses: ArrayLike | Sequence[ArrayLike]) -> Array:
    """Return poses as positions and quaternions x, y, z, w (N, 7); rows that hold NaN become NaN.

    They may be (N, 3), x, y, theta; (N, 7); or matrices (N, 4, 4). A few that are no pose, such as a matrix of zeros,
    become NaN with a warning. Raises FileError for anything else.
    """
    _check_columns(name, getattr(poses, "columns", ()))
    given = checks.as_array(name, poses)
    given = checks.checked_array(name, given, checks.NUMBERS, given.shape).astype(np.float64)
    if given.shape[1:] not in ((3,), (7,), (4, 4)):
        allowed = "(N, 3) of x, y, theta, (N, 7) of x, y, z, qx, qy, qz, qw, or (N, 4, 4)"
        if given.shape[1:] == (16,):
            allowed += ": poses.reshape(-1, 4, 4), transposed if matrices are by columns"
        raise FileError(f"{name}: found shape {given.shape}, expected {allowed}")
    numbers = np.full((len(given), 7), np.nan)
    is_known = np.isfinite(given).reshape(len(given), -1).all(axis=1)
    if given.shape[1:] == (7,):
        numbers[is_known] = given[is_known]
    elif given.shape[1:] == (3,):
        numbers[is_known] = _numbers_of_planar(name, given[is_known])
    else:
        numbers[is_known] = _numbers_of_matrices(name, given[is_known])
    return numbers


def _check_columns(name: str, columns: Iterable[object]) -> None:
    """Raise FileError if the columns of a table of pandas have names of a pose in another order, or in another unit."""
    found = [str(column).lower() for column in columns]
    known = [column for column in COLUMNS if column in found]
    is_other_unit = any(column.endswith(("deg", "mm")) for column in found)
    if known and (known != found[: len(known)] or is_other_unit):
        allowed = "x, y, theta or x, y, z, qx, qy, qz, qw in this order, in metres and radians"
        raise FileError(f"{name}: found the columns {', '.join(found)}; expected {allowed}")


def _numbers_of_planar(name: str, poses: Array) -> Array:
    """Return positions and quaternions (N, 7) of poses x, y, theta (N, 3). Raises FileError if angles are too large."""
    angle = poses[:, 2]
    largest = np.abs(angle).max() if len(poses) else 0.0
    is_good = np.abs(angle) <= checks.TURNS
    _check_few(name, f"found angles up to {largest:.4g} rad: are these degrees? np.radians helps", is_good)
    half = 0.5 * np.where(is_good, angle, np.nan)
    zero = np.zeros(len(poses))
    return np.column_stack([poses[:, :2], zero, zero, zero, np.sin(half), np.cos(half)])


def _check_few(name: str, problem: str, is_good: Flags) -> None:
    """Warn of a few poses (N,) that are not good, which are then unknown. Raises FileError if there are more."""
    count = int((~is_good).sum())
    if not count:
        return
    if count > MOST_WRONG * len(is_good):
        raise FileError(f"{name}: {problem}")
    logger.warning("%s: %s; %d of %d such poses are taken as unknown", name, problem, count, len(is_good))


def _numbers_of_matrices(name: str, poses: Array) -> Array:
    """Return positions and quaternions (N, 7) of matrices (N, 4, 4). Raises FileError unless they are rigid."""
    from scipy.spatial.transform import Rotation

    rotation = poses[:, :3, :3]
    is_rigid = np.asarray(np.isclose(rotation @ rotation.transpose(0, 2, 1), np.eye(3), atol=1e-3).all(axis=(1, 2)))
    is_rigid &= np.linalg.det(rotation) > 0.0
    is_rigid &= np.isclose(poses[:, 3], [0.0, 0.0, 0.0, 1.0]).all(axis=1)
    numbers = np.full((len(poses), 7), np.nan)
    if not is_rigid.all():
        index = int(np.argmin(is_rigid))
        allowed = "a rotation, of determinant 1, and a translation, the last row 0, 0, 0, 1"
        _check_few(name, f"frame {index} is {poses[index].tolist()}, allowed is {allowed}{_asked(poses)}", is_rigid)
    numbers[is_rigid, :3] = poses[is_rigid, :3, 3]
    if is_rigid.any():
        numbers[is_rigid, 3:] = Rotation.from_matrix(rotation[is_rigid]).as_quat()
    return numbers


def _asked(poses: Array) -> str:
    """Return a question on what most matrices (N, 4, 4) that are not rigid seem to be, or ""."""
    if np.isclose(poses[:, :, 3], [0.0, 0.0, 0.0, 1.0]).all(axis=1).mean() > 0.5 and np.abs(poses[:, 3, :3]).any():
        return ": are these written by columns? np.transpose(poses, (0, 2, 1)) helps"
    if (np.linalg.det(poses[:, :3, :3]) < 0.0).mean() > 0.5:
        return ": is the frame left-handed?"
    return ""


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
    # Where the frame's x axis is the normal, its y axis is projected to the plane instead.
    projected = np.eye(3)[0 if abs(z[0]) < 0.99 else 1]
    x = projected - (projected @ z) * z
    x /= np.linalg.norm(x)
    axes = np.array([x, np.cross(z, x), z], np.float64).T
    return Plane(frame, axes, float(np.median(position @ z)))


def plane_through(name: str, frame: str, position: Array) -> Plane:
    """Return the plane closest to positions (N, 3) [m], with a warning that states it; `name` is that of the recording.

    Its normal points to the side of the frame's z axis. Raises FileError if the positions determine no plane.
    """
    _, spread, axes = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)
    width = float(spread[1] / np.sqrt(len(position))) if len(position) > 2 else 0.0
    if width < 2e-3:
        raise FileError(
            f"the sensor moves along a line, {width * 1e3:.1f} mm across, which determines no plane: give its normal, "
            "plane=(X, Y, Z) or --plane X Y Z"
        )
    plane = plane_across(frame, axes[2] if axes[2, 2] >= 0.0 else -axes[2], position)
    normal = ", ".join(f"{number:.4f}" for number in plane.axes[:, 2])
    logger.warning("%s: the sensor moves in the plane of normal (%s)", name, normal)
    return plane


def in_plane(plane: Plane, placed: Placed, off_plane: float, time: Times | None = None) -> Array:
    """Return poses as poses in the plane (N, 3) [m, m, rad], whose yaw is that of the x axis about the normal.

    Without times, distances from the plane count; with the times (N,) [ns] of a recording, distances from the median
    height of its poses, which may be another. A warning says how far poses of a recording are tilted.

    Raises FileError if a pose is more than `off_plane` [m] off or too steep, or if poses seem to be in millimetres.
    """
    checks.check_metres(placed.name, placed.position)
    position = placed.position @ plane.axes
    if not len(position):
        return position
    x_axis = placed.rotation.apply([1.0, 0.0, 0.0]) @ plane.axes
    height = plane.height if time is None else np.median(position[:, 2])
    _check_height(placed.name, np.abs(position[:, 2] - height), off_plane, time)
    _check_tilt(placed.name, np.degrees(np.arcsin(np.clip(x_axis[:, 2], -1.0, 1.0))), time)
    return np.column_stack([position[:, :2], np.arctan2(x_axis[:, 1], x_axis[:, 0])])


def near_plane(plane: Plane, placed: Placed, off_plane: float, time: Times) -> Flags:
    """Return flags (N,) of poses at times (N,) [ns] without the few that are off a plane or turned out of it.

    Distances are from the median height of the poses. A warning counts those that are left out. More than a tenth stay,
    for the errors of `in_plane` and `upside_down`.
    """
    height = placed.position @ plane.axes[:, 2]
    rises = placed.rotation.apply([1.0, 0.0, 0.0]) @ plane.axes[:, 2]
    cosine = placed.rotation.apply(plane.axes[:, 2], inverse=True)[:, 2]
    off = np.abs(height - np.median(height))
    near = (off <= off_plane) & (np.abs(rises) <= np.sin(np.radians(STEEPEST)))
    near &= np.abs(cosine) >= np.cos(np.radians(STEEPEST))
    wrong = int((~near).sum())
    if not wrong or wrong > MANY * len(near) or len(near) - wrong < 2:
        return np.ones(len(near), np.bool_)
    first = int(np.argmin(near))
    logger.warning(
        "%s: %d of %d poses are off the plane or turned out of it, first by %.1f mm at %.3f s, and taken as unknown",
        placed.name,
        wrong,
        len(near),
        1e3 * off[first],
        time[first] * 1e-9,
    )
    return near


def _check_height(name: str, off: Array, off_plane: float, time: Times | None) -> None:
    """Raise FileError if distances (N,) [m] of poses from the plane exceed `off_plane` [m]."""
    if off.max() <= off_plane:
        return
    first = int(np.argmax(off > off_plane))
    where = " of the first"
    advice = ""
    if time is not None:
        where = f" at {time[first] * 1e-9:.3f} s"
        advice = "; off_plane (--off-plane METRES) allows more, plane (--plane) names another or fits one"
    raise FileError(
        f"{name} is {off[first] * 1e3:.1f} mm off the plane{where}, allowed are {off_plane * 1e3:g} mm{advice}"
    )


def _check_tilt(name: str, angle: Array, time: Times | None) -> None:
    """Raise FileError if angles (N,) [deg] of x axes out of the plane exceed STEEPEST; warn of a recording's tilt."""
    steepest = int(np.argmax(np.abs(angle)))
    if abs(angle[steepest]) > STEEPEST:
        when = "" if time is None else f" at {time[steepest] * 1e-9:.3f} s"
        raise FileError(
            f"{name} has its x axis {angle[steepest]:.1f} degrees out of the plane{when}, allowed are {STEEPEST:.0f}; "
            "the x axis has to point out of the gel, along the plane; sensor_T_gel (--sensor-T-gel) takes the gel's "
            "pose on a flange"
        )
    if time is not None and abs(angle[steepest]) > 2.0:
        logger.warning("%s is tilted out of the plane by up to %.1f degrees", name, abs(angle[steepest]))


UPSIDE_DOWN = (
    "the sensor's z axis points against the plane's normal: if its images are not upside down with it, turn its frame, "
    "by sensor_T_gel (--sensor-T-gel 0 0 0 1 0 0 0), unless the quaternions have w first"
)
"""A warning for poses all of which `upside_down` flags."""


def upside_down(plane: Plane, placed: Placed) -> Flags:
    """Return flags of poses whose z axis points against a plane's normal.

    Raises FileError if a z axis is far from parallel to the normal.
    """
    cosine = placed.rotation.apply(plane.axes[:, 2], inverse=True)[:, 2]
    largest_angle = np.degrees(np.arccos(min(np.abs(cosine).min(), 1.0)))
    if largest_angle > STEEPEST:
        raise FileError(
            f"{placed.name} has its z axis up to {largest_angle:.0f} degrees off the plane's normal, allowed are "
            f"{STEEPEST:.0f}: is w the last of each quaternion?"
        )
    return cosine < 0.0


def out_of_plane(plane: Plane, pose: Array) -> tuple[Array, Array]:
    """Return the position (3,) [m] and the quaternion x, y, z, w (4,) of a pose in the plane (3,) [m, m, rad]."""
    from scipy.spatial.transform import Rotation

    position = plane.axes @ np.array([pose[0], pose[1], plane.height])
    rotation = Rotation.from_matrix(plane.axes) * Rotation.from_euler("z", pose[2])
    return position, rotation.as_quat()


def spatial_covariance(plane: Plane, pose: Array, covariance: Array) -> Array:
    """Return a covariance (6, 6) [m, rad] about the axes of the plane's frame, order x, y, z, turns about x, y, z.

    It is that of a pose in the plane (3,) with its covariance (3, 3) in the tangent space at the pose (right, body
    frame), order x, y, theta. Directions out of the plane have zero variance.
    """
    axes_T_body = np.zeros((6, 3))
    axes_T_body[:3, :2] = plane.axes[:, :2] @ se2.rotation(pose[2])
    axes_T_body[3:, 2] = plane.axes[:, 2]
    return axes_T_body @ covariance @ axes_T_body.T


def flat(frame: str = "world") -> Plane:
    """Return the plane of the x and y axes of a frame."""
    return Plane(frame, np.eye(3), 0.0)
