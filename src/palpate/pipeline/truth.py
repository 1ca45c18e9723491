"""Which ground truth can be trusted, and where a flag holds."""

import numpy as np
from numpy.typing import NDArray

from palpate.types import derived
from palpate.types.recording import Recording

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def trusted_truth(recording: Recording) -> Flags:
    """The frames (N,) whose ground truth is known and does not jump away and back."""
    if recording.object_pose is None:
        return np.zeros(len(recording), np.bool_)
    return np.isfinite(recording.object_pose[:, 0]) & ~derived.spikes(recording.object_pose)


def known_truth(recording: Recording) -> Array | None:
    """Ground truth (N, 3) where it can be trusted, NaN elsewhere; None if there is none."""
    if recording.object_pose is None:
        return None
    return np.where(trusted_truth(recording)[:, None], recording.object_pose, np.nan)


def flag_runs(flags: Flags) -> list[tuple[int, int]]:
    """First and last index of each run of true flags (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [(int(start), int(end) - 1) for start, end in edges.reshape(-1, 2)]
