"""Where the object was, frame by frame: settled up to the current graph, and in it as each estimate was."""

import numpy as np
from numpy.typing import NDArray

from palpate.graph.trail import Trail
from palpate.graph.variables import LAG

Array = NDArray[np.float64]


class ObjectPath:
    """Keeps the poses of one object."""

    def __init__(self) -> None:
        """Begin with none."""
        self._settled, self._online = Trail(), Trail()
        self._began_at = 0.0  # [s], the current graph
        self.recent: list[tuple[float, Array]] = []
        """Time [s] and pose (3,) of the current graph's last frames as they were, LAG at most."""

    @property
    def lasts(self) -> float:
        """Time from the first frame of the current graph to the last one [s]; 0 where there is none."""
        return self.recent[-1][0] - self._began_at if self.recent else 0.0

    @property
    def settled(self) -> Array:
        """Poses (N, 3) up to the current graph."""
        return self._settled.rows().reshape(-1, 3)

    @property
    def online(self) -> Array:
        """Poses (N, 3) of the current graph as they were."""
        return self._online.rows().reshape(-1, 3)

    def estimated(self, time: float, pose: Array) -> None:
        """Add a frame of the current graph, which begins with it if there is none."""
        if not self.recent:
            self._began_at = time
        self._online.append(pose)
        self.recent = [*self.recent, (time, pose)][-LAG:]

    def stayed(self, pose: Array, frames: int = 1) -> None:
        """Add frames at one pose, which nothing changes afterwards."""
        for _ in range(frames):
            self._settled.append(pose)

    def settle(self, poses: Array) -> None:
        """End the current graph with these poses (N, 3)."""
        self._settled.extend(poses)
        self._online, self.recent = Trail(), []

    def copied(self) -> "ObjectPath":
        """Return one with the same poses that goes its own way."""
        other = ObjectPath()
        other._settled, other._online = self._settled.copied(), self._online.copied()
        other._began_at, other.recent = self._began_at, self.recent
        return other
