"""Plausibility of a stream's times and poses, and sentences on its rate and its direction of pushing.

A single outlier is refused. If the frames after it agree with it, the stream has really changed, as by a clock that was
set, and is accepted.
"""

import cmath
import math
from collections import deque
from statistics import median

from palpate.arrays import Array
from palpate.checks import other_time_unit
from palpate.errors import FrameError

Pose = tuple[float, float, float]

_LONGEST_GAP = 60.0  # [s] between frames; a clock that jumps farther is accepted at its second frame
_AGREE = 3  # implausible poses in a row that agree with each other are accepted
_HISTORY = 9  # poses kept, 0.3 s at 30 Hz

# Largest acceleration [m/s^2, rad/s^2] and speed [m/s, rad/s] of a robot arm, and error of a measured pose [m, rad]. A
# pusher at 0.25 m/s deviates from constant velocity by at most 3 mm a frame at 30 Hz; 16 mm are allowed.
_ACCELERATION, _SPEED, _ERROR = (10.0, 100.0), (2.0, 20.0), (5e-3, 0.1)
_METRES = 10.0  # [m] from the origin, farther than most robots reach: coordinates beyond may be millimetres

# A pose is frozen if it repeats this often, begins to from more than this share of its speed, and hides this much [m].
_REPEATS, _SUDDEN, _HIDDEN = 4, 0.5, 2e-3
_FIRST_STEP = 1e-3  # [m] after a standstill of 3 frames: 0.9 m/s^2 at 30 Hz, so the robot really stood

_PAUSE = 10  # intervals without a frame after which a contact is a new one
_LATELY = 15  # frames, half a second at 30 Hz
_SLOW, _LONGEST = 1.5, 3.0  # nominal intervals, in the mean; a single gap counts no more than the latter
_SIDEWAYS, _PUSHED = math.radians(70.0), 0.02  # angle of the push to the sensor's x axis, and its least length [m]


class PoseMonitor:
    """Refuses implausible times and poses, detects poses that are frozen, and names a weakness of the stream."""

    def __init__(self, rate: float) -> None:
        """Take the sensor's frame rate [Hz]."""
        self._rate = rate
        self._last: tuple[float, Pose] | None = None  # time [s] and pose
        self._different: deque[tuple[float, Pose]] = deque(maxlen=_HISTORY)  # the last ones that differ
        self._repeats = 0  # identical poses in a row
        self._stands_exactly = False  # this robot has stood at one exact pose and moved on from there
        self._elsewhere: list[tuple[float, Pose]] = []  # implausible poses in a row that agree with each other
        self._implausible_time: float | None = None
        self._in_contact = self._saw_touch = False
        self._intervals: deque[float] = deque(maxlen=_LATELY)  # [s]
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
        if gap > _LONGEST_GAP and not (before is not None and 0.0 < time - before <= _LONGEST_GAP):
            unit = other_time_unit(gap, self._rate)
            raise FrameError(
                f"frame at {time:.3f} s comes {gap:.3g} s after the last one, more than {_LONGEST_GAP:g} s; the next "
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
        self._stands_exactly |= not repeats and self._repeats >= 3 and step < _FIRST_STEP
        # After a release within the interval, the object was pushed at most at the speed before.
        moving = self._repeats == 1 and len(self._different) > 1
        self.pushed = step if in_contact else min(step, self._speed(2) * interval) if moving else 0.0
        self._implausible_time = None
        jumps = goes_on and not self._is_plausible(interval, last, pose)
        if jumps:
            self._refuse_unless_confirmed(time, pose, interval, last)
        is_elsewhere = jumps or (goes_on and self.hidden > 0.0 and not repeats)
        is_late = interval > _PAUSE * max(1.0 / self._rate, median(self._intervals or (0.0,)))
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
        relative = [min(each * self._rate, _LONGEST) for each in self._intervals]
        if sum(relative) >= max(_LATELY, _SLOW * len(relative)):
            rate = len(self._intervals) / sum(self._intervals)
            advice = other_time_unit(1.0 / rate, self._rate) or "the pose is known less well"
            return f"frames come {rate:.2g} times a second and not {self._rate:g} times; {advice}"
        angle = cmath.phase(self._pushed)
        if abs(self._pushed) < _PUSHED or abs(angle) < _SIDEWAYS:
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
        if self._stands_exactly or self._repeats < _REPEATS or len(self._different) < _HISTORY:
            return 0.0
        speed, before = self._speed(3), self._speed(_HISTORY)
        distance = before * (time - self._different[-1][0])
        return distance if speed > _SUDDEN * before and distance > _HIDDEN else 0.0

    def _is_plausible(self, interval: float, last: Pose, pose: Pose) -> bool:
        """Compare with the motion so far: at constant velocity, up to the largest acceleration."""
        if len(self._different) < 2:
            return _is_within(last, pose, _SPEED, interval)
        if self._repeats == 1:
            (first_time, first), (second_time, second) = self._different[-2], self._different[-1]
            share = min(interval / (second_time - first_time), 2.0)
            yaw = last[2] + share * math.remainder(second[2] - first[2], math.tau)
            last = last[0] + share * (second[0] - first[0]), last[1] + share * (second[1] - first[1]), yaw
        usual = max(interval, 1.0 / self._rate)  # times may jitter
        return _is_within(last, pose, _ACCELERATION, usual**2)

    def _refuse_unless_confirmed(self, time: float, pose: Pose, interval: float, last: Pose) -> None:
        before, there = self._elsewhere[-1] if self._elsewhere else (time, pose)
        if not _is_within(there, pose, _SPEED, time - before):
            self._elsewhere = []
        self._elsewhere.append((time, pose))
        if len(self._elsewhere) >= _AGREE:
            return
        step, turn = _apart(last, pose)
        unit = "; are these millimetres?" if max(abs(pose[0]), abs(pose[1])) > _METRES else ""
        if step < _ERROR[0] + _SPEED[0] * interval and turn > _ERROR[1] + _SPEED[1] * interval:
            unit = "; is theta in degrees?"
        raise FrameError(
            f"frame at {time:.3f} s has the sensor {step:.3g} m and {math.degrees(turn):.0f} degrees from where it "
            f"was {interval:.3g} s before, in one contact, faster than any arm; {_AGREE} in a row that agree are "
            f"believed{unit}"
        )


def _apart(one: Pose, other: Pose) -> tuple[float, float]:
    """Return the distance [m] and angle [rad] between two poses."""
    return math.hypot(other[0] - one[0], other[1] - one[1]), abs(math.remainder(other[2] - one[2], math.tau))


def _is_within(one: Pose, other: Pose, rate: tuple[float, float], factor: float) -> bool:
    """Return True if poses are as near as a motion of this rate times a factor lets them be, and errors of poses."""
    step, turn = _apart(one, other)
    return step <= _ERROR[0] + rate[0] * factor and turn <= _ERROR[1] + rate[1] * factor
