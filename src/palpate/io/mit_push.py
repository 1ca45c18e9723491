"""Pushes of a square by a round tip, MIT (mcubelab/cpush): JSON, plain or gzipped, at 1 kHz.

World frame and units are the file's: metres and radians, motion capture and robot in one frame. The tip has no
orientation; its heading is taken as constant over a run, along the net displacement of its centre (along world x if
that is under 1 cm). The sensor pose is the tip's apex, a radius ahead of the measured centre.

Recordings are thinned to 30 Hz. Ground truth is judged before that, at the file's own rate, and is NaN where motion
capture drops out, or lags so far that the tip would be inside the square.
"""

import re
from pathlib import Path

import numpy as np

from palpate.arrays import Array, Flags, Integers
from palpate.checks import FARTHEST, NUMBERS, are_in_range, check_rows, checked_array, checked_times
from palpate.errors import FileError
from palpate.files import read_json, text_start
from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle
from palpate.io.recording import Recording, contact_flags
from palpate.types.sensor import SensorProfile

SQUARE = Rectangle(0.09, 0.09)
TIP = SensorProfile(name="MIT point tip", radius=0.00475, rate=30.0)
KEYS = ("timeJSON", "q_sliderJSON", "q_pusher_sensedJSON")


def is_mit_push(path: Path) -> bool:
    """Return true if the first key of a JSON file is one of those in this data set."""
    return re.match(r'\s*\{\s*"(q_slider|q_pusher_\w+|time|u_control|vipi)JSON"\s*:', text_start(path)) is not None


def read_mit_push(path: Path) -> Recording:
    """Read one run. Raises FileError."""
    data = read_json(path)
    missing = [key for key in KEYS if key not in data]
    if missing:
        raise FileError(f"lacks {', '.join(missing)}; an MIT push has {', '.join(KEYS)}")
    time = checked_array(KEYS[0], data[KEYS[0]], NUMBERS, ("N",)).astype(np.float64)
    pose = checked_array(KEYS[1], data[KEYS[1]], NUMBERS, (3, len(time))).T.astype(np.float64)
    center = checked_array(KEYS[2], data[KEYS[2]], NUMBERS, (2, len(time))).T.astype(np.float64)
    check_rows(KEYS[0], time, np.isfinite(time), "a finite time [s]")
    check_rows(KEYS[2], center, are_in_range(center).all(axis=1), f"a position [m] up to {FARTHEST:g}")

    # The clock sometimes repeats or steps back; only samples that are later than all before them count.
    is_later = time > np.append(-np.inf, np.maximum.accumulate(time)[:-1])
    time = checked_times(time[is_later]) - time[0]
    pose = pose[is_later]
    center = center[is_later]
    center_pose = np.column_stack([center, np.full(len(center), _heading(center))])
    sensor_pose = se2.compose(center_pose, np.array([[TIP.radius, 0.0, 0.0]]))

    pose[~are_in_range(pose).all(axis=1)] = np.nan
    gap = TIP.gaps(sensor_pose, pose, SQUARE)
    # A gap below -3 mm is impossible between hard bodies: truth lags behind, from the last time that the gap was above
    # -2 mm until the next one. So the flags are taken in both directions of time.
    is_late = contact_flags(gap, -3e-3, -2e-3) | contact_flags(gap[::-1], -3e-3, -2e-3)[::-1]
    is_untrusted = is_late | _frozen(time, pose, center, _contact(gap))
    pose[is_untrusted] = np.nan
    gap[is_untrusted] = np.nan

    keep = _nearest_to_grid(time)
    return Recording(
        time=time[keep],
        sensor_pose=sensor_pose[keep],
        shape=SQUARE,
        sensor=TIP,
        object_pose=pose[keep],
        contact=_contact(gap[keep]),
        source=f"MIT cpush, {path.name}, read at {TIP.rate:g} Hz",
        file=path,
    )


def _heading(center: Array) -> float:
    """Return the direction [rad] from the first to the last position (N, 2) [m]; 0 if they are nearly the same."""
    x, y = center[-1] - center[0]
    return float(np.arctan2(y, x)) if np.hypot(x, y) >= 0.01 else 0.0


def _nearest_to_grid(time: Array) -> Integers:
    """Return the indices of the samples (N,) [s] that are nearest to multiples of the period of the recording."""
    # A sample is nearest to all times up to the middles to its neighbours; it is kept if a multiple of the period is
    # among them. No list of all multiples is made, as a damaged time would make it endless.
    end = np.append((time[1:] + time[:-1]) / 2, time[-1] + 1e-9)
    last_multiple = np.floor(end * TIP.rate)
    return np.flatnonzero(np.diff(last_multiple, prepend=-1.0) > 0)


def _contact(gap: Array) -> Flags:
    """Return contact flags (N,) from gaps (N,) [m].

    In undisturbed runs the gap wanders slowly between 1.0 and -1.4 mm, since motion capture and robot agree no better
    across the table; the noise on top is 0.1 mm.
    """
    return contact_flags(gap, touch=1.5e-3, release=2.0e-3)


def _frozen(time: Array, pose: Array, tip: Array, touching: Flags) -> Flags:
    """Return flags of frames (N,) at which motion capture repeats an old pose instead of measuring a new one.

    It delivers a pose every 4 ms, and in undisturbed runs 99 of 100 poses are held for 8 ms or less. If a pose stays
    exactly the same for more than 20 ms while the tip touches the object and moves more than 0.5 mm, it is a drop-out,
    but for its first sample.
    """
    start = np.flatnonzero(np.append(True, (np.diff(pose, axis=0) != 0).any(axis=1)))
    end = np.append(start[1:], len(time) - 1)
    moved = np.hypot(*(tip[end] - tip[start]).T)
    dropped = (time[end] - time[start] > 0.02) & (moved > 0.5e-3) & touching[start]
    flags = np.repeat(dropped, np.diff(np.append(start, len(time))))
    flags[start] = False
    return flags
