"""Ground truth from a video, put into a recording."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.recording.recording import Recording
from palpate.truth.alignment import Alignment
from palpate.truth.watched import Watched

Array = NDArray[np.float64]

LONGEST_GAP = 0.1
"""[s] without the tag, after which nobody knows where the object is."""
SIGMA = "object_pose_sigma"
"""The field of a recording's `extra` that holds how well its truth is known: x, y [m] and angle [rad], (N, 3)."""


def with_truth(recording: Recording, watched: Watched, alignment: Alignment) -> Recording:
    """The recording with the object's poses in the world as the video shows them; NaN where it does not."""
    when = recording.time - alignment.delay
    after = np.clip(np.searchsorted(watched.time, when), 1, len(watched.time) - 1)
    known = (when >= watched.time[0]) & (when <= watched.time[-1])
    known &= watched.time[after] - watched.time[after - 1] <= LONGEST_GAP
    angle = np.unwrap(watched.pose[:, 2])
    columns = [np.interp(when, watched.time, values) for values in (*watched.pose[:, :2].T, angle)]
    pose = se2.compose(alignment.world_T_table, np.column_stack(columns))
    pose[~known] = np.nan
    table = alignment.sigma[:3]
    away = np.linalg.norm(np.column_stack(columns)[:, :2], axis=1, keepdims=True)
    place = np.sqrt(watched.sigma[:2] ** 2 + table[:2] ** 2 + (table[2] * away) ** 2)
    sigma = np.column_stack([place, np.full(len(when), np.hypot(watched.sigma[2], table[2]))])
    sigma[~known] = np.nan
    how = f"by an overhead camera and a tag {watched.height * 1e3:.0f} mm over the table, {alignment.delay:.3f} s apart"
    frames = recording.frames | {"object_pose": how}
    return replace(recording, object_pose=pose, extra={**recording.extra, SIGMA: sigma}, frames=frames)
