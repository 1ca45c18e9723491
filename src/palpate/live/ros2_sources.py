"""Topics of ROS 2 as the sources of a live session: touch images, and poses of the sensor."""

import math
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.io.bags.choices import BagChoices
from palpate.io.bags.messages import IMAGE_TYPES, POSE_TYPES, Pose, compressed_image, poses_of, raw_image, stamp_of
from palpate.live.clock import Clock
from palpate.live.images import TouchImage
from palpate.live.poses import PoseSource, Refused, TimedPose
from palpate.live.ros2 import Ros2Node
from palpate.live.udp import timely
from palpate.types.plane import STEEPEST, Plane, into_plane, plane_across

OFF_PLANE = BagChoices().off_plane
"""[m] that poses may be off the plane."""


class Ros2Images:
    """Touch images of a topic."""

    def __init__(self, ros: Ros2Node, topic: str, clock: Clock, epoch: int = 0) -> None:
        """Take the clock by which they get their times, and what is 0 s [ns] of their stamps."""
        self._ros, self._topic, self._clock, self._epoch = ros, topic, clock, epoch

    def images(self, stop: threading.Event) -> Iterator[TouchImage | str]:
        """Yield each image as it comes, and what is to be said; ends at the event.

        Raises FileError where they are no colour images, SettingError where the topic is of another type.
        """
        said = False
        for message in self._ros.messages(self._topic, IMAGE_TYPES, stop):
            if isinstance(message, str):
                yield message
                continue
            if not (said or stamp_of(message)):
                said = True
                yield "the images have no stamps, so each is of the time at which it comes"
            time = _time(message, self._clock, self._epoch)
            if hasattr(message, "format"):
                yield TouchImage(time, *compressed_image(message))
            else:
                yield TouchImage(time, raw_image(message))


class Ros2Poses:
    """Poses of the sensor on a topic, laid into the plane across a normal through the first of them."""

    def __init__(
        self, ros: Ros2Node, topic: str, clock: Clock, epoch: int = 0, normal: ArrayLike = (0.0, 0.0, 1.0)
    ) -> None:
        """Take the clock by which they get their times, what is 0 s [ns] of their stamps, and the plane's normal (3,).

        The normal is in the frame of the poses.
        """
        self._ros, self._topic, self._clock, self._epoch = ros, topic, clock, epoch
        self._normal = np.asarray(normal, np.float64)
        self.plane: Plane | None = None
        """Known from the first pose on."""

    def poses(self, stop: threading.Event) -> Iterator[TimedPose | Refused | str]:
        """Yield each pose as it comes, what is wrong with anything else, and what is to be said; ends at the event."""
        for message in self._ros.messages(self._topic, POSE_TYPES, stop):
            if isinstance(message, str):
                yield message
            else:
                pose = self._planar(poses_of(message)[0], _time(message, self._clock, self._epoch))
                yield timely(pose, self._clock.now())

    def _planar(self, pose: Pose, time: float) -> TimedPose | Refused:
        position, rotation = np.array([pose.numbers[:3]]), np.array([pose.numbers[3:]])
        if not np.isfinite(position).all() or not abs(math.hypot(*pose.numbers[3:]) - 1.0) < 1e-2:
            return Refused(f"{list(pose.numbers)}; allowed are a finite position and a quaternion of length 1")
        if self.plane is None:
            self.plane = plane_across(pose.frame, self._normal, position)
        if pose.frame != self.plane.frame:
            return Refused(f"it is given in frame {pose.frame!r}, the first was in {self.plane.frame!r}")
        placed, height, angle = into_plane(self.plane, position, rotation)
        if abs(off := height[0] - self.plane.height) > OFF_PLANE:
            return Refused(f"it is {off * 1e3:.1f} mm off the plane of the first, allowed are {OFF_PLANE * 1e3:g} mm")
        if abs(angle[0]) > STEEPEST:
            found = f"its x axis is {np.degrees(angle[0]):.1f} degrees out of the plane"
            return Refused(f"{found}, allowed are {np.degrees(STEEPEST):.0f}")
        return TimedPose(time, placed[0])


def ros2_poses(topic: str, clock: Clock) -> tuple[PoseSource, Callable[[], None]]:
    """Poses of the sensor on a topic, by a node of their own, and what closes it where it is not used.

    Raises SettingError without rclpy.
    """
    ros = Ros2Node("palpate_live")

    def poses(stop: threading.Event) -> Iterator[TimedPose | Refused | str]:
        try:
            yield from Ros2Poses(ros, topic, clock).poses(stop)
        finally:
            ros.close()

    return poses, ros.close


def _time(message: Any, clock: Clock, epoch: int) -> float:
    """The time of a message's header [s]; that at which it came where it has none."""
    stamp = stamp_of(message)
    return (stamp - epoch) * 1e-9 if stamp else clock.now()
