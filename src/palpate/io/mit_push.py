"""Pushes of a square by a round tip, MIT (mcubelab/cpush): JSON, plain or gzipped, at 1 kHz.

World frame and units are the file's: metres and radians, motion capture and robot in one frame. The tip has no
orientation; its heading is taken as constant over a run, along the net displacement of its centre (along world x if
that is under 1 cm). The sensor pose is the tip's apex, a radius ahead of the measured centre.

Recordings are read down to 30 Hz. Ground truth is judged before that, at the file's own rate, and is NaN where motion
capture drops out, or lags so far that the tip would be inside the square.
"""

import re
from pathlib import Path

import numpy as np

from palpate.arrays import Array, Flags
from palpate.checks import FARTHEST, NUMBERS, check_rows, checked_array, checked_times, is_near
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
    """Return true if the first key is one of these files."""
    return re.match(r'\s*\{\s*"(q_slider|q_pusher_\w+|time|u_control|vipi)JSON"\s*:', text_start(path)) is not None


def read_mit_push(path: Path) -> Recording:
    """Read one run. Raises FileError."""
    data = read_json(path)
    if missing := [key for key in KEYS if key not in data]:
        raise FileError(f"lacks {', '.join(missing)}; an MIT push has {', '.join(KEYS)}")
    time = checked_array(KEYS[0], data[KEYS[0]], NUMBERS, ("N",)).astype(np.float64)
    pose = checked_array(KEYS[1], data[KEYS[1]], NUMBERS, (3, len(time))).T.astype(np.float64)
    center = checked_array(KEYS[2], data[KEYS[2]], NUMBERS, (2, len(time))).T.astype(np.float64)
    check_rows(KEYS[0], time, np.isfinite(time), "a finite time [s]")
    check_rows(KEYS[2], center, is_near(center).all(axis=1), f"a position [m] up to {FARTHEST:g}")

    # The clock sometimes repeats or steps back; only samples that are later than all before them count.
    later = time > np.append(-np.inf, np.maximum.accumulate(time)[:-1])
    time, pose, center = checked_times(time[later]) - time[0], pose[later], center[later]
    x, y = center[-1] - center[0]
    heading = np.arctan2(y, x) if np.hypot(x, y) >= 0.01 else 0.0
    center_pose = np.column_stack([center, np.full(len(center), heading)])
    sensor_pose = se2.compose(center_pose, np.array([[TIP.radius, 0.0, 0.0]]))

    pose[~is_near(pose).all(axis=1)] = np.nan
    gap = TIP.gaps(sensor_pose, pose, SQUARE)
    # A gap below -3 mm is impossible between hard bodies: truth lags behind, from -2 mm on and until it is above again.
    forwards, backwards = (contact_flags(each, -3e-3, -2e-3) for each in (gap, gap[::-1]))
    untrusted = forwards | backwards[::-1] | _frozen(time, pose, center, _contact(gap))
    pose[untrusted] = gap[untrusted] = np.nan

    # A sample is the nearest to all that is between the middles to its neighbours; no list of all periods is made, for
    # a damaged time would make it endless.
    ends = np.floor(np.append((time[1:] + time[:-1]) / 2, time[-1] + 1e-9) * TIP.rate)
    keep = np.flatnonzero(np.diff(ends, prepend=-1.0) > 0)
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


def _contact(gap: Array) -> Flags:
    """Return contact flags (N,) from gaps (N,) [m].

    In undisturbed runs the gap wanders slowly between 1.0 and -1.4 mm, since motion capture and robot agree no better
    across the table; the noise on top is 0.1 mm.
    """
    return contact_flags(gap, touch=1.5e-3, release=2.0e-3)


def _frozen(time: Array, pose: Array, tip: Array, touching: Flags) -> Flags:
    """Return flags of frames (N,) at which motion capture repeats an old pose instead of measuring a new one.

    It delivers a pose every 4 ms, and in undisturbed runs the 99th percentile of holds is 8 ms. One that stays exactly
    the same for more than 20 ms while the tip touches the object and moves more than 0.5 mm is a drop-out, but for its
    first sample.
    """
    start = np.flatnonzero(np.append(True, (np.diff(pose, axis=0) != 0).any(axis=1)))
    end = np.append(start[1:], len(time) - 1)
    moved = np.hypot(*(tip[end] - tip[start]).T)
    dropped = (time[end] - time[start] > 0.02) & (moved > 0.5e-3) & touching[start]
    flags = np.repeat(dropped, np.diff(np.append(start, len(time))))
    flags[start] = False
    return flags
