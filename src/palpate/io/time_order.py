"""Order of times as evidence: a few that are out of order are left out, more are two takes, a set clock or two senders.

So times are looked at in the order in which they came, before anything is sorted.
"""

import logging
from bisect import bisect_right
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Flags, Times
from palpate.errors import FileError

logger = logging.getLogger(__name__)

UNKNOWN = np.iinfo(np.int64).min
"""Stands for a time that is not known, such as NaN."""


@dataclass(frozen=True)
class _Limits:
    """Limits of what is found here."""

    longest_run: int = 3
    """Times in a row that may be out of order: a clock that was set leaves more."""
    few: float = 0.02
    """Share of times that may be wrong and cost only themselves."""
    farthest_offset: int = 10**9
    """[ns] Largest difference of a stamp from the others of its stream, each against its time of recording."""
    clock_step: float = 0.1
    """[s] Smallest step of a clock that is taken out; delays of messages vary by less."""
    together: float = 0.1
    """[s] Largest difference of the starts of two streams that were recorded together."""
    slow: float = 0.02
    """Least step of stamps against that of the times of recording: below it they are in another unit."""
    block: int = 10
    """Messages of which the one that was least late tells the clock."""


_LIMITS = _Limits()


def are_few(count: int, total: int) -> bool:
    """Return true if so many wrong values of all cost only themselves."""
    return count <= max(1, _LIMITS.few * total)


def in_order(name: str, time: Times, advice: str = "", is_strict: bool = False) -> Flags:
    """Return flags (N,) of times [ns], in the order in which they came, without the few that are out of order.

    A warning counts those that are left out. `is_strict` leaves out those equal to the one before, too. Raises
    FileError, with the advice, if there are more than a few.
    """
    good = time != UNKNOWN
    kept = good.copy()
    kept[good] = _longest_rise(time[good])
    if is_strict:
        index = np.flatnonzero(kept)
        kept[index[1:][np.diff(time[index]) == 0]] = False
    wrong = good & ~kept
    edges = np.flatnonzero(np.diff(np.r_[0, wrong[good].astype(np.int8), 0]))
    longest = int(np.diff(edges)[::2].max()) if len(edges) else 0
    if wrong.any() and not (are_few(int(wrong.sum()), len(time)) and longest <= _LIMITS.longest_run):
        raise FileError(f"{name}: {_steps_back(time[good])}; allowed is a time after the one before{advice}")
    left_out = ~kept
    if left_out.any():
        first = int(np.argmax(left_out))
        what = "unknown" if time[first] == UNKNOWN else f"{time[first] * 1e-9:.3f} s"
        words = "%s: %d of %d times are unknown or out of order and left out, the first is number %d, %s"
        logger.warning(words, name, left_out.sum(), len(time), first, what)
    return kept


def _longest_rise(time: Times) -> Flags:
    """Return flags (N,) of a longest part of times that never goes back."""
    if not (np.diff(time) < 0).any():
        return np.ones(len(time), np.bool_)
    values = time.tolist()
    tails: list[int] = []  # least last value of a rise of each length
    ends: list[int] = []  # its number
    before: list[int] = []
    for number, value in enumerate(values):
        length = bisect_right(tails, value)
        before.append(ends[length - 1] if length else -1)
        tails[length : length + 1] = [value]
        ends[length : length + 1] = [number]
    kept = np.zeros(len(values), np.bool_)
    number = ends[-1]
    while number >= 0:
        kept[number] = True
        number = before[number]
    return kept


def _steps_back(time: Times) -> str:
    """Return words on the places where times (N,) [ns] go back or repeat."""
    steps = np.diff(time)
    count = int((steps <= 0).sum())
    largest = int(np.argmin(steps))
    places = "once" if count == 1 else f"{count} times, the most"
    if count == len(steps):
        places = "always, the most"
    ask = "are these two takes, or was a clock set?" if count <= 3 else "do two senders write them?"
    return (
        f"times go back {places} by {-steps[largest] * 1e-9:.3g} s, from {time[largest] * 1e-9:.3f} s to "
        f"{time[largest + 1] * 1e-9:.3f} s at number {largest + 1}: {ask}"
    )


def without_step(name: str, time: Times, other: Times) -> Times:
    """Return increasing times (N,) [ns] without a step forward of their clock, of which a warning tells.

    Streams that are recorded together begin and end together. One that begins with another (M,) [ns], is silent for a
    while and ends later by just that while had its clock set forward: its later times are taken as that much late.
    """
    known = other[other != UNKNOWN]
    if len(time) < 4 or len(known) < 4:
        return time
    steps = np.diff(time)
    usual = float(np.median(steps))
    first = int(np.argmax(steps)) + 1
    step = float(steps[first - 1]) - usual
    later = float(time[-1] - known.max())
    tolerance = 2.0 * max(usual, float(np.median(np.abs(np.diff(known)))))
    begin_together = abs(float(time[0] - known.min())) <= 1e9 * _LIMITS.together
    is_silence = step > max(1e9 * _LIMITS.clock_step, 5.0 * usual) and np.sort(steps)[-2] < 0.5 * step
    if not (begin_together and is_silence and abs(later - step) <= tolerance + 0.1 * step):
        return time
    logger.warning(
        "%s: nothing for %.3f s from %.3f s on, and the end is as much later than that of the other times: the clock "
        "was set forward, and later times are taken as that much late",
        name,
        1e-9 * step,
        1e-9 * time[first - 1],
    )
    return np.where(np.arange(len(time)) >= first, time - round(step), time)


class Ordered(NamedTuple):
    """Messages of a stream whose times are believed, in the order in which they were recorded."""

    numbers: NDArray[np.intp]
    """(N,) among all messages of the stream."""
    time: Times
    """(N,) [ns] by the chosen clock."""


def stamped_in_order(name: str, stamp: Times, log_time: Times, is_header: bool) -> Ordered:
    """Return the messages whose times are believed, in the order in which they were recorded.

    Their times are the stamps (N,) [ns] of their headers, or else the times of recording (N,) [ns]. Stamps of 0, and a
    few that are far off the others, are left out with a warning. Where stamps step forward against the times of
    recording the clock was set: the step is taken out, with a warning. Raises FileError if times go back.
    """
    order = np.argsort(log_time, kind="stable")
    if not is_header:
        return Ordered(order, log_time[order])
    is_recorded = bool(np.ptp(log_time))
    stamp = stamp[order]
    offset = stamp - log_time[order]
    good = believed(stamp, log_time[order])
    if not good.all():
        first = int(np.argmin(good))
        words = "%s: %d of %d header stamps are 0 or far off the others and left out, the first is %.3f s"
        logger.warning(words, name, (~good).sum(), len(stamp), stamp[first] * 1e-9)
    kept = np.flatnonzero(good)
    advice = "; --clock log takes the times of recording" if is_recorded else ""
    if is_recorded:
        _check_pace(name, stamp[kept], log_time[order][kept], advice)
    kept = kept[in_order(f"{name}: header stamps", stamp[kept], advice)]
    step = _clock_step(name, stamp[kept], offset[kept]) if is_recorded else 0
    return Ordered(order[kept], stamp[kept] - step)


def believed(stamp: Times, log_time: Times) -> Flags:
    """Return flags (N,) of header stamps [ns] that are neither 0, but at the start of a clock, nor far off the others.

    Each is compared with its time of recording [ns], unless these are all equal. More than a few that are far off stay.
    """
    good = (stamp != 0) | (log_time <= _LIMITS.farthest_offset)
    if not good.any() or not np.ptp(log_time):
        return good
    offset = stamp - log_time
    is_far = good & (np.abs(offset - np.median(offset[good])) > _LIMITS.farthest_offset)
    return good & ~is_far if are_few(int(is_far.sum()), len(stamp)) else good


def check_not_rounded(name: str, stamp: Times, advice: str) -> None:
    """Raise FileError if stamps (N,) [ns], none of which is 0, are too coarse, as float32 rounds seconds."""
    seconds = stamp[stamp != 0] * 1e-9
    steps = np.diff(np.unique(seconds))
    if not len(steps):
        return
    rounded = seconds.astype(np.float32)
    resolution = float(np.spacing(np.median(rounded)))
    if resolution > max(0.1 * float(np.median(steps)), 1e-4) and (np.abs(rounded - seconds) < 1e-8).all():
        raise FileError(f"{name} are exact to {resolution:.3g} s, as float32 rounds them{advice}")


def _check_pace(name: str, stamp: Times, log_time: Times, advice: str) -> None:
    """Raise FileError if stamps (N,) [ns] come in bunches where times of recording (N,) do not, as in a wrong unit."""
    if len(stamp) < _LIMITS.block:
        return
    step, usual = (float(np.median(np.abs(np.diff(times)))) * 1e-9 for times in (stamp, log_time))
    if 0.0 < step < _LIMITS.slow * usual:
        raise FileError(
            f"{name}: header stamps are, in the median, {step:.3g} s from one to the next, and times of recording "
            f"{usual:.3g} s: is a part of the stamps in another unit?{advice}"
        )


def _clock_step(name: str, stamp: Times, offset: Times) -> Times | int:
    """Return by how much each of the stamps (N,) [ns] is off since a clock was set, which a warning tells; else 0.

    Offsets (N,) [ns] from the times of recording show it: of a few messages the one that was least late tells the
    clock. Right is the part of the stamps that is nearer to these times, as then all streams are by one clock.
    """
    count = len(offset) // _LIMITS.block
    if count < 4:
        return 0
    clock = 1e-9 * offset[: count * _LIMITS.block].reshape(count, _LIMITS.block).max(axis=1)
    place = int(np.argmax(np.abs(np.diff(clock)))) + 1
    before = float(np.median(clock[:place]))
    after = float(np.median(clock[place:]))
    step = after - before
    if abs(step) <= _LIMITS.clock_step or abs(clock[place] - clock[place - 1]) <= 0.8 * abs(step):
        return 0
    begin = max((place - 1) * _LIMITS.block, 0)
    steps = np.abs(np.diff(offset[begin : (place + 1) * _LIMITS.block]))
    first = begin + 1 + int(np.argmax(steps))
    is_after_wrong = abs(after) >= abs(before)
    is_wrong = (np.arange(len(stamp)) >= first) == is_after_wrong
    words = "%s: header stamps step by %+.3f s against the times of recording at %.3f s: the clock was set, and %s"
    which = "later" if is_after_wrong else "earlier"
    logger.warning(words, name, step, stamp[first] * 1e-9, f"{which} stamps are taken as that much off")
    return np.where(is_wrong, round(1e9 * step) * (1 if is_after_wrong else -1), 0)
