"""Trusted ground truth of a recording, and runs of flags."""

import numpy as np
from numpy.typing import NDArray

from palpate.types.recording import Recording, spikes

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def trusted_truth(recording: Recording) -> Flags:
    """Return True at frames (N,) whose ground truth is known and does not jump away and back."""
    if recording.object_pose is None:
        return np.zeros(len(recording), np.bool_)
    return np.isfinite(recording.object_pose[:, 0]) & ~spikes(recording.object_pose)


def known_truth(recording: Recording) -> Array | None:
    """Return ground truth (N, 3) where it can be trusted, NaN elsewhere; None if there is none."""
    if recording.object_pose is None:
        return None
    return np.where(trusted_truth(recording)[:, None], recording.object_pose, np.nan)


def flag_runs(flags: Flags) -> list[tuple[int, int]]:
    """Return the first and last index of each run of true flags (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [(int(start), int(end) - 1) for start, end in edges.reshape(-1, 2)]


def time_gaps(time: Array) -> NDArray[np.intp]:
    """Return the frames after which others are missing, from times (N,) [s]: three median intervals or more."""
    step = np.diff(time)
    return np.flatnonzero(step > 3.0 * np.median(step)) if len(step) else np.empty(0, np.intp)
