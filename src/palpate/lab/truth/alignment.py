"""Where the table is in the robot's world, where the tag is on the sensor, and how late the video is.

The robot says where the sensor is, the video where the sensor's tag is: world_T_table * table_T_tag is
world_T_sensor * sensor_T_tag at the same time. All three unknowns are those that fit best.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from palpate.errors import FileError
from palpate.geometry import se2
from palpate.lab.truth.watched import Watched

Array = NDArray[np.float64]

FEWEST = 20
"""Pictures of the sensor's tag that are needed."""
LEAST_TURN = 10.0
"""[degrees] of the sensor's turning that are needed to begin with."""
TURN_MORE = "let it turn by 60 or more in the recording, best before the first push"
"""What helps."""
LARGEST_SIGMA = 1e-3
"""[m] standard deviation of the table's place in the world, above which a recording does not tell it."""

_STEP = 0.01  # [s] of the speeds that are compared
_ROBOT = np.array([1e-4, 1e-4, 1e-3])  # [m, m, rad] how well a robot knows its own poses
_MOUNT = 0.05  # [m] how far a tag may be from the sensor's origin


@dataclass(frozen=True, eq=False)
class Alignment:
    """How video and recording go together."""

    world_T_table: Array
    """(3,) [m, m, rad]"""
    sensor_T_tag: Array
    """(3,) [m, m, rad]"""
    delay: float
    """Time of the recording less that of the video [s]."""
    sigma: Array
    """Standard deviations of the table's pose, (3,) [m, m, rad], and of the delay [s]: (4,)."""
    residual: float
    """How far the two ways to the tag end apart, root mean square [m]."""


def align(time: Array, sensor_pose: Array, tag: Watched) -> Alignment:
    """Fit the sensor's poses in the world (N, 3) at times (N,) [s] to its tag in the video.

    Raises FileError where they have too little in common, or the sensor does not turn.
    """
    angle = np.unwrap(sensor_pose[:, 2])

    def sensor_at(when: Array) -> Array:
        columns = [np.interp(when, time, values) for values in (*sensor_pose[:, :2].T, angle)]
        return np.column_stack(columns)

    def apart(unknowns: Array, used: NDArray[np.bool_]) -> Array:
        by_video = se2.compose(unknowns[:3], tag.pose[used])
        by_robot = se2.compose(sensor_at(tag.time[used] + unknowns[6]), unknowns[3:6])
        difference = se2.between(by_robot, by_video)
        return difference / (tag.sigma + _ROBOT)

    _check_enough(len(tag.time))
    turned = np.degrees(np.ptp(angle))
    if turned < LEAST_TURN:
        raise FileError(f"the sensor turns by {turned:.0f} degrees; {TURN_MORE}")
    delay = _delay(time, angle, tag)
    used = (tag.time + delay > time[0]) & (tag.time + delay < time[-1])
    _check_enough(int(used.sum()))
    table = _rough(sensor_at(tag.time[used] + delay), tag.pose[used])
    mount = se2.between(sensor_at(tag.time[used] + delay), se2.compose(table, tag.pose[used]))
    start = np.concatenate([table, [0.0, 0.0, np.angle(np.exp(1j * mount[:, 2]).mean())], [delay]])

    def residuals(unknowns: Array) -> Array:
        return np.concatenate([apart(unknowns, used).ravel(), unknowns[3:5] / _MOUNT])

    found = least_squares(residuals, start, loss="soft_l1", x_scale=[0.1, 0.1, 0.1, 0.01, 0.01, 0.1, 0.01])
    # Errors of the robot and of the video last for many pictures, a tenth of which count.
    covariance = 10.0 * np.linalg.inv(found.jac.T @ found.jac)
    sigma = np.sqrt(np.diag(covariance))[[0, 1, 2, 6]]
    if sigma[:2].max() > LARGEST_SIGMA:
        raise FileError(
            f"the table's place in the world is known to {sigma[:2].max() * 1e3:.1f} mm only: the sensor turns by "
            f"{turned:.0f} degrees; {TURN_MORE}"
        )
    off = apart(found.x, used)[:, :2] * (tag.sigma[:2] + _ROBOT[:2])
    rms = float(np.sqrt((off**2).sum(axis=1).mean()))
    return Alignment(found.x[:3], found.x[3:6], float(found.x[6]), sigma, rms)


def _check_enough(seen: int) -> None:
    if seen < FEWEST:
        raise FileError(f"the sensor's tag is seen in {seen} pictures of the recording's time, {FEWEST} are needed")


def _delay(time: Array, angle: Array, tag: Watched) -> float:
    """The delay by which sensor and tag turn most alike [s]; their turning does not depend on how the tag is mounted.

    It makes the squared difference of the two rates least, of the whole video, the sensor at rest before and after its
    recording.
    """
    robot, video = _turning(time, angle), _turning(tag.time, np.unwrap(tag.pose[:, 2]))
    alike = 2.0 * np.correlate(robot, video, "full") - np.correlate(robot**2, np.ones(len(video)), "full")
    return float((np.argmax(alike) - (len(video) - 1)) * _STEP + time[0] - tag.time[0])


def _turning(time: Array, angle: Array) -> Array:
    return np.diff(np.interp(np.arange(time[0], time[-1], _STEP), time, angle))


def _rough(sensor: Array, tag: Array) -> Array:
    """world_T_table that lays the tag's way on the sensor's, (3,)."""
    a, b = tag[:, :2] - tag[:, :2].mean(axis=0), sensor[:, :2] - sensor[:, :2].mean(axis=0)
    angle = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    moved = sensor[:, :2].mean(axis=0) - se2.rotation(np.array(angle)) @ tag[:, :2].mean(axis=0)
    return np.array([*moved, angle])
