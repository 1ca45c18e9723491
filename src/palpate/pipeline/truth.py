"""Ground truth of a recording where it can be trusted, and runs of flags."""

import numpy as np
from numpy.typing import NDArray

from palpate.types.recording import Recording

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def known_truth(recording: Recording) -> Array:
    """Return ground truth (N, 3) where it can be trusted, NaN elsewhere."""
    truth = np.nan if recording.object_pose is None else recording.object_pose
    return np.where(recording.trusted_truth[:, None], truth, np.full((1, 3), np.nan))


def flag_runs(flags: Flags) -> list[tuple[int, int]]:
    """Return the first and last index of each run of true flags (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return [(int(start), int(end) - 1) for start, end in edges.reshape(-1, 2)]
