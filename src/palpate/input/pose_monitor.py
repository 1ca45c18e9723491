"""Plausibility of a stream's times and poses, and a sentence on its rate.

A single outlier is refused. If the frames after it agree with it, the stream has really changed, as by a clock that was
set, and is accepted.
"""

import cmath
import math
from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

from palpate.arrays import Array
from palpate.checks import SPAN, other_time_unit
from palpate.config import LARGEST_ERROR
from palpate.errors import FrameError
from palpate.input.touch_changes import TouchChanges

Pose = tuple[float, float, float]
"""x [m], y [m], theta [rad]."""


@dataclass(frozen=True)
class _Limits:
    """Limits of poses, streams and motion."""

    frames_to_confirm: int = 3
    """Frames that must agree before a jump or a standstill is taken as real."""
    recent_frames: int = 10
    """Frames over which speed and rate are measured."""
    largest_acceleration: tuple[float, float] = (10.0, 100.0)
    """[m/s^2, rad/s^2] of a robot arm: 11 mm a frame at 30 Hz, which 0.33 m/s makes."""
    longest_gap: float = 60.0
    """[s] between frames; a clock that jumps farther is accepted at its second frame."""
    slow_stream: float = 1.5
    """Mean interval between frames, in nominal ones, from which a stream is slow: a third of its frames are lost."""
    fast_stream: float = 0.55
    """Mean interval between frames, in nominal ones, below which errors of frames are not independent: at 60 Hz for
    30."""
    harmless_motion: float = 2e-3
    """[m] of motion that may hide behind a pose that repeats, and does no harm."""
    sudden_stop: float = 0.5
    """Share of its usual speed from which a robot does not stop at once, so that a pose which repeats is frozen if no
    touch tells; and of the way at that speed which it has not gone if it stood."""


_LIMITS = _Limits()


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
    """Distance along its x axis from the sensor back to its farthest point in this contact [m]; of a finger that holds
    the object with another, in the hand."""


class PoseMonitor:
    """Refuses implausible times and poses, detects poses that are frozen, and names a rate that is too low or high."""

    def __init__(self, rate: float, only_pushes: bool = True) -> None:
        """Take the sensor's frame rate [Hz]; one that holds the object with another does not only push along its x."""
        self._rate = rate
        self._only_pushes = only_pushes
        self._last: _Sample | None = None
        self._different: deque[_Sample] = deque(maxlen=_LIMITS.recent_frames)  # the last ones whose poses differ
        self._moving: deque[_Sample] = deque(maxlen=_LIMITS.recent_frames)  # the same, also between contacts
        self._repeats = 0  # identical poses in a row
        self._runs: deque[int] = deque(maxlen=_LIMITS.recent_frames)  # times that the last poses came in a row
        self._is_frozen = False  # the pose stands while the sensor moves, as far as is known
        self._stands_exactly = False  # this robot has stood at an exact pose, or stopped at once, and moved on
        self._elsewhere: list[_Sample] = []  # implausible poses in a row that agree with each other
        self._implausible_time: float | None = None
        self._in_contact = False
        self._intervals: deque[float] = deque(maxlen=_LIMITS.recent_frames)  # [s]
        self._hidden = 0.0  # see SensorMotion
        self._drawn_back = 0.0

    def check_time(self, time: float) -> None:
        """Raise FrameError on a time [s] that is far ahead, unless the one before was as well."""
        gap = time - self._last.time if self._last else 0.0
        before = self._implausible_time
        self._implausible_time = time
        is_confirmed = before is not None and 0.0 < time - before <= _LIMITS.longest_gap
        if gap > _LIMITS.longest_gap and not is_confirmed:
            raise FrameError(self._gap_words(time, gap))

    def _gap_words(self, time: float, gap: float) -> str:
        """Return a sentence on a frame at a time that comes so long after the last one [s]."""
        unit = other_time_unit(gap, self._rate)
        return (
            f"frame at {time:.3f} s comes {gap:.3g} s after the last one, more than {_LIMITS.longest_gap:g} s; the "
            f"next that follows it is taken{unit and '; '}{unit}"
        )

    def check_pose(
        self, time: float, measured: Array, in_contact: bool, touch: TouchChanges, closed: float = 0.0
    ) -> SensorMotion:
        """Take a pose (3,) [m, m, rad] and return the motion to it; `touch` has seen this frame.

        A finger that holds the object with another has `closed` on it by so much [m], below 0 if it opened. Raises
        FrameError on a jump in a contact; between contacts it does no harm.
        """
        x, y, yaw = measured.tolist()
        now = _Sample(time, (x, y, yaw))
        last = self._last or now
        interval = time - last.time
        step, _ = _apart(last.pose, now.pose)
        repeats = self._last is not None and last.pose == now.pose
        goes_on = in_contact and self._in_contact
        has_stood = goes_on and not repeats and self._has_stood(time, step)
        stood_exactly = not repeats and self._repeats >= _LIMITS.frames_to_confirm and step < _LIMITS.harmless_motion
        self._stands_exactly = self._stands_exactly or has_stood or stood_exactly
        possible_push = step if in_contact else self._push_before_release(step, interval)
        self._implausible_time = None
        jumps = goes_on and not self._is_plausible(interval, last.pose, now.pose)
        if jumps:
            self._refuse_unless_confirmed(now, last)
        is_elsewhere = jumps or (goes_on and self._hidden > 0.0 and not repeats and not has_stood)
        usual_interval = max(1.0 / self._rate, median(self._intervals or (0.0,)))
        is_late = interval > _LIMITS.recent_frames * usual_interval
        if self._last is not None:
            self._intervals.append(interval)
        moved = complex(x - last.pose[0], y - last.pose[1]) * cmath.rect(1.0, -yaw)  # in the sensor frame
        self._elsewhere = []
        self._last = now
        self._in_contact = in_contact
        self._follow(now, repeats, goes_on, is_elsewhere, moved.real if self._only_pushes else closed)
        self._is_frozen = repeats and (self._is_frozen or (in_contact and self._moves_hidden(touch)))
        hidden = self._way_since_stop(time) if self._is_frozen and in_contact else 0.0
        self._hidden = hidden if hidden > _LIMITS.harmless_motion else 0.0
        return SensorMotion(is_elsewhere or is_late, possible_push, self._hidden, self._drawn_back)

    @property
    def weakness(self) -> str:
        """Sentence on a rate that makes the estimate worse; empty if it does not."""
        if len(self._intervals) < _LIMITS.recent_frames:
            return ""
        without_longest = sorted(self._intervals)[:-1]  # a single gap does not count
        usual = sum(without_longest) / len(without_longest)
        ratio = usual * self._rate  # to the nominal interval
        return "" if ratio == 0.0 or _LIMITS.fast_stream < ratio < _LIMITS.slow_stream else self._rate_words(usual)

    def _rate_words(self, interval: float) -> str:
        """Return a sentence on a stream whose frames come at another interval [s] than the sensor's."""
        ratio = interval * self._rate
        if ratio >= 1.0:
            advice = other_time_unit(interval, self._rate) or "the pose is known less well"
            return f"frames come {1.0 / interval:.2g} times a second and not {self._rate:g} times; {advice}"
        found = f"frames come {1.0 / interval:.3g} times a second and not {self._rate:g} times"
        return f"{found}: the estimate is too sure; keep one in {round(1.0 / ratio)}"

    def _follow(self, now: _Sample, repeats: bool, goes_on: bool, is_elsewhere: bool, forward: float) -> None:
        """Take a plausible pose into the motion of this contact, or begin another motion with it.

        The sensor went `forward` into the object by so much since the frame before [m].
        """
        stands_frozen = repeats and self._is_frozen
        if is_elsewhere or not (goes_on or stands_frozen):
            self._different.clear()
            self._drawn_back = 0.0
        elif goes_on:
            self._drawn_back = max(self._drawn_back - forward, 0.0)
        if not self._different or (goes_on and not repeats):
            self._different.append(now)
        if not repeats:
            self._moving.append(now)
            self._runs.append(max(self._repeats, 1))
        self._repeats = self._repeats + 1 if repeats and not is_elsewhere else 1

    def _push_before_release(self, step: float, interval: float) -> float:
        """Return the distance [m] by which the object was pushed at most before a release within the interval [s].

        The sensor went on at most at the speed before.
        """
        is_moving = self._repeats == 1 and len(self._different) > 1
        return min(step, self._speed(2) * interval) if is_moving else 0.0

    def _speed(self, count: int) -> float:
        """Return the mean speed [m/s] over the last different poses."""
        return _mean_speed(self._different[-count], self._different[-1])

    def _way_since_stop(self, time: float) -> float:
        """Return how far [m] the sensor would have gone since its pose stands, at the speed before.

        That is the speed in the contact, or that between contacts if one has only begun.
        """
        motion = self._different if len(self._different) > 1 else self._moving
        return _mean_speed(motion[0], motion[-1]) * (time - self._moving[-1].time)

    def _has_stood(self, time: float, step: float) -> bool:
        """Return True if the sensor stood since it stopped at once, as it goes on by a step [m] from there."""
        has_stopped = self._repeats >= _LIMITS.frames_to_confirm and self._stopped_at_once()
        return has_stopped and step < _LIMITS.sudden_stop * self._way_since_stop(time)

    def _moves_hidden(self, touch: TouchChanges) -> bool:
        """Return True if the sensor goes on while its pose stands: the touch goes on changing.

        If touch does not tell, a robot slows down before it stands, so that a pose which repeats from full speed on is
        frozen. Some stop at once: in a stream that once stood at an exact pose and moved on from there, repeats mean
        nothing.
        """
        settles = _LIMITS.frames_to_confirm * round(median(self._runs or (1,)))  # some streams repeat each pose
        stood = self._repeats - 1
        if stood < settles:
            return False
        goes_on = touch.go_on(stood, settles)
        return not self._stands_exactly and self._stopped_at_once() if goes_on is None else goes_on

    def _stopped_at_once(self) -> bool:
        """Return True if the sensor did not slow down before its pose stood."""
        if len(self._different) < _LIMITS.recent_frames:
            return False
        return self._speed(_LIMITS.frames_to_confirm) > _LIMITS.sudden_stop * self._speed(_LIMITS.recent_frames)

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
        farthest = LARGEST_ERROR[0] + _LIMITS.largest_acceleration[0] * longest**2
        widest = LARGEST_ERROR[1] + _LIMITS.largest_acceleration[1] * longest**2
        return distance <= farthest, angle <= widest

    def _refuse_unless_confirmed(self, now: _Sample, last: _Sample) -> None:
        """Raise FrameError on a pose far from the last one, unless enough in a row agree with it."""
        before = self._elsewhere[-1] if self._elsewhere else now
        if self._is_within(before.pose, now.pose, now.time - before.time) != (True, True):
            self._elsewhere = []
        self._elsewhere.append(now)
        if len(self._elsewhere) >= _LIMITS.frames_to_confirm:
            return
        interval = now.time - last.time
        distance, angle = _apart(last.pose, now.pose)
        unit = "; are these millimetres?" if max(abs(now.pose[0]), abs(now.pose[1])) > SPAN else ""
        if self._is_within(last.pose, now.pose, interval) == (True, False):
            unit = "; is theta in degrees?"
        raise FrameError(
            f"frame at {now.time:.3f} s has the sensor {distance:.3g} m and {math.degrees(angle):.0f} degrees from "
            f"where it was {interval:.3g} s before, in one contact, faster than any arm; {_LIMITS.frames_to_confirm} "
            f"in a row that agree are believed{unit}"
        )


def _mean_speed(first: _Sample, last: _Sample) -> float:
    """Return the mean speed [m/s] from one sample to another; 0 if they are one."""
    distance, _ = _apart(first.pose, last.pose)
    return distance / (last.time - first.time) if last.time > first.time else 0.0


def _apart(one: Pose, other: Pose) -> tuple[float, float]:
    """Return the distance [m] and angle [rad] between two poses."""
    distance = math.hypot(other[0] - one[0], other[1] - one[1])
    angle = abs(math.remainder(other[2] - one[2], math.tau))
    return distance, angle
