"""Sensor poses as they arrive, and the sensor's pose at the time of an image."""

import math
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2

Array = NDArray[np.float64]


class TimedPose(NamedTuple):
    """Sensor pose at one time."""

    time: float
    """Time on the session's clock [s]."""
    pose: Array
    """world_T_sensor, (3,) [m, m, rad]."""


class Refused(NamedTuple):
    """Something that arrived in place of a usable pose."""

    reason: str
    """The fault, in words."""


PoseSource = Callable[[threading.Event], Iterator[TimedPose | Refused | str]]
"""Yields poses as they arrive and, as text, notes for the user; ends when the event is set."""


@dataclass(frozen=True)
class PoseTiming:
    """Limits on the age of sensor poses."""

    patience: float = 0.01
    """Time that an image waits for a pose after it [s]."""
    stalled: float = 0.1
    """Age of the last pose from which images no longer wait for the next one [s]."""
    extrapolated: float = 0.05
    """Age up to which the last motion is extrapolated [s]."""
    held: float = 0.2
    """Age up to which the last pose is held [s]; an older one leaves the image without a pose."""
    baseline: float = 0.05
    """Span of poses from which the speed is extrapolated [s]."""
    longest_gap: float = 0.5
    """Gap between two poses beyond which nothing is interpolated [s]."""
    max_clock_error: float = 1.0
    """Difference between a pose's time and this computer's clock beyond which it is refused [s]."""


TIMING = PoseTiming()


@dataclass(frozen=True, eq=False)
class SensorPlace:
    """Sensor pose at the time of an image."""

    pose: Array
    """world_T_sensor, (3,) [m, m, rad]."""
    how: Literal["known", "extrapolated", "held"]
    """Interpolated between two poses, extrapolated from the last ones, or the last pose itself."""
    age: float
    """Time from the last pose to the image [s]; 0 if a pose follows the image."""


def checked_pose(time: Any, numbers: Any) -> TimedPose | Refused:
    """Return the pose x [m], y [m], theta [rad] at a time [s], or the reason why it is refused."""
    try:
        when, pose = float(time), np.array(numbers, np.float64)
    except (TypeError, ValueError, OverflowError):
        return Refused(f"time {time!r} and pose {numbers!r} are not numbers")
    if pose.shape != (3,) or not np.isfinite(pose).all() or not math.isfinite(when):
        return Refused(f"time {time!r}, pose {numbers!r}; allowed are finite numbers: time, and x, y, theta")
    return TimedPose(when, pose)


def on_clock(pose: TimedPose | Refused, now: float) -> TimedPose | Refused:
    """Return the pose, or refuse it if its time is far off this computer's clock, `now` [s]."""
    if isinstance(pose, TimedPose) and abs(pose.time - now) > TIMING.max_clock_error:
        return Refused(f"its time {pose.time:.3f} s is {pose.time - now:+.1f} s off this computer's clock")
    return pose


class PoseTrack:
    """The latest sensor poses; one thread adds them while another interpolates."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._poses: deque[TimedPose] = deque(maxlen=4096)

    @property
    def last_time(self) -> float | None:
        """Time of the last pose [s]; None before the first."""
        with self._changed:
            return self._poses[-1].time if self._poses else None

    def add(self, pose: TimedPose) -> Refused | None:
        """Add a pose; refuse one that is not later than the last."""
        with self._changed:
            if self._poses and pose.time <= self._poses[-1].time:
                return Refused(f"its time {pose.time:.3f} s is not after the last one's, {self._poses[-1].time:.3f} s")
            self._poses.append(pose)
            self._changed.notify_all()
        return None

    def at(self, time: float, patience: float = TIMING.patience) -> SensorPlace | None:
        """Return the sensor's pose at a time [s], waiting up to `patience` [s] for a pose after it.

        None if it is unknown.
        """
        with self._changed:
            if not self._poses or time - self._poses[-1].time < TIMING.stalled:
                self._changed.wait_for(lambda: bool(self._poses) and self._poses[-1].time >= time, patience)
            if not self._poses or time < self._poses[0].time:
                return None
            last = self._poses[-1]
            if time > last.time:
                return self._after_last(last, time)
            if time == last.time:
                return SensorPlace(last.pose, "known", 0.0)
            after, before = next(pair for pair in pairwise(reversed(self._poses)) if pair[1].time <= time)
        if after.time - before.time > TIMING.longest_gap:
            return None
        share = (time - before.time) / (after.time - before.time)
        return SensorPlace(interpolate(before.pose, after.pose, share), "known", 0.0)

    def _after_last(self, last: TimedPose, time: float) -> SensorPlace | None:
        age = time - last.time
        if age > TIMING.held:
            return None
        earlier = next(pose for pose in self._poses if pose.time >= last.time - TIMING.baseline)
        if age > TIMING.extrapolated or earlier is last:
            return SensorPlace(last.pose, "held", age)
        share = (time - earlier.time) / (last.time - earlier.time)
        return SensorPlace(interpolate(earlier.pose, last.pose, share), "extrapolated", age)


def interpolate(start: Array, end: Array, share: float) -> Array:
    """Return the pose at a share of the straight way between two poses (3,), turning by less than half a turn."""
    difference = end - start
    difference[2] = se2.wrap(difference[2])
    pose = start + share * difference
    pose[2] = se2.wrap(pose[2])
    return pose
