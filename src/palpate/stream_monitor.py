"""Plausibility of a stream's times and poses, and five sentences on its quality.

A single outlier is refused. If the frames after it agree with it, the stream has really changed (a clock was set, a
robot reports its pose again) and is accepted, so that no single frame decides on all later ones.
"""

import logging
import math
from collections import deque
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.checks import other_time_unit
from palpate.errors import FrameError
from palpate.geometry import se2

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]

LONGEST_GAP = 60.0  # [s] between frames; a clock that jumps farther is accepted at its second frame
DRAWN_BACK = 5e-3  # [m] by which a sensor in contact can draw back from its farthest point, since it cannot pull
_AGREE = 3  # implausible poses in a row that agree with each other are accepted
_HISTORY = 9  # poses kept, 0.3 s at 30 Hz

# Largest acceleration [m/s^2, rad/s^2] and speed [m/s, rad/s] of a robot arm, and error of a measured pose [m, rad]. A
# pusher at 0.25 m/s deviates from constant velocity by at most 3 mm a frame at 30 Hz; 16 mm are allowed.
_ACCELERATION, _SPEED, _ERROR = np.array([10.0, 100.0]), np.array([2.0, 20.0]), np.array([5e-3, 0.1])
_METRES = 10.0  # [m] from the origin, farther than most robots reach: coordinates beyond may be millimetres

# A pose is frozen if it repeats this often, begins to from more than this share of its speed, and hides this much [m].
_REPEATS, _SUDDEN, _HIDDEN = 4, 0.5, 2e-3
_FIRST_STEP = 1e-3  # [m] after a standstill of 3 frames: 0.9 m/s^2 at 30 Hz, so the robot really stood


class _Pose(NamedTuple):
    time: float
    pose: Array


class PoseMonitor:
    """Refuses implausible times and poses, and detects poses that are frozen."""

    def __init__(self, rate: float) -> None:
        """Take the sensor's frame rate [Hz]."""
        self._rate = rate
        self._last: _Pose | None = None
        self._different: deque[_Pose] = deque(maxlen=_HISTORY)  # the last ones that differ from each other
        self._repeats = 0  # identical poses in a row
        self._stands_exactly = False  # this robot has stood at one exact pose and moved on from there
        self._elsewhere: list[_Pose] = []  # implausible poses in a row that agree with each other
        self._implausible_time: float | None = None
        self._in_contact = False
        self._advance = self._farthest = 0.0  # [m] along the sensor's x axis in this contact
        self.hidden_before = 0.0
        """`hidden` before the last frame [m]."""
        self.pushed = 0.0
        """Largest distance by which the sensor may have pushed the object since the frame before [m]."""

    @property
    def hidden(self) -> float:
        """Distance that the sensor may have moved in a contact while its pose was frozen [m]; 0 if it is not frozen."""
        return self._frozen if self._in_contact else 0.0

    @property
    def _frozen(self) -> float:
        # A robot slows down before it stands, so a pose that repeats from full speed on is frozen. Some streams report
        # commands, which stand exactly: after a robot has moved on from where it stood, repeats mean nothing.
        if self._stands_exactly or self._repeats < _REPEATS or len(self._different) < _HISTORY or self._last is None:
            return 0.0
        speed, before = (_speed(self._different[-count], self._different[-1]) for count in (3, _HISTORY))
        distance = before * (self._last.time - self._different[-1].time)
        return distance if speed > _SUDDEN * before and distance > _HIDDEN else 0.0

    @property
    def drawn_back(self) -> bool:
        """The sensor has moved back from the object, even if the image still looks touched."""
        return self._farthest - self._advance > DRAWN_BACK

    def check_time(self, time: float) -> None:
        """Raise FrameError on a time [s] that does not increase or is far ahead, unless the one before was as well."""
        if self._last is None:
            return
        gap = time - self._last.time
        before, self._implausible_time = self._implausible_time, time
        if gap > LONGEST_GAP and not (before is not None and 0.0 < time - before <= LONGEST_GAP):
            unit = other_time_unit(gap, self._rate)
            raise FrameError(
                f"frame at {time:.3f} s comes {gap:.3g} s after the last one, more than {LONGEST_GAP:g} s; the next "
                f"that follows it is taken{unit and '; '}{unit}"
            )

    def check_pose(self, time: float, pose: Array, in_contact: bool) -> bool:
        """Take a pose (3,) [m, m, rad]; raise FrameError on a jump in a contact, as between contacts it does no harm.

        Returns true if the sensor cannot have moved here from the last frame within the same contact.
        """
        now, last = _Pose(time, pose), self._last
        self._implausible_time = None
        repeats = last is not None and np.array_equal(last.pose, pose)
        step = 0.0 if last is None else _apart(last.pose, pose)[0]
        if last is not None and not repeats and self._repeats >= 3:
            self._stands_exactly |= step < _FIRST_STEP
        self.hidden_before = self.hidden
        if last is not None:
            # After a release within the interval, the object was pushed at most at the speed before.
            moving = self._repeats == 1 and len(self._different) > 1
            speed = _speed(self._different[-2], self._different[-1]) if moving else 0.0
            self.pushed = step if in_contact else min(step, speed * (time - last.time))
        moved_elsewhere = False
        if last is not None and in_contact and self._in_contact:
            moved_elsewhere = self._continue_contact(last, now, repeats)
        else:
            self._in_contact, self._last = in_contact, now
            if not (repeats and self._frozen):
                self._restart(now)
        self._repeats = self._repeats + 1 if repeats and not moved_elsewhere else 1
        return moved_elsewhere

    def _continue_contact(self, last: _Pose, now: _Pose, repeats: bool) -> bool:
        jumps = not self._is_plausible(last, now)
        if jumps:
            self._refuse_unless_confirmed(last, now)
        self._elsewhere = []
        moved_elsewhere = jumps or (self.hidden > 0.0 and not repeats)
        self._last = now
        if moved_elsewhere:
            self._restart(now)
        elif not repeats:
            self._different.append(now)
            self._advance += float((now.pose - last.pose)[:2] @ (np.cos(now.pose[2]), np.sin(now.pose[2])))
            self._farthest = max(self._farthest, self._advance)
        return moved_elsewhere

    def _restart(self, now: _Pose) -> None:
        self._different.clear()
        self._different.append(now)
        self._elsewhere = []
        self._advance = self._farthest = 0.0

    def _refuse_unless_confirmed(self, last: _Pose, now: _Pose) -> None:
        if self._elsewhere and not _is_reachable(self._elsewhere[-1], now):
            self._elsewhere = []
        self._elsewhere.append(now)
        if len(self._elsewhere) >= _AGREE:
            return
        interval = now.time - last.time
        step, turn = _apart(last.pose, now.pose)
        farthest, most = _ERROR + _SPEED * interval
        unit = "; are these millimetres?" if np.abs(now.pose[:2]).max() > _METRES else ""
        unit = "; is theta in degrees?" if step < farthest and turn > most else unit
        raise FrameError(
            f"frame at {now.time:.3f} s has the sensor {step:.3g} m and {np.degrees(turn):.0f} degrees from where it "
            f"was {interval:.3g} s before, in one contact, faster than any arm; {_AGREE} in a row that agree are "
            f"believed{unit}"
        )

    def _is_plausible(self, last: _Pose, now: _Pose) -> bool:
        """Compare with the motion so far: at constant velocity, up to the largest acceleration."""
        if len(self._different) < 2:
            return _is_reachable(last, now)
        interval = now.time - last.time
        usual = max(interval, 1.0 / self._rate)  # times may jitter
        first, second = self._different[-2], self._different[-1]
        ahead = np.clip(interval / (second.time - first.time), 0.0, 2.0) if self._repeats == 1 else 0.0
        expected = last.pose + ahead * _difference(first.pose, second.pose)
        return bool((np.array(_apart(expected, now.pose)) <= _ERROR + _ACCELERATION * usual**2).all())


def _is_reachable(before: _Pose, now: _Pose) -> bool:
    return bool((np.array(_apart(before.pose, now.pose)) <= _ERROR + _SPEED * (now.time - before.time)).all())


def _difference(earlier: Array, later: Array) -> Array:
    return np.append(later[:2] - earlier[:2], se2.wrap(later[2] - earlier[2]))


def _apart(one: Array, other: Array) -> tuple[float, float]:
    """Return the distance [m] and angle [rad] between two poses."""
    x, y, turn = _difference(one, other)
    return float(np.hypot(x, y)), abs(float(turn))


def _speed(earlier: _Pose, later: _Pose) -> float:
    return _apart(earlier.pose, later.pose)[0] / (later.time - earlier.time)


_LATELY = 15  # intervals, half a second at 30 Hz
_SELDOM, _LONGEST = 1.5, 3.0  # nominal intervals: mean from which the rate is too low; a single gap counts no more
_BEST_RATE, _HIGH_RATE = 60.0, 90.0  # [Hz] up to which the estimate gains; from which a stream should be thinned
_NOISY = 3.0  # times the stated standard deviation of a position
_RAYLEIGH_MEDIAN = 1.1774  # median length of a vector of two standard normal numbers
_OTHER_LIGHT = 0.25  # relative change of brightness; presses on real gels change it by 0.03
_PUSHED, _SIDEWAYS = 0.02, math.radians(70.0)  # [m] in contact after which the direction counts, and its angle to +x


class StreamQuality:
    """Sentences on a stream whose rate, pose noise, light or direction of pushing makes the estimate worse."""

    def __init__(self, rate: float, deviation: float) -> None:
        """Take the nominal rate [Hz] and the standard deviation of x and y of the sensor [m]."""
        self._rate, self._deviation = rate, deviation
        self._intervals: deque[float] = deque(maxlen=_LATELY)  # [s]
        self._last: deque[tuple[float, Array]] = deque(maxlen=4)  # time [s] and position (2,) [m]
        self._noise: deque[float] = deque(maxlen=_LATELY)  # [m]
        self._light: Array = np.ones(3)
        self._in_contact = self._has_warned = False
        self._pushed: Array = np.zeros(2)  # [m] motion in contact, sensor frame

    def add(self, time: float, pose: Array, light: Array, in_contact: bool) -> None:
        """Take a frame's time [s], pose (3,), relative brightness of each channel (3,) and contact as the image shows.

        Contact without an image does not count, as a tip may be round and its frame lie anyhow.
        """
        self._light = light
        if self._last:
            self._intervals.append(time - self._last[-1][0])
            if in_contact and self._in_contact:
                self._pushed = self._pushed + (pose[:2] - self._last[-1][1]) @ se2.rotation(pose[2])
                if not self._has_warned and (sideways := self._sideways()):
                    logger.warning("frame at %.3f s: %s", time, sideways)
                    self._has_warned = True
        self._in_contact = in_contact
        self._last.append((time, pose[:2]))
        if len(self._last) == 4:
            self._noise.append(_off_parabola(*self._last))

    @property
    def interval(self) -> float:
        """Median of the last intervals [s], at least the nominal one."""
        return max(1.0 / self._rate, median(self._intervals)) if self._intervals else 1.0 / self._rate

    @property
    def weakness(self) -> str:
        """The first sentence that applies; empty if all is well."""
        often = too_often(1.0 / median(self._intervals)) if len(self._intervals) == _LATELY else ""
        return self._too_seldom() or self._too_noisy() or self._other_light() or self._sideways() or often

    def _too_seldom(self) -> str:
        shares, count = 0.0, 0
        while shares < _LATELY:
            if count == len(self._intervals):
                return ""
            count += 1
            shares += min(self._intervals[-count] * self._rate, _LONGEST)
        if shares < _SELDOM * count:
            return ""
        rate = count / sum(list(self._intervals)[-count:])
        advice = other_time_unit(1.0 / rate, self._rate) or "the pose is known less well"
        return f"frames come {rate:.2g} times a second and not {self._rate:g} times; {advice}"

    def _too_noisy(self) -> str:
        noise = median(self._noise) / _RAYLEIGH_MEDIAN if len(self._noise) == _LATELY else 0.0
        if noise < _NOISY * self._deviation:
            return ""
        return (
            f"the sensor's position has noise of {1e3 * noise:.2g} mm, more than the {1e3 * self._deviation:.2g} mm of "
            "sensor_pose.deviation"
        )

    def _other_light(self) -> str:
        if np.abs(self._light - 1.0).max() < _OTHER_LIGHT:
            return ""
        red, green, blue = 100.0 * self._light
        return f"red, green and blue light are at {red:.0f}, {green:.0f} and {blue:.0f} % of the untouched gel's"

    def _sideways(self) -> str:
        x, y = self._pushed
        angle = math.atan2(y, x)
        if math.hypot(x, y) < _PUSHED or abs(angle) < _SIDEWAYS:
            return ""
        axis = ("+x", "+y", "-x", "-y")[round(angle / (0.5 * math.pi)) % 4]
        return f"the sensor moves along {axis} of its own frame in contact; its x axis must point along the push"


def too_often(rate: float) -> str:
    """Return a sentence on a rate [Hz] higher than serves the estimate; empty if it is not."""
    if rate < _HIGH_RATE:
        return ""
    every = math.ceil(rate / _BEST_RATE - 0.1)  # times jitter
    return f"frames come {rate:.3g} times a second; the pose is known better from one in {every} of them"


def _off_parabola(*last: tuple[float, Array]) -> float:
    """Return the distance of the last of four positions from the parabola through the others [m].

    It is divided by the factor by which the parabola amplifies noise.
    """
    (first, second, third, now), (a, b, c, position) = zip(*last, strict=True)
    by_first = (now - second) * (now - third) / ((first - second) * (first - third))
    by_second = (now - first) * (now - third) / ((second - first) * (second - third))
    by_third = (now - first) * (now - second) / ((third - first) * (third - second))
    x, y = position - by_first * a - by_second * b - by_third * c
    return math.hypot(x, y) / math.sqrt(1.0 + by_first**2 + by_second**2 + by_third**2)
