"""Poses of the object that were seen now and then, as by a camera, at the times of frames."""

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2

Array = NDArray[np.float64]

LONGEST_GAP = 0.1
"""[s] without a pose, after which nobody knows where the object is."""
SIGMA = "object_pose_sigma"
"""The field of a recording's `extra` that holds how well its truth is known: x, y [m] and angle [rad], (N, 3)."""


def poses_at(when: Array, time: Array, pose: Array, sigma: Array) -> tuple[Array, Array]:
    """Return poses and their standard deviations, (M, 3) each [m, m, rad], at times (M,) [s].

    They were seen at times (N,), increasing, as poses (N, 3) with standard deviations (N, 3). NaN before the first,
    after the last and in gaps.
    """
    if len(time) < 2:
        return np.full((len(when), 3), np.nan), np.full((len(when), 3), np.nan)
    after = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    known = (when >= time[0]) & (when <= time[-1]) & (time[after] - time[after - 1] <= LONGEST_GAP)
    spread = np.column_stack([np.interp(when, time, values) for values in sigma.T])
    found = se2.interpolated(when, time, pose)
    return np.where(known[:, None], found, np.nan), np.where(known[:, None], spread, np.nan)
