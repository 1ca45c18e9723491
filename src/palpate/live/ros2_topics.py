"""Topics of ROS 2 as sources of a live session. rclpy comes with ROS; palpate does not install it."""

import math
import os
import threading
import time
from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import cache
from importlib import import_module
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.errors import SettingError
from palpate.io.ros_messages import IMAGE_TYPES, POSE_TYPES, Pose, compressed_image, poses_of, raw_image, stamp_of
from palpate.live.sources import Clock, PoseSource, Refused, TimedPose, TouchImage, checked_pose
from palpate.types.space import STEEPEST, Plane, into_plane, plane_across


class Ros2Node:
    """A ROS 2 node, served by a thread of its own; it keeps to this machine unless the environment says otherwise."""

    def __init__(self, name: str, arguments: Sequence[str] = ()) -> None:
        """Join ROS under a name, with ROS arguments (--ros-args ...). Raises SettingError without rclpy."""
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        try:
            rclpy = import_module("rclpy")
        except ImportError as error:
            raise SettingError(
                "ROS 2 topics need rclpy, which comes with ROS 2 and cannot be imported here: source its setup.bash, "
                "and use a Python environment that sees it (python3 -m venv --system-site-packages)"
            ) from error
        self._context = rclpy.Context()
        no_signals = import_module("rclpy.signals").SignalHandlerOptions.NO
        rclpy.init(args=list(arguments), context=self._context, signal_handler_options=no_signals)
        self.node: Any = rclpy.create_node(name, context=self._context)
        """The node of rclpy."""
        self._executor = import_module("rclpy.executors").SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, name="palpate-ros2", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave ROS."""
        self._executor.shutdown()
        self._thread.join()
        self.node.destroy_node()
        self._context.try_shutdown()

    def messages(self, topic: str, types: Collection[str], stop: threading.Event) -> Iterator[Any]:
        """Yield the messages of a topic as they arrive and, as text, notes for the user; ends at the event.

        Type and reliability are those of the first publisher. Raises SettingError if its type is none of `types`.
        """
        try:
            topic = self.node.resolve_topic_name(topic)
        except import_module("rclpy.exceptions").InvalidTopicNameException as error:
            raise SettingError(f"{topic!r} is no name of a topic: {str(error).splitlines()[0]}") from error
        publisher = yield from self._first_publisher(topic, types, stop)
        if publisher is None:
            return
        waiting: SimpleQueue[Any] = SimpleQueue()
        qos = import_module("rclpy.qos").QoSProfile(depth=100, reliability=publisher.qos_profile.reliability)
        subscription = self.node.create_subscription(message_type(publisher.topic_type), topic, waiting.put, qos)
        try:
            while not stop.is_set():
                with suppress(Empty):
                    yield waiting.get(timeout=0.05)
        finally:
            self.node.destroy_subscription(subscription)

    def _first_publisher(self, topic: str, types: Collection[str], stop: threading.Event) -> Generator[str, None, Any]:
        """Return the first publisher of a topic, None at the event; yield a note after two seconds without one."""
        begin, is_noted = time.monotonic(), False
        while not stop.wait(0.05):
            for publisher in self.node.get_publishers_info_by_topic(topic):
                if publisher.topic_type in types:
                    return publisher
                found = f"topic {topic} has messages of type {publisher.topic_type}"
                raise SettingError(f"{found}, allowed are {', '.join(types)}")
            if not is_noted and time.monotonic() - begin > 2.0:
                is_noted = True
                yield f"nobody publishes {topic} yet, of type {' or '.join(types)}"
        return None


class Ros2Clock(Clock):
    """The clock of ROS, which may be simulated, in seconds after the session's start."""

    def __init__(self, ros: Ros2Node) -> None:
        """Start at 0 s, now."""
        self._clock = ros.node.get_clock()
        self.epoch = self._clock.now().nanoseconds  # times after it are small enough to resolve nanoseconds

    def now(self) -> float:
        """Return the time [s]."""
        return (self._clock.now().nanoseconds - self.epoch) * 1e-9


def ros2_images(ros: Ros2Node, topic: str, clock: Clock, stop: threading.Event) -> Iterator[TouchImage | str]:
    """Yield touch images of a topic with the time of their stamp, or of their arrival without a stamp.

    Raises FileError if they are no colour images.
    """
    for message in ros.messages(topic, IMAGE_TYPES, stop):
        if isinstance(message, str):
            yield message
        elif hasattr(message, "format"):
            yield TouchImage(_time(message, clock), *compressed_image(message))
        else:
            yield TouchImage(_time(message, clock), raw_image(message))


class Ros2Poses:
    """Sensor poses of a topic, projected into the plane with a normal through the first of them."""

    def __init__(self, ros: Ros2Node, topic: str, clock: Clock, normal: ArrayLike = (0.0, 0.0, 1.0)) -> None:
        """Take times as `ros2_images` does; the plane's normal (3,) is in the frame of the poses."""
        self._ros, self._topic, self._clock = ros, topic, clock
        self._normal = np.asarray(normal, np.float64)
        self.plane: Plane | None = None
        """The plane; known from the first pose on."""

    def poses(self, stop: threading.Event) -> Iterator[TimedPose | Refused | str]:
        """Yield poses as they arrive, with refusals and notes for the user; ends at the event."""
        for message in self._ros.messages(self._topic, POSE_TYPES, stop):
            if isinstance(message, str):
                yield message
            else:
                yield self._planar(poses_of(message)[0], _time(message, self._clock))

    def _planar(self, pose: Pose, time: float) -> TimedPose | Refused:
        position, rotation = np.array([pose.numbers[:3]]), np.array([pose.numbers[3:]])
        if not np.isfinite(position).all() or not abs(math.hypot(*pose.numbers[3:]) - 1.0) < 1e-2:
            return Refused(f"{list(pose.numbers)}; allowed are a finite position and a quaternion of length 1")
        if self.plane is None:
            self.plane = plane_across(pose.frame, self._normal, position)
        if pose.frame != self.plane.frame:
            return Refused(f"it is given in frame {pose.frame!r}, the first was in {self.plane.frame!r}")
        placed, height, angle = into_plane(self.plane, position, rotation)
        if abs(off := height[0] - self.plane.height) > 0.01:
            return Refused(f"it is {off * 1e3:.1f} mm off the plane of the first, allowed are 10 mm")
        if abs(angle[0]) > STEEPEST:
            found = f"its x axis is {np.degrees(angle[0]):.1f} degrees out of the plane"
            return Refused(f"{found}, allowed are {np.degrees(STEEPEST):.0f}")
        return checked_pose(time, placed[0], self._clock.now())


@contextmanager
def ros2_poses(topic: str, clock: Clock) -> Iterator[PoseSource]:
    """Open the sensor poses of a topic, by a node of their own, while the block runs."""
    with closing(Ros2Node("palpate_live")) as ros:
        yield Ros2Poses(ros, topic, clock).poses


@cache
def message_type(name: str) -> Any:
    """Return the class of a message type such as geometry_msgs/msg/Pose. Raises SettingError if it is not installed."""
    package, _, type_ = name.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), type_)
    except ImportError as error:
        raise SettingError(f"messages of type {name} need {package}, which is not installed in this ROS") from error


def _time(message: Any, clock: Clock) -> float:
    """Return the time of a message's stamp [s], or that of its arrival if it has none."""
    stamp = stamp_of(message)
    return (stamp - clock.epoch) * 1e-9 if stamp else clock.now()
