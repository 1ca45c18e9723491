"""Poses that stand alone: one wrong value among many costs itself, and two senders of one pose are told.

A pose strays if the stream leaps to it and at once back to where it was, which no robot does.
"""

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.arrays import Array, Flags, Times
from palpate.errors import FileError

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Limits:
    """Limits of what is found here."""

    leap: float = 4e-3
    """[m] Least distance of a leap; a turn counts as that of a point at _LIMITS.lever."""
    acceleration: float = 10.0
    """[m/s^2] of a robot arm at most: a larger one is no motion."""
    lever: float = 0.05
    """[m] Distance at which turns count."""
    longest: int = 3
    """Poses in a row that may stray."""
    close: float = 0.9
    """Share of a leap within which the stream comes back to where it was."""
    few_leaps: int = 8
    """Leaps of which too little can be said to blame a second sender."""
    alike: float = 0.8
    """Share of the mean length of leaps that their mean has, from which they are alike, as to another sender."""


_LIMITS = _Limits()
MANY = 0.1
"""Share of poses above which those that are wrong are no few."""


def stray_poses(name: str, time: Times, position: Array, rotation: Any) -> Flags:
    """Return flags (N,) of poses at increasing times [ns] that stray from the others, which a warning counts.

    Raises FileError if there are many and their leaps are alike: two senders give different poses.
    """
    axes = rotation.as_matrix()[:, :, :2].reshape(len(time), -1)
    place = np.hstack([position, _LIMITS.lever * axes])
    seconds = (time - time[0]) * 1e-9
    leaps = np.zeros_like(place)
    for count in range(1, min(_LIMITS.longest, len(time) - 2) + 1):
        _mark_leaps(leaps, place, seconds, count)
    lengths = np.linalg.norm(leaps, axis=1)
    stray = lengths > 0.0
    number = int(stray.sum())
    if not number:
        return stray
    moment = f"first at {time[np.argmax(stray)] * 1e-9:.3f} s"
    if number <= max(1, MANY * len(time)):
        words = "%s: %d of %d poses leap by %.0f mm and at once back, %s, and are taken as unknown"
        logger.warning(words, name, number, len(time), 1e3 * lengths.max(), moment)
        return stray
    if number > _LIMITS.few_leaps and _are_alike(leaps[stray]):
        raise FileError(
            f"{name}: poses leap to and fro {number} times of {len(time)}, by {1e3 * lengths[stray].mean():.0f} mm, "
            f"{moment}: do two senders give it, in different frames? allowed is one"
        )
    return np.zeros(len(time), np.bool_)  # noise


def check_one_at_a_time(name: str, time: Times, position: Array) -> None:
    """Raise FileError if many of the times (N,) [ns], which do not go back, have positions (N, 3) [m] far apart."""
    way = np.linalg.norm(np.diff(position, axis=0), axis=1)
    is_double = (np.diff(time) == 0) & (way > _LIMITS.leap)
    if is_double.sum() > max(1, MANY * len(time)):
        first = int(np.argmax(is_double))
        raise FileError(
            f"{name}: {is_double.sum()} of {len(time)} poses have the time of another one and are up to "
            f"{1e3 * way[is_double].max():.0f} mm from it, first at {time[first] * 1e-9:.3f} s: are these two takes or "
            "two senders, or was a clock set back? allowed is one pose at a time"
        )


def _mark_leaps(leaps: Array, place: Array, seconds: Array, count: int) -> None:
    """Write the leaps of `count` places in a row (N, 9) from the way between the places before and after them."""
    number = len(place)
    before = np.arange(number - count - 1)
    after = before + count + 1
    span = seconds[after] - seconds[before]
    apart = np.linalg.norm(place[after] - place[before], axis=1)
    found: list[Array] = []
    is_leap = np.ones(len(before), np.bool_)
    for shift in range(1, count + 1):
        since = seconds[before + shift] - seconds[before]
        way = place[before] + (since / span)[:, None] * (place[after] - place[before])
        off = place[before + shift] - way
        length = np.linalg.norm(off, axis=1)
        is_leap &= length > _LIMITS.leap + 0.5 * _LIMITS.acceleration * since * (span - since)
        is_leap &= apart < _LIMITS.close * length
        found.append(off)
    for shift, off in enumerate(found, 1):
        leaps[before[is_leap] + shift] = off[is_leap]


def _are_alike(leaps: Array) -> bool:
    """Return true if leaps (N, 9) have one direction and length, forwards or backwards."""
    _, _, axes = np.linalg.svd(leaps, full_matrices=False)
    along = leaps * np.sign(leaps @ axes[0])[:, None]
    return bool(np.linalg.norm(along.mean(axis=0)) > _LIMITS.alike * np.linalg.norm(leaps, axis=1).mean())
