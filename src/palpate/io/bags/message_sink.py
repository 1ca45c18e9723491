"""Where ROS messages go, one after the other: into a file, or to whoever subscribes to a node."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class MessageSink(ABC):
    """Makes messages by the names of their types, such as geometry_msgs/msg/Pose, and takes them."""

    @abstractmethod
    def add(self, topic: str, type_: str, time: int, **fields: Any) -> None:
        """Take a message of a time [ns] on a topic."""

    @abstractmethod
    def make(self, type_: str, **fields: Any) -> Any:
        """A message, or a part of one."""

    def header(self, time: int, frame: str) -> Any:
        """The header of a message of a time [ns] in a frame."""
        stamp = self.make("builtin_interfaces/msg/Time", sec=time // 10**9, nanosec=time % 10**9)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def pose(self, position: Array, rotation: Array) -> Any:
        """A pose in space: position (3,) [m], quaternion x, y, z, w (4,)."""
        x, y, z = position.tolist()
        qx, qy, qz, qw = rotation.tolist()
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self.make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
        )
