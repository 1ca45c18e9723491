"""Ground truth in the robot's world: table and recording aligned by the tag on the sensor.

The robot measures the sensor's pose, the video that of the sensor's tag: world_T_table * table_T_tag equals
world_T_sensor * sensor_T_tag at the same time. The unknowns are world_T_table, sensor_T_tag and the delay.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from palpate.arrays import Array, Flags
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.io.recording import Recording
from palpate_lab.truth.camera import TagTrack, laid_over


@dataclass(frozen=True, eq=False)
class Alignment:
    """Relation of video and recording."""

    world_T_table: Array
    """(3,) [m, m, rad]"""
    sensor_T_tag: Array
    """(3,) [m, m, rad]"""
    delay: float
    """Time of the recording less that of the video [s]."""
    sigma: Array
    """Standard deviations of the table's pose, (3,) [m, m, rad], and of the delay [s]: (4,)."""
    residual: float
    """Distance of the sensor's tag between video and robot, root mean square [m]."""


def align(time: Array, sensor_pose: Array, tag: TagTrack) -> Alignment:
    """Fit the sensor's poses in the world (N, 3) at times (N,) [s] to its tag in the video.

    Raises FileError if they overlap too little, or the sensor turns too little to locate the table to 1 mm.
    """
    angle = np.unwrap(sensor_pose[:, 2])

    def sensor_at(when: Array) -> Array:
        return np.column_stack([np.interp(when, time, values) for values in (*sensor_pose[:, :2].T, angle)])

    def difference(unknowns: Array, used: Flags) -> Array:
        by_video = se2.compose(unknowns[:3], tag.pose[used])
        by_robot = se2.compose(sensor_at(tag.time[used] + unknowns[6]), unknowns[3:6])
        return se2.between(by_robot, by_video)

    turned = np.degrees(np.ptp(angle))
    advice = "let it turn by 60 or more in the recording, best before the first push"
    if turned < 10.0:
        raise FileError(f"the sensor turns by {turned:.0f} degrees; {advice}")
    delay = _delay(time, angle, tag) if len(tag.time) > 1 else 0.0
    used = (tag.time + delay > time[0]) & (tag.time + delay < time[-1])
    if used.sum() < 20:
        raise FileError(f"the sensor's tag is seen in {used.sum()} pictures of the recording's time, 20 are needed")
    start = _first_guess(sensor_at(tag.time[used] + delay), tag.pose[used], delay)
    noise = tag.sigma + np.array([1e-4, 1e-4, 1e-3])  # [m, m, rad], the latter of the robot

    def residuals(unknowns: Array) -> Array:
        # The tag is within some 5 cm of the sensor's origin.
        return np.concatenate([(difference(unknowns, used) / noise).ravel(), unknowns[3:5] / 0.05])

    fit = least_squares(residuals, start, loss="soft_l1", x_scale=[0.1, 0.1, 0.1, 0.01, 0.01, 0.1, 0.01])
    # Errors of robot and video last for many pictures; a tenth of them count.
    covariance = 10.0 * np.linalg.inv(fit.jac.T @ fit.jac)
    sigma = np.sqrt(np.diag(covariance))[[0, 1, 2, 6]]
    largest = sigma[:2].max()
    if largest > 1e-3:
        raise FileError(
            f"the table's place in the world is known to {largest * 1e3:.1f} mm only: the sensor turns by "
            f"{turned:.0f} degrees; {advice}"
        )
    off = difference(fit.x, used)[:, :2]
    rms = float(np.sqrt((off**2).sum(axis=1).mean()))
    return Alignment(fit.x[:3], fit.x[3:6], float(fit.x[6]), sigma, rms)


def _first_guess(sensor: Array, tag: Array, delay: float) -> Array:
    """Return table, mounting of the tag and delay, (7,), by poses (N, 3) of sensor and tag at the same times."""
    table = laid_over(tag[:, :2], sensor[:, :2])
    mounting = se2.between(sensor, se2.compose(table, tag))
    turn = np.angle(np.exp(1j * mounting[:, 2]).mean())
    return np.concatenate([table, [0.0, 0.0, turn], [delay]])


def with_truth(recording: Recording, tag: TagTrack, alignment: Alignment) -> Recording:
    """Return the recording with the object's poses in the world from its tag in the video; NaN if it is not seen.

    Its `extra` has their standard deviations as object_pose_sigma, (N, 3) [m, m, rad].
    """
    table = alignment.sigma[:3]
    away = np.linalg.norm(tag.pose[:, :2], axis=1, keepdims=True)
    place = np.sqrt(tag.sigma[:2] ** 2 + table[:2] ** 2 + (table[2] * away) ** 2)
    sigma = np.column_stack([place, np.full(len(away), np.hypot(tag.sigma[2], table[2]))])
    pose = se2.compose(alignment.world_T_table, tag.pose)
    pose, sigma = _at_times(recording.time, tag.time + alignment.delay, pose, sigma)
    return replace(recording, object_pose=pose, extra={**recording.extra, "object_pose_sigma": sigma})


def _at_times(when: Array, time: Array, pose: Array, sigma: Array) -> tuple[Array, Array]:
    """Return poses and sigmas (M, 3) at times (M,), from (N, 3) at times (N,); NaN in gaps above 0.1 s and outside."""
    after = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    known = ((when >= time[0]) & (when <= time[-1]) & (time[after] - time[after - 1] <= 0.1))[:, None]
    spread = np.column_stack([np.interp(when, time, values) for values in sigma.T])
    return np.where(known, se2.interpolated(when, time, pose), np.nan), np.where(known, spread, np.nan)


def _delay(time: Array, angle: Array, tag: TagTrack) -> float:
    """Return the delay [s] at which the turning rates of sensor and tag differ least, independent of the mounting.

    All of the video counts; the sensor is taken to rest before and after its recording.
    """
    step = 0.01  # [s]

    def turns(when: Array, turned: Array) -> Array:
        return np.diff(np.interp(np.arange(when[0], when[-1], step), when, turned))

    robot = turns(time, angle)
    video = turns(tag.time, np.unwrap(tag.pose[:, 2]))
    agreement = 2.0 * np.correlate(robot, video, "full") - np.correlate(robot**2, np.ones(len(video)), "full")
    return float((np.argmax(agreement) - (len(video) - 1)) * step + time[0] - tag.time[0])
