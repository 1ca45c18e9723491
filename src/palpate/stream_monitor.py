"""Plausibility of a stream's times and poses, and sentences on its rate and its direction of pushing.

A single outlier is refused. If the frames after it agree with it, the stream has really changed, as by a clock that was
set, and is accepted.
"""

import cmath
import math
from collections import deque
from statistics import median

from palpate.arrays import Array
from palpate.checks import SPAN, other_time_unit
from palpate.config import ACCELERATION, HIDDEN, LARGEST_ERROR, LONGEST_GAP, RECENT, SEVERAL, SIDEWAYS, SLOW, SUDDEN
from palpate.errors import FrameError

Pose = tuple[float, float, float]


class PoseMonitor:
    """Refuses implausible times and poses, detects poses that are frozen, and names a weakness of the stream."""

    def __init__(self, rate: float) -> None:
        """Take the sensor's frame rate [Hz]."""
        self._rate = rate
        self._last: tuple[float, Pose] | None = None  # time [s] and pose
        self._different: deque[tuple[float, Pose]] = deque(maxlen=RECENT)  # the last ones that differ
        self._repeats = 0  # identical poses in a row
        self._stands_exactly = False  # this robot has stood at one exact pose and moved on from there
        self._elsewhere: list[tuple[float, Pose]] = []  # implausible poses in a row that agree with each other
        self._implausible_time: float | None = None
        self._in_contact = self._saw_touch = False
        self._intervals: deque[float] = deque(maxlen=RECENT)  # [s]
        self._moved = self._pushed = 0j  # [m] in the sensor frame: since the frame before, and in contacts
        self.hidden = 0.0
        """Possible motion in a contact while the pose is frozen [m]."""
        self.pushed = 0.0
        """Largest distance by which the sensor may have pushed the object since the frame before [m]."""
        self.drawn_back = 0.0
        """Distance along its x axis from the sensor back to its farthest point in this contact [m]."""

    def check_time(self, time: float) -> None:
        """Raise FrameError on a time [s] that is far ahead, unless the one before was as well."""
        gap = time - self._last[0] if self._last else 0.0
        before, self._implausible_time = self._implausible_time, time
        if gap > LONGEST_GAP and not (before is not None and 0.0 < time - before <= LONGEST_GAP):
            unit = other_time_unit(gap, self._rate)
            raise FrameError(
                f"frame at {time:.3f} s comes {gap:.3g} s after the last one, more than {LONGEST_GAP:g} s; the next "
                f"that follows it is taken{unit and '; '}{unit}"
            )

    def check_pose(self, time: float, measured: Array, in_contact: bool) -> bool:
        """Take a pose (3,) [m, m, rad]; return True if the sensor was not observed before, or cannot have moved here.

        Raises FrameError on a jump in a contact; between contacts it does no harm.
        """
        x, y, yaw = measured.tolist()
        pose = x, y, yaw
        last_time, last = self._last or (time, pose)
        interval, step = time - last_time, _apart(last, pose)[0]
        repeats, goes_on = self._last is not None and last == pose, in_contact and self._in_contact
        self._stands_exactly |= not repeats and self._repeats >= SEVERAL and step < HIDDEN
        # After a release within the interval, the object was pushed at most at the speed before.
        moving = self._repeats == 1 and len(self._different) > 1
        self.pushed = step if in_contact else min(step, self._speed(2) * interval) if moving else 0.0
        self._implausible_time = None
        jumps = goes_on and not self._is_plausible(interval, last, pose)
        if jumps:
            self._refuse_unless_confirmed(time, pose, interval, last)
        is_elsewhere = jumps or (goes_on and self.hidden > 0.0 and not repeats)
        is_late = interval > RECENT * max(1.0 / self._rate, median(self._intervals or (0.0,)))
        if self._last is not None:
            self._intervals.append(interval)
        self._moved = complex(x - last[0], y - last[1]) * cmath.rect(1.0, -yaw)
        self._elsewhere, self._last, self._in_contact = [], (time, pose), in_contact
        if is_elsewhere or not (goes_on or (repeats and self._frozen(time))):
            self._different.clear()
            self.drawn_back = 0.0
        elif goes_on:
            self.drawn_back = max(self.drawn_back - self._moved.real, 0.0)
        if not self._different or (goes_on and not repeats):
            self._different.append((time, pose))
        self._repeats = self._repeats + 1 if repeats and not is_elsewhere else 1
        self.hidden = self._frozen(time) if in_contact else 0.0
        return is_elsewhere or is_late

    def weakness(self, sees_touch: bool) -> str:
        """Return a sentence on the rate or the direction of pushing, if it makes the estimate worse; else "".

        Contact without an image does not count, as a tip may be round and its frame lie anyhow.
        """
        self._pushed += self._moved if sees_touch and self._saw_touch else 0.0
        self._saw_touch = sees_touch
        usual = sum(sorted(self._intervals)[:-1]) / (RECENT - 1)  # a single gap does not count
        if len(self._intervals) == RECENT and usual * self._rate >= SLOW:
            advice = other_time_unit(usual, self._rate) or "the pose is known less well"
            return f"frames come {1.0 / usual:.2g} times a second and not {self._rate:g} times; {advice}"
        angle = cmath.phase(self._pushed)
        if abs(angle) < SIDEWAYS or abs(self._pushed) * math.cos(SIDEWAYS) < LARGEST_ERROR[0]:  # or it may be an error
            return ""
        axis = ("+x", "+y", "-x", "-y")[round(angle / (0.5 * math.pi)) % 4]
        return f"the sensor moves along {axis} of its own frame in contact; its x axis must point along the push"

    def _speed(self, count: int) -> float:
        """Return the mean speed [m/s] over the last different poses."""
        (first_time, first), (time, last) = self._different[-count], self._different[-1]
        return _apart(first, last)[0] / (time - first_time)

    def _frozen(self, time: float) -> float:
        """Return the distance that the sensor may have moved while its pose was frozen [m], 0 if it is not.

        A robot slows down before it stands, so a pose that repeats from full speed on is frozen. If it once moved on
        from where it stood, its stream reports commands, in which repeats mean nothing.
        """
        if self._stands_exactly or self._repeats <= SEVERAL or len(self._different) < RECENT:
            return 0.0
        speed, before = self._speed(SEVERAL), self._speed(RECENT)
        distance = before * (time - self._different[-1][0])
        return distance if speed > SUDDEN * before and distance > HIDDEN else 0.0

    def _is_plausible(self, interval: float, last: Pose, pose: Pose) -> bool:
        """Compare with the motion so far: at constant velocity, up to the largest acceleration."""
        if self._repeats == 1 and len(self._different) > 1:
            (first_time, first), (second_time, second) = self._different[-2], self._different[-1]
            share = min(interval / (second_time - first_time), 2.0)
            yaw = last[2] + share * math.remainder(second[2] - first[2], math.tau)
            last = last[0] + share * (second[0] - first[0]), last[1] + share * (second[1] - first[1]), yaw
        return self._is_within(last, pose, interval) == (True, True)

    def _is_within(self, one: Pose, other: Pose, interval: float) -> tuple[bool, bool]:
        """Return True for distance and angle if a robot may come from rest at one pose to the other in a time [s]."""
        usual = max(interval, 1.0 / self._rate)  # times may jitter
        limits = (error + most * usual**2 for error, most in zip(LARGEST_ERROR, ACCELERATION, strict=True))
        near, level = (found <= limit for found, limit in zip(_apart(one, other), limits, strict=True))
        return near, level

    def _refuse_unless_confirmed(self, time: float, pose: Pose, interval: float, last: Pose) -> None:
        before, there = self._elsewhere[-1] if self._elsewhere else (time, pose)
        if self._is_within(there, pose, time - before) != (True, True):
            self._elsewhere = []
        self._elsewhere.append((time, pose))
        if len(self._elsewhere) >= SEVERAL:
            return
        step, turn = _apart(last, pose)
        unit = "; are these millimetres?" if max(abs(pose[0]), abs(pose[1])) > SPAN else ""
        if self._is_within(last, pose, interval) == (True, False):
            unit = "; is theta in degrees?"
        raise FrameError(
            f"frame at {time:.3f} s has the sensor {step:.3g} m and {math.degrees(turn):.0f} degrees from where it "
            f"was {interval:.3g} s before, in one contact, faster than any arm; {SEVERAL} in a row that agree are "
            f"believed{unit}"
        )


def _apart(one: Pose, other: Pose) -> tuple[float, float]:
    """Return the distance [m] and angle [rad] between two poses."""
    return math.hypot(other[0] - one[0], other[1] - one[1]), abs(math.remainder(other[2] - one[2], math.tau))
