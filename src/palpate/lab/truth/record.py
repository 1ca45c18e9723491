"""Ground truth from a video, in the robot's world and put into a recording."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.lab.truth.alignment import Alignment
from palpate.lab.truth.seen_poses import SIGMA, poses_at
from palpate.lab.truth.watched import Watched
from palpate.types.recording import Recording

Array = NDArray[np.float64]


def in_world(pose: Array, sigma: Array, alignment: Alignment) -> tuple[Array, Array]:
    """Return poses (N, 3) on the table as poses in the world, and their standard deviations (N, 3) [m, m, rad].

    `sigma` (3,) is that of the poses on the table.
    """
    table = alignment.sigma[:3]
    away = np.linalg.norm(pose[:, :2], axis=1, keepdims=True)
    place = np.sqrt(sigma[:2] ** 2 + table[:2] ** 2 + (table[2] * away) ** 2)
    angle = np.full(len(pose), np.hypot(sigma[2], table[2]))
    return se2.compose(alignment.world_T_table, pose), np.column_stack([place, angle])


def with_truth(recording: Recording, watched: Watched, alignment: Alignment) -> Recording:
    """The recording with the object's poses in the world as the video shows them; NaN where it does not."""
    seen = in_world(watched.pose, watched.sigma, alignment)
    pose, sigma = poses_at(recording.time, watched.time + alignment.delay, *seen)
    how = f"by an overhead camera and a tag {watched.height * 1e3:.0f} mm over the table, {alignment.delay:.3f} s apart"
    frames = recording.frames | {"object_pose": how}
    return replace(recording, object_pose=pose, extra={**recording.extra, SIGMA: sigma}, frames=frames)
