"""Sensor poses as they come, and where the sensor was when an image was taken."""

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
from palpate.types.motion import LONGEST_GAP

Array = NDArray[np.float64]

PATIENCE = 0.01
"""[s] that an image waits for the pose after it."""
STALLED = 0.1
"""[s] without a pose after which the source has stalled; images no longer wait for it."""
LONGEST_EXTRAPOLATED, LONGEST_HELD = 0.05, 0.2
"""[s] after the last pose up to which it is carried on, and then held; later, nobody knows where the sensor is."""

_BASELINE = 0.05  # [s] of poses that tell how fast the sensor moves
_KEPT = 4096  # poses


class TimedPose(NamedTuple):
    """Where the sensor was at one time."""

    time: float
    """[s], by the session's clock."""
    pose: Array
    """world_T_sensor, (3,) [m, m, rad]."""


class Refused(NamedTuple):
    """Something that came in place of a pose."""

    reason: str
    """What is wrong with it, in words."""


PoseSource = Callable[[threading.Event], Iterator[TimedPose | Refused | str]]
"""Gives the poses as they come, and in between, in words, what is to be said of the source; ends at the event."""


@dataclass(frozen=True, eq=False)
class SensorPlace:
    """Where the sensor was when an image was taken."""

    pose: Array
    """world_T_sensor, (3,) [m, m, rad]."""
    how: Literal["known", "extrapolated", "held"]
    """Between two poses or at one; carried on from the last ones; or the last one."""
    age: float
    """How long before the image the last pose was [s]; 0 where one came after it."""


def checked_pose(time: Any, numbers: Any) -> TimedPose | Refused:
    """A pose from what somebody else says: a time [s], and x [m], y [m], theta [rad]."""
    try:
        when, pose = float(time), np.array(numbers, np.float64)
    except (TypeError, ValueError, OverflowError):
        return Refused(f"time {time!r} and pose {numbers!r} are not numbers")
    if pose.shape != (3,) or not np.isfinite(pose).all() or not math.isfinite(when):
        return Refused(f"time {time!r}, pose {numbers!r}; allowed are finite numbers: time, and x, y, theta")
    return TimedPose(when, pose)


class PoseTrack:
    """The last poses of a sensor; one thread adds, another asks."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._poses: deque[TimedPose] = deque(maxlen=_KEPT)

    @property
    def last(self) -> float | None:
        """The time of the last pose [s]; None before the first."""
        with self._changed:
            return self._poses[-1].time if self._poses else None

    def add(self, pose: TimedPose) -> Refused | None:
        """Take a pose; one that is not later than the last is refused."""
        with self._changed:
            if self._poses and pose.time <= self._poses[-1].time:
                return Refused(f"its time {pose.time:.3f} s is not after the last one's, {self._poses[-1].time:.3f} s")
            self._poses.append(pose)
            self._changed.notify_all()
        return None

    def at(self, time: float, patience: float = PATIENCE) -> SensorPlace | None:
        """Where the sensor was at a time [s]; waits up to `patience` [s] for a pose after it. None if not known."""
        with self._changed:
            if not self._poses or time - self._poses[-1].time < STALLED:
                self._changed.wait_for(lambda: bool(self._poses) and self._poses[-1].time >= time, patience)
            if not self._poses or time < self._poses[0].time:
                return None
            last = self._poses[-1]
            if time > last.time:
                return self._later(last, time)
            if time == last.time:
                return SensorPlace(last.pose, "known", 0.0)
            # Images are new, so it is among the last poses.
            after, before = next(pair for pair in pairwise(reversed(self._poses)) if pair[1].time <= time)
        if after.time - before.time > LONGEST_GAP:
            return None
        share = (time - before.time) / (after.time - before.time)
        return SensorPlace(along(before.pose, after.pose, share), "known", 0.0)

    def _later(self, last: TimedPose, time: float) -> SensorPlace | None:
        age = time - last.time
        if age > LONGEST_HELD:
            return None
        earlier = next(pose for pose in self._poses if pose.time >= last.time - _BASELINE)
        if age > LONGEST_EXTRAPOLATED or earlier is last:
            return SensorPlace(last.pose, "held", age)
        share = (time - earlier.time) / (last.time - earlier.time)
        return SensorPlace(along(earlier.pose, last.pose, share), "extrapolated", age)


def along(start: Array, end: Array, share: float) -> Array:
    """The pose at a share of the way, which is straight, the angle changing by less than half a turn."""
    way = end - start
    way[2] = se2.wrap(way[2])
    pose = start + share * way
    pose[2] = se2.wrap(pose[2])
    return pose
