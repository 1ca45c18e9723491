"""Paths of the object in each hypothesis, as linked lists that branches share: to branch costs nothing."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Paths = NDArray[Any]
"""(B,) of `Path`, or None for an empty one."""


class Path(NamedTuple):
    """Some poses of a path, and what came before them."""

    poses: Array
    """(N, 3) [m, m, rad]."""
    before: "Path | None"
    """The path up to there."""


def no_paths(rows: int) -> Paths:
    """Return empty paths."""
    return np.full(rows, None, object)


def extended(paths: Paths, poses: Array) -> Paths:
    """Return paths (B,) with poses (B, N, 3) at their ends."""
    longer = np.empty(len(paths), object)
    for row, (path, added) in enumerate(zip(paths, poses, strict=True)):
        longer[row] = Path(added, path)
    return longer


def poses_of(path: Path | None, most: float = np.inf) -> Array:
    """Return the poses (N, 3) of a path, or the last ones of it."""
    parts: list[Array] = []
    count = 0
    while path is not None and count < most:
        parts.append(path.poses)
        count += len(path.poses)
        path = path.before
    poses = np.concatenate([np.empty((0, 3)), *reversed(parts)])
    return poses[-int(most) :] if count > most else poses
