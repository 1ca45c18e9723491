"""What of a stream's stamps and poses cannot be so, looked at before anything of it is believed.

A frame that cannot be is refused in one sentence. What is refused once is an outlier; where the frames that follow
agree with it, the world has changed and it is taken for what it is: the clock was set on, the robot's pose came back
somewhere else. So no single frame decides what becomes of all later ones.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FrameError
from palpate.geometry import se2
from palpate.types.units import other_time_unit

Array = NDArray[np.float64]

LONGEST_GAP = 60.0
"""[s] between two frames; a clock that leaps farther is believed from its second frame on."""
_ACCELERATION, _FLOOR = np.array([10.0, 100.0]), np.array([5e-3, 0.1])
"""[m/s^2, rad/s^2] of a robot's arm at most, and [m, rad] by which a measured pose may be off besides. A pusher that
travels at 0.25 m/s is off its constant velocity by 3 mm a frame at most at 30 Hz, where 16 mm are allowed."""
_MILLIMETRES = 10.0  # [m] from the origin, where few robots reach
_SPEED = np.array([2.0, 20.0])  # [m/s, rad/s] between poses of which nothing else is known
_HISTORY = 9  # poses that are kept, 0.3 s at 30 Hz
_STILL, _SUDDEN = 4, 0.5  # poses in a row, the same to the last bit; share of the speed before with which they begin
_BLIND = 2e-3  # [m] that a sensor may have gone unseen without harm
_STOOD, _FIRST_STEP = 3, 1e-3  # poses in a row of a sensor that stands; [m] with which it goes on, 0.9 m/s^2 at 30 Hz
DRAWN_BACK = 5e-3
"""[m] by which a sensor that still touches the object can draw back from where it was; it cannot pull it."""
_AGREE = 3  # poses in a row from which on the sensor is where they say


@dataclass(frozen=True, eq=False)
class _Pose:
    time: float
    pose: Array


class StreamGuard:
    """Follows the frames of one stream, those that are taken and those that are not."""

    def __init__(self, rate: float) -> None:
        """Take how many frames come in a second [Hz]."""
        self._rate = rate
        self._taken: deque[_Pose] = deque(maxlen=_HISTORY)  # those that differ
        self._now: _Pose | None = None  # the last one
        self._still = 0  # poses in a row that are the same to the last bit
        self._exact = False  # whether this sensor has stood still to the last bit and gone on from there
        self.unseen = 0.0
        """How far the sensor may have gone up to the last frame while its pose stood still [m]."""
        self.pushed = 0.0
        """How far the sensor may have pushed the object between the last frame and the one before [m]."""
        self._elsewhere: list[_Pose] = []  # poses in a row that do not fit those taken, but each other
        self._leapt_to: float | None = None  # [s] stamp that was too far ahead
        self._touched = False  # at the last frame
        self._way, self._farthest = 0.0, 0.0  # [m] that the sensor went along its own x since it touches the object

    @property
    def blind(self) -> float:
        """How far the sensor may have gone while its pose stands still in a contact [m]; 0 where nothing tells that.

        What stands still when a contact ends still does in the next one.
        """
        return self._frozen if self._touched else 0.0

    @property
    def _frozen(self) -> float:
        """How far the sensor may have gone while its pose stands still [m]; 0 where nothing speaks for that.

        A robot slows down before it stands; a pose that stands still to the last bit from full speed on is frozen. Some
        poses are commands and stand exactly: once one has gone on from where it stood, standing still tells nothing.
        """
        if self._exact or self._still < _STILL or len(self._taken) < _HISTORY or self._now is None:
            return 0.0
        speed, before = (_speed(self._taken[-count], self._taken[-1]) for count in (3, _HISTORY))
        gone = before * (self._now.time - self._taken[-1].time)
        return gone if speed > _SUDDEN * before and gone > _BLIND else 0.0

    @property
    def _speed(self) -> float:
        """How fast the sensor goes at the last frame [m/s]."""
        return _speed(self._taken[-2], self._taken[-1]) if self._still == 1 and len(self._taken) > 1 else 0.0

    @property
    def drawn_back(self) -> bool:
        """Whether the sensor has left the object behind, whatever touch says."""
        return self._farthest - self._way > DRAWN_BACK

    def check_time(self, time: float) -> None:
        """Raise FrameError on a stamp [s] that is too far ahead, unless the one before was so as well."""
        if self._now is None:
            return
        gap = time - self._now.time
        before, self._leapt_to = self._leapt_to, time
        if gap > LONGEST_GAP and not (before is not None and 0.0 < time - before <= LONGEST_GAP):
            asked = other_time_unit(gap, self._rate)
            raise FrameError(
                f"frame at {time:.3f} s comes {gap:.3g} s after the last one, more than {LONGEST_GAP:g} s; the next "
                f"that follows it is taken{asked and '; '}{asked}"
            )

    def check_pose(self, time: float, pose: Array, touched: bool) -> bool:
        """Take a pose (3,) [m, m, rad], or refuse one that leaps in a contact.

        Returns whether the sensor is elsewhere than it can have gone since the last frame that was taken. Raises
        FrameError on a leap; between contacts one does no harm and is believed.
        """
        now, last = _Pose(time, pose), self._now
        self._leapt_to = None
        stands = last is not None and np.array_equal(last.pose, pose)
        way = 0.0 if last is None else _apart(last.pose, pose)[0]
        if last is not None and not stands and self._still >= _STOOD:
            self._exact |= way < _FIRST_STEP
        self.unseen = self.blind
        if last is not None:
            # What has let go of the object meanwhile has pushed it on at most as fast as before.
            self.pushed = way if touched else min(way, self._speed * (time - last.time))
        if last is None or not (touched and self._touched):
            self._touched = touched
            self._take_untouched(now, stands)
            return False
        return self._take_in_contact(last, now, stands)

    def _take_untouched(self, now: _Pose, stands: bool) -> None:
        """Take a pose that is not in a contact that goes on; one that stands frozen keeps where it came from."""
        self._now = now
        if not (stands and self._frozen):
            self._begin(now)
        self._count_still(stands)

    def _take_in_contact(self, last: _Pose, now: _Pose, stands: bool) -> bool:
        """Take the next pose of a contact, or refuse it; return whether the sensor is elsewhere."""
        leaps = not self._fits(last, now)
        if leaps:
            self._leap(last, now)
        self._elsewhere = []
        gone = leaps or (self.blind > 0.0 and not stands)
        self._now = now
        if gone:
            self._begin(now)
        elif not stands:
            self._taken.append(now)
            self._way += float((now.pose - last.pose)[:2] @ (np.cos(now.pose[2]), np.sin(now.pose[2])))
            self._farthest = max(self._farthest, self._way)
        self._count_still(stands and not gone)
        return gone

    def _count_still(self, stands: bool) -> None:
        """Count a pose that is the same as the one before, or begin to count anew."""
        self._still = self._still + 1 if stands else 1

    def _begin(self, now: _Pose) -> None:
        """Forget where the sensor came from: a contact begins with it, or goes on elsewhere."""
        self._taken.clear()
        self._taken.append(now)
        self._elsewhere = []
        self._way = self._farthest = 0.0

    def _leap(self, last: _Pose, now: _Pose) -> None:
        """Raise FrameError on a pose that does not follow the last one, unless others before agree with it."""
        if self._elsewhere and not _reachable(self._elsewhere[-1], now):
            self._elsewhere = []
        self._elsewhere.append(now)
        if len(self._elsewhere) < _AGREE:
            step, turn = _apart(last.pose, now.pose)
            farthest, most = _FLOOR + _SPEED * (now.time - last.time)
            asked = "; are these millimetres?" if np.abs(now.pose[:2]).max() > _MILLIMETRES else ""
            if step < farthest and turn > most:
                asked = "; is theta in degrees?"
            raise FrameError(
                f"frame at {now.time:.3f} s has the sensor {step:.3g} m and {np.degrees(turn):.0f} degrees from where "
                f"it was {now.time - last.time:.3g} s before, in one contact, faster than any arm; {_AGREE} in a row "
                f"that agree are believed{asked}"
            )

    def _fits(self, last: _Pose, now: _Pose) -> bool:
        """Whether a pose follows the last ones that were taken."""
        if len(self._taken) < 2:
            return _reachable(last, now)
        interval = now.time - last.time
        usual = max(interval, 1.0 / self._rate)  # stamps may jitter
        first, second = self._taken[-2], self._taken[-1]
        ahead = np.clip(interval / (second.time - first.time), 0.0, 2.0) if self._still == 1 else 0.0
        off = np.array(_apart(last.pose + ahead * _difference(first.pose, second.pose), now.pose))
        return bool((off <= _FLOOR + _ACCELERATION * usual**2).all())


def _reachable(before: _Pose, now: _Pose) -> bool:
    """Whether a sensor can have gone from one pose to another."""
    off = np.array(_apart(before.pose, now.pose))
    return bool((off <= _FLOOR + _SPEED * (now.time - before.time)).all())


def _difference(earlier: Array, later: Array) -> Array:
    return np.append(later[:2] - earlier[:2], se2.wrap(later[2] - earlier[2]))


def _apart(one: Array, other: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    x, y, turn = _difference(one, other)
    return float(np.hypot(x, y)), abs(float(turn))


def _speed(earlier: _Pose, later: _Pose) -> float:
    """[m/s]"""
    return _apart(earlier.pose, later.pose)[0] / (later.time - earlier.time)
