"""Plausibility of a stream's times and poses, and sentences on its rate and its direction of pushing.

A single outlier is refused. If the frames after it agree with it, the stream has really changed, as by a clock that was
set, and is accepted.
"""

import cmath
import math
from collections import deque
from statistics import median
from typing import NamedTuple

from palpate.arrays import Array
from palpate.checks import SPAN, other_time_unit
from palpate.config import LARGEST_ERROR
from palpate.errors import FrameError

_FRAMES_TO_CONFIRM = 3
"""Frames that must agree before a jump or a standstill is taken as real."""
_RECENT_FRAMES = 10
"""Frames over which speed and rate are measured."""
_LARGEST_ACCELERATION = 10.0, 100.0
"""[m/s^2, rad/s^2] of a robot arm: 11 mm a frame at 30 Hz, which 0.33 m/s makes."""
_LONGEST_GAP = 60.0
"""[s] between frames; a clock that jumps farther is accepted at its second frame."""
_SLOW_STREAM = 1.5
"""Mean interval between frames, in nominal ones, from which a stream is slow: a third of its frames are lost."""
_HARMLESS_MOTION = 2e-3
"""[m] of motion that may hide behind a pose that repeats, and does no harm."""
_SUDDEN_STOP = 0.5
"""Share of its usual speed from which a robot does not stop at once, so that a pose which repeats is frozen."""
_SIDEWAYS_PUSH = 1.22
"""[rad] 70 degrees from the sensor's x axis, from which a push is sideways."""

Pose = tuple[float, float, float]
"""x [m], y [m], theta [rad]."""


class _Sample(NamedTuple):
    """A pose of the stream with its time [s]."""

    time: float
    pose: Pose


class SensorMotion(NamedTuple):
    """Motion of the sensor up to a frame, as far as it was observed."""

    was_unobserved: bool
    """True if the sensor was not observed before this frame, or cannot have moved here as observed."""
    possible_push: float
    """Largest distance by which the sensor may have pushed the object since the frame before [m]."""
    hidden: float
    """Possible motion in a contact while the pose is frozen [m]."""
    drawn_back: float
    """Distance along its x axis from the sensor back to its farthest point in this contact [m]."""


class PoseMonitor:
    """Refuses implausible times and poses, detects poses that are frozen, and names a weakness of the stream."""

    def __init__(self, rate: float) -> None:
        """Take the sensor's frame rate [Hz]."""
        self._rate = rate
        self._last: _Sample | None = None
        self._different: deque[_Sample] = deque(maxlen=_RECENT_FRAMES)  # the last ones whose poses differ
        self._repeats = 0  # identical poses in a row
        self._stands_exactly = False  # this robot has stood at one exact pose and moved on from there
        self._elsewhere: list[_Sample] = []  # implausible poses in a row that agree with each other
        self._implausible_time: float | None = None
        self._in_contact = False
        self._saw_touch = False
        self._intervals: deque[float] = deque(maxlen=_RECENT_FRAMES)  # [s]
        self._moved = 0j  # [m] in the sensor frame, since the frame before
        self._pushed = 0j  # [m] in the sensor frame, in all contacts
        self._hidden = 0.0  # see SensorMotion
        self._drawn_back = 0.0

    def check_time(self, time: float) -> None:
        """Raise FrameError on a time [s] that is far ahead, unless the one before was as well."""
        gap = time - self._last.time if self._last else 0.0
        before = self._implausible_time
        self._implausible_time = time
        is_confirmed = before is not None and 0.0 < time - before <= _LONGEST_GAP
        if gap > _LONGEST_GAP and not is_confirmed:
            unit = other_time_unit(gap, self._rate)
            raise FrameError(
                f"frame at {time:.3f} s comes {gap:.3g} s after the last one, more than {_LONGEST_GAP:g} s; the next "
                f"that follows it is taken{unit and '; '}{unit}"
            )

    def check_pose(self, time: float, measured: Array, in_contact: bool) -> SensorMotion:
        """Take a pose (3,) [m, m, rad] and return the motion to it.

        Raises FrameError on a jump in a contact; between contacts it does no harm.
        """
        x, y, yaw = measured.tolist()
        now = _Sample(time, (x, y, yaw))
        last = self._last or now
        interval = time - last.time
        step, _ = _apart(last.pose, now.pose)
        repeats = self._last is not None and last.pose == now.pose
        goes_on = in_contact and self._in_contact
        if not repeats and self._repeats >= _FRAMES_TO_CONFIRM and step < _HARMLESS_MOTION:
            self._stands_exactly = True
        possible_push = step if in_contact else self._push_before_release(step, interval)
        self._implausible_time = None
        jumps = goes_on and not self._is_plausible(interval, last.pose, now.pose)
        if jumps:
            self._refuse_unless_confirmed(now, last)
        is_elsewhere = jumps or (goes_on and self._hidden > 0.0 and not repeats)
        usual_interval = max(1.0 / self._rate, median(self._intervals or (0.0,)))
        is_late = interval > _RECENT_FRAMES * usual_interval
        if self._last is not None:
            self._intervals.append(interval)
        self._moved = complex(x - last.pose[0], y - last.pose[1]) * cmath.rect(1.0, -yaw)
        self._elsewhere = []
        self._last = now
        self._in_contact = in_contact
        self._follow(now, repeats, goes_on, is_elsewhere)
        self._hidden = self._frozen(time) if in_contact else 0.0
        return SensorMotion(is_elsewhere or is_late, possible_push, self._hidden, self._drawn_back)

    def weakness(self, sees_touch: bool) -> str:
        """Return a sentence on the rate or the direction of pushing, if it makes the estimate worse; else "".

        Contact without an image does not count, as a tip may be round and its frame lie anyhow.
        """
        if sees_touch and self._saw_touch:
            self._pushed += self._moved
        self._saw_touch = sees_touch
        without_longest = sorted(self._intervals)[:-1]  # a single gap does not count
        usual = sum(without_longest) / (_RECENT_FRAMES - 1)
        if len(self._intervals) == _RECENT_FRAMES and usual * self._rate >= _SLOW_STREAM:
            advice = other_time_unit(usual, self._rate) or "the pose is known less well"
            return f"frames come {1.0 / usual:.2g} times a second and not {self._rate:g} times; {advice}"
        angle = cmath.phase(self._pushed)
        # A shorter motion may be an error of the stated poses.
        is_long = abs(self._pushed) * math.cos(_SIDEWAYS_PUSH) >= LARGEST_ERROR[0]
        if abs(angle) < _SIDEWAYS_PUSH or not is_long:
            return ""
        axis = ("+x", "+y", "-x", "-y")[round(angle / (0.5 * math.pi)) % 4]
        return f"the sensor moves along {axis} of its own frame in contact; its x axis must point along the push"

    def _follow(self, now: _Sample, repeats: bool, goes_on: bool, is_elsewhere: bool) -> None:
        """Take a plausible pose into the motion of this contact, or begin another motion with it."""
        stands_frozen = repeats and self._frozen(now.time) > 0.0
        if is_elsewhere or not (goes_on or stands_frozen):
            self._different.clear()
            self._drawn_back = 0.0
        elif goes_on:
            self._drawn_back = max(self._drawn_back - self._moved.real, 0.0)
        if not self._different or (goes_on and not repeats):
            self._different.append(now)
        self._repeats = self._repeats + 1 if repeats and not is_elsewhere else 1

    def _push_before_release(self, step: float, interval: float) -> float:
        """Return the distance [m] by which the object was pushed at most before a release within the interval [s].

        The sensor went on at most at the speed before.
        """
        is_moving = self._repeats == 1 and len(self._different) > 1
        return min(step, self._speed(2) * interval) if is_moving else 0.0

    def _speed(self, count: int) -> float:
        """Return the mean speed [m/s] over the last different poses."""
        first = self._different[-count]
        last = self._different[-1]
        distance, _ = _apart(first.pose, last.pose)
        return distance / (last.time - first.time)

    def _frozen(self, time: float) -> float:
        """Return the distance that the sensor may have moved while its pose was frozen [m], 0 if it is not.

        A robot slows down before it stands, so a pose that repeats from full speed on is frozen. If it once moved on
        from where it stood, its stream reports commands, in which repeats mean nothing.
        """
        stands_shortly = self._repeats <= _FRAMES_TO_CONFIRM or len(self._different) < _RECENT_FRAMES
        if self._stands_exactly or stands_shortly:
            return 0.0
        usual_speed = self._speed(_RECENT_FRAMES)
        distance = usual_speed * (time - self._different[-1].time)
        stopped_suddenly = self._speed(_FRAMES_TO_CONFIRM) > _SUDDEN_STOP * usual_speed
        return distance if stopped_suddenly and distance > _HARMLESS_MOTION else 0.0

    def _is_plausible(self, interval: float, last: Pose, pose: Pose) -> bool:
        """Compare with the motion so far: at constant velocity, up to the largest acceleration."""
        expected = last
        if self._repeats == 1 and len(self._different) > 1:
            first = self._different[-2]
            second = self._different[-1]
            share = min(interval / (second.time - first.time), 2.0)
            expected = (
                last[0] + share * (second.pose[0] - first.pose[0]),
                last[1] + share * (second.pose[1] - first.pose[1]),
                last[2] + share * math.remainder(second.pose[2] - first.pose[2], math.tau),
            )
        return self._is_within(expected, pose, interval) == (True, True)

    def _is_within(self, one: Pose, other: Pose, interval: float) -> tuple[bool, bool]:
        """Return True for distance and angle if a robot may come from rest at one pose to the other in a time [s]."""
        longest = max(interval, 1.0 / self._rate)  # times may jitter
        distance, angle = _apart(one, other)
        farthest = LARGEST_ERROR[0] + _LARGEST_ACCELERATION[0] * longest**2
        widest = LARGEST_ERROR[1] + _LARGEST_ACCELERATION[1] * longest**2
        return distance <= farthest, angle <= widest

    def _refuse_unless_confirmed(self, now: _Sample, last: _Sample) -> None:
        """Raise FrameError on a pose far from the last one, unless enough in a row agree with it."""
        before = self._elsewhere[-1] if self._elsewhere else now
        if self._is_within(before.pose, now.pose, now.time - before.time) != (True, True):
            self._elsewhere = []
        self._elsewhere.append(now)
        if len(self._elsewhere) >= _FRAMES_TO_CONFIRM:
            return
        interval = now.time - last.time
        distance, angle = _apart(last.pose, now.pose)
        unit = "; are these millimetres?" if max(abs(now.pose[0]), abs(now.pose[1])) > SPAN else ""
        if self._is_within(last.pose, now.pose, interval) == (True, False):
            unit = "; is theta in degrees?"
        raise FrameError(
            f"frame at {now.time:.3f} s has the sensor {distance:.3g} m and {math.degrees(angle):.0f} degrees from "
            f"where it was {interval:.3g} s before, in one contact, faster than any arm; {_FRAMES_TO_CONFIRM} in a row "
            f"that agree are believed{unit}"
        )


def _apart(one: Pose, other: Pose) -> tuple[float, float]:
    """Return the distance [m] and angle [rad] between two poses."""
    distance = math.hypot(other[0] - one[0], other[1] - one[1])
    angle = abs(math.remainder(other[2] - one[2], math.tau))
    return distance, angle
