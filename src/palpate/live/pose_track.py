"""The latest sensor poses, and the sensor's pose at the time of an image."""

import threading
from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.live.sources import Refused, TimedPose

Array = NDArray[np.float64]


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


TIMING = PoseTiming()


class SensorPlace(NamedTuple):
    """Sensor pose at the time of an image."""

    pose: Array
    """world_T_sensor, (3,) [m, m, rad]."""
    how: Literal["known", "extrapolated", "held"]
    """Interpolated between two poses, extrapolated from the last ones, or the last pose itself."""
    age: float
    """Time from the last pose to the image [s]; 0 if a pose follows the image."""


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

    def at(self, time: float) -> SensorPlace | None:
        """Return the sensor's pose at a time [s], after a short wait for a pose that follows it; None if unknown."""
        with self._changed:
            if not self._poses or time - self._poses[-1].time < TIMING.stalled:
                self._changed.wait_for(lambda: bool(self._poses) and self._poses[-1].time >= time, TIMING.patience)
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
        return SensorPlace(_interpolated(before, after, time), "known", 0.0)

    def _after_last(self, last: TimedPose, time: float) -> SensorPlace | None:
        age = time - last.time
        if age > TIMING.held:
            return None
        earlier = next(pose for pose in self._poses if pose.time >= last.time - TIMING.baseline)
        if age > TIMING.extrapolated or earlier is last:
            return SensorPlace(last.pose, "held", age)
        return SensorPlace(_interpolated(earlier, last, time), "extrapolated", age)


def _interpolated(start: TimedPose, end: TimedPose, time: float) -> Array:
    """Return the pose at a time [s] on the straight line through two poses, turning by less than half a turn."""
    step = end.pose - start.pose
    step[2] = se2.wrap(step[2])
    pose = start.pose + (time - start.time) / (end.time - start.time) * step
    pose[2] = se2.wrap(pose[2])
    return pose
