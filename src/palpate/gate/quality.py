"""What of a stream is worse than the tracker takes it to be: nothing is wrong, but the estimate is worse for it."""

import logging
import math
from collections import deque
from statistics import median

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.types.units import other_time_unit

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]

_LATELY = 15  # usual intervals, half a second at 30 Hz
_LONGEST = 3.0  # usual intervals that a gap counts as at most, so that one gap is no lower rate
_SELDOM = 1.5  # usual intervals between frames, in the mean, from which they come seldom
_BEST, _OFTEN = 60.0, 90.0  # [Hz] the estimate is best up to the one; from the other on a stream is told of
_TREMBLES = 3.0  # times the stated deviation from which poses are noisier than that
_MIDDLE = 1.1774  # length in the median of a vector of two, in standard deviations of each
_FAR, _ASIDE = 0.02, math.radians(70.0)  # [m] gone in touch from which its direction counts, and off +x at most
_OTHER_LIGHT = 0.25  # share of the untouched gel's light by which another is told; presses of real gels make 0.03


class StreamQuality:
    """Follows how often the frames of one stream come, how the sensor's place trembles and goes on, and the light."""

    def __init__(self, rate: float, deviation: float) -> None:
        """Take how many frames should come in a second [Hz], and how well x and y of the sensor are measured [m]."""
        self._rate, self._stated = rate, deviation
        self._intervals: deque[float] = deque(maxlen=_LATELY)  # [s]
        self._last: deque[tuple[float, Array]] = deque(maxlen=4)  # time [s] and place (2,) [m]
        self._light: Array = np.ones(3)
        self._touched = False  # at the last frame
        self._pushed: Array = np.zeros(2)  # [m] how far the sensor went while it touched, in its own frame
        self._is_aside_told = False
        self._off: deque[float] = deque(maxlen=_LATELY)  # [m] that a place is off a smooth way, scaled to its own noise

    def see(self, time: float, pose: Array, light: Array, touched: bool) -> None:
        """Take the time [s], pose (3,) and light (3,), see ContactDetector.light, of a frame, and whether it touches.

        Touches that no image shows do not count: a tip may be round, and its frame lie as one likes.
        """
        self._light = light
        if self._last and touched and self._touched:
            self._pushed = self._pushed + (pose[:2] - self._last[-1][1]) @ se2.rotation(pose[2])
            if not self._is_aside_told and (aside := self._aside()):
                logger.warning("frame at %.3f s: %s", time, aside)
                self._is_aside_told = True
        self._touched = touched
        if self._last:
            self._intervals.append(time - self._last[-1][0])
        self._last.append((time, pose[:2]))
        if len(self._last) == 4:
            self._off.append(_off_the_way(*self._last))

    @property
    def interval(self) -> float:
        """The usual interval of late [s]; sensors may be slower than they say, and a gap is no lower rate."""
        return max(1.0 / self._rate, median(self._intervals)) if self._intervals else 1.0 / self._rate

    @property
    def reason(self) -> str:
        """What is worse than it should be, in a sentence; nothing where all is well."""
        return self._too_seldom() or self._too_noisy() or self._other_light() or self._aside()

    def _too_seldom(self) -> str:
        shares, lately = 0.0, 0
        while shares < _LATELY:
            if lately == len(self._intervals):
                return ""
            lately += 1
            shares += min(self._intervals[-lately] * self._rate, _LONGEST)
        if shares < _SELDOM * lately:
            return ""
        rate = lately / sum(list(self._intervals)[-lately:])
        asked = other_time_unit(1.0 / rate, self._rate) or "the pose is known less well"
        return f"frames come {rate:.2g} times a second and not {self._rate:g} times; {asked}"

    @property
    def too_often(self) -> str:
        """That frames come more often than serves the estimate; a reason only where there is no other."""
        return too_often(1.0 / median(self._intervals)) if len(self._intervals) == _LATELY else ""

    def _too_noisy(self) -> str:
        if len(self._off) < _LATELY:
            return ""
        trembles = median(self._off) / _MIDDLE
        if trembles < _TREMBLES * self._stated:
            return ""
        return (
            f"the sensor's place trembles by {1e3 * trembles:.2g} mm, where {1e3 * self._stated:.2g} mm are taken for "
            "granted (sensor_pose.deviation)"
        )

    def _other_light(self) -> str:
        if np.abs(self._light - 1.0).max() < _OTHER_LIGHT:
            return ""
        red, green, blue = 100.0 * self._light
        return f"red, green and blue light are at {red:.0f}, {green:.0f} and {blue:.0f} % of what they were"

    def _aside(self) -> str:
        x, y = self._pushed
        angle = math.atan2(y, x)
        if math.hypot(x, y) < _FAR or abs(angle) < _ASIDE:
            return ""
        way = ("+x", "+y", "-x", "-y")[round(angle / (0.5 * math.pi)) % 4]
        return (
            f"the sensor goes along {way} of its own frame while it touches; x of it is taken to point out of the gel, "
            "along the push"
        )


def too_often(rate: float) -> str:
    """Say that frames come more often [Hz] than serves the estimate, in a sentence; nothing where they do not."""
    if rate < _OFTEN:
        return ""
    every = math.ceil(rate / _BEST - 0.1)  # stamps jitter
    return f"frames come {rate:.3g} times a second; the pose is known better from one in {every} of them"


def _off_the_way(*last: tuple[float, Array]) -> float:
    """How far the last of four places is off the parabola through the others [m], over what noise makes of noise."""
    (first, second, third, now), (a, b, c, place) = zip(*last, strict=True)
    by_first = (now - second) * (now - third) / ((first - second) * (first - third))
    by_second = (now - first) * (now - third) / ((second - first) * (second - third))
    by_third = (now - first) * (now - second) / ((third - first) * (third - second))
    x, y = place - by_first * a - by_second * b - by_third * c
    return math.hypot(x, y) / math.sqrt(1.0 + by_first**2 + by_second**2 + by_third**2)
