"""Contact by geometry, and ground truth that cannot be right."""

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def gaps(sensor_pose: Array, object_pose: Array, shape: Shape, sensor: SensorProfile) -> Array:
    """Return the distance of the sensor's surface from the outline (N,) [m]; negative is overlap.

    From world_T_sensor and world_T_object (N, 3); NaN where the object pose is.
    """
    gap = np.full(len(sensor_pose), np.nan)
    known = ~np.isnan(object_pose).any(axis=1)
    object_T_sensor = se2.between(object_pose[known], sensor_pose[known])
    centers = se2.transform(object_T_sensor[:, None], sensor.round_centers)
    gap[known] = shape.signed_distance(centers).min(axis=1) - sensor.radius
    return gap


def contact_flags(gap: Array, touch: float, release: float) -> Flags:
    """Return contact flags (N,) from gaps (N,) [m]: contact begins below `touch` and ends above `release`.

    Where the gap is in between or NaN the last flag stays; the first is false until something is known.
    """
    return _switch(gap < touch, gap > release)


def impossible(gap: Array) -> Flags:
    """Return flags of frames (N,) in which, by the gap (N,) [m], the sensor is inside the object: truth lags behind.

    A gap below -3 mm is impossible between hard bodies, and only late truth explains it, until it is above -2 mm again.
    """

    def late(gap: Array) -> Flags:
        return _switch(gap < -3e-3, gap > -2e-3)

    # Lateness grows from nothing, so it is there before the gap crosses the limit: run backwards too.
    return late(gap) | late(gap[::-1])[::-1]


def held(time: Array, object_pose: Array, tip: Array, touching: Flags, longest: float) -> Flags:
    """Return flags of frames (N,) at which motion capture repeats an old pose instead of measuring a new one.

    A live system measures with noise, so a pose that stays exactly the same for more than `longest` [s],
    while the tip (N, 2) [m] touches the object and moves more than 0.5 mm, is a drop-out. All of it counts
    but its first sample. An object at rest may be reported without noise, which is why the tip has to move.
    """
    start = np.flatnonzero(np.append(True, (np.diff(object_pose, axis=0) != 0).any(axis=1)))
    # A hold lasts until the next pose arrives; the last one until the end of the file.
    end = np.append(start[1:], len(time) - 1)
    moved = np.hypot(*(tip[end] - tip[start]).T)
    dropped = (time[end] - time[start] > longest) & (moved > 0.5e-3) & touching[start]
    flags = np.repeat(dropped, np.diff(np.append(start, len(time))))
    flags[start] = False
    return flags


def spikes(object_pose: Array) -> Flags:
    """Return flags of frames (N,) whose pose is over 2 mm or 2 degrees off the median of itself and both neighbours.

    Neighbours are different poses: one that is held counts once. A knock by hand moves the object as far in
    one sample, but onwards and not back, and the median of three lets every onward motion pass.
    """
    known = np.flatnonzero(~np.isnan(object_pose).any(axis=1))
    poses = object_pose[known]
    start = np.flatnonzero(np.append(True, (np.diff(poses, axis=0) != 0).any(axis=1)))[: len(poses)]
    fresh = poses[start]
    fresh[:, 2] = np.unwrap(fresh[:, 2])
    padded = np.concatenate([fresh[:1], fresh, fresh[-1:]])
    off = np.abs(fresh - np.median([padded[:-2], fresh, padded[2:]], axis=0))
    wrong = (np.hypot(off[:, 0], off[:, 1]) > 2e-3) | (off[:, 2] > np.radians(2.0))
    flags = np.zeros(len(object_pose), np.bool_)
    flags[known] = np.repeat(wrong, np.diff(np.append(start, len(poses))))
    return flags


def _switch(on: Flags, off: Flags) -> Flags:
    """Return flags (N,) that turn true at `on`, false at `off` and stay as they are elsewhere; false at first."""
    index = np.where(on | off, np.arange(len(on)), -1)
    last = np.maximum.accumulate(index)
    return on[last] & (last >= 0)
