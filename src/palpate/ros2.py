"""palpate as a ROS 2 node: a live session whose sources and results are topics. rclpy comes with ROS 2.

`palpate ros2 --ros-args -p shape:=NAME -p first_pose:='[x, y, theta]' -r image:=/digit/image_raw ...`
"""

import os
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from queue import Empty, SimpleQueue
from typing import Any

from palpate.cli.console import complain
from palpate.cli.learnt_outline import unknown_in_words
from palpate.cli.options import hand_in_words
from palpate.config import TrackerSettings
from palpate.errors import FrameError, PalpateError, SettingError, one_line
from palpate.geometry.shapes import Shape
from palpate.io import ros_messages as ros
from palpate.io.estimates import (
    DIAGNOSTICS,
    OUTLINE_POINTS,
    OUTLINES,
    POSES,
    POSES_WITH_COVARIANCE,
    estimate_messages,
)
from palpate.io.outlines import load_shape
from palpate.live.session import LiveSession, stop_on_signals
from palpate.live.sources import ImageSource, Sources, TimedPose, TouchImage, checked_pose, together
from palpate.touch.calibration import load_calibration
from palpate.touch.touch_model import TouchModel
from palpate.tracker import Tracker
from palpate.types.choices import DEFAULT_SENSOR, Placement
from palpate.types.estimate import Estimate
from palpate.types.hand import Hand, by_finger
from palpate.types.images import AS_IT_IS, camera_view, decode_image
from palpate.types.outline import Sketch, Unknown
from palpate.types.sensor import SensorProfile
from palpate.types.sensor_file import known_sensor
from palpate.types.space import GelPoses

IMAGES = "image"
"""Topic of the touch images; users remap it."""
SENSOR_POSES = "sensor_pose"
"""Topic of the sensor's poses; users remap it."""
TOPICS = {
    POSES: ros.POSE,
    POSES_WITH_COVARIANCE: ros.POSE_WITH_COVARIANCE,
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
    **dict.fromkeys(OUTLINES, ros.POLYGON),
    OUTLINE_POINTS: ros.POINTS,
}
"""Topics that the node publishes, with their types."""


USAGE = """usage: palpate ros2 [--ros-args [-p NAME:=VALUE ...] [-r FROM:=TO ...]]

Tracks an object as a ROS 2 node until Ctrl-C. It needs rclpy, which comes with ROS 2.

Example: palpate ros2 --ros-args -p shape:=rectangle -p first_pose:='[0.1, 0.0, 0.3]' -r image:=/digit/image_raw

Topics to remap
  image        touch images: sensor_msgs Image or CompressedImage; of a hand left/image, right/image
  sensor_pose  poses of the sensor, or of the hand: PoseStamped, Odometry and others

Parameters
  shape             the object: a name, the sides of a rectangle such as 0.09x0.06 [m], a file, or unknown, or
                    unknown:50mm-200mm with its least and largest width; needed
  outline_sigma     standard deviation of the true outline across the shape, a sketch [m]; it is as drawn if not given
  first_pose        its pose at the start, [x, y, theta] in m, m, rad; needed unless the shape is unknown
  first_pose_sigma  its standard deviations
  sensor            its name, or a profile of palpate calibrate --new-sensor, my_sensor.toml; digit if not given
  mounts            of a hand, where each finger is in its frame, as 'left=0,20mm,0 right=0,-20mm,0'; sensor and
                    calibration are then of all fingers, or left=VALUE,right=VALUE
  model             folder of a touch model, or the name of a sensor whose own it is; the sensor's own if not given
  calibration       file of palpate calibrate
  tactile           learnt or none
  orientation       steps to make images upright
  sensor_T_gel      pose of the gel in the frame of the sensor's poses, [x, y, z, qx, qy, qz, qw]
  time_offset       added to the times of the images [s]
  plane             normal of the plane of the push, [x, y, z]

Topics that it publishes, below its own name
  object_pose, object_pose_with_covariance, diagnostics; of an outline that is learnt outline, outline_inner and
  outline_outer, the edges of its 95 % band, and outline_points, the points of all three
"""


def main(arguments: Sequence[str]) -> int:
    """Run the node until Ctrl-C and return its exit code; with --help, print how to run it."""
    if {"-h", "--help"} & set(arguments):
        sys.stdout.write(USAGE)
        return 0
    try:
        with ros_node(arguments) as node, stop_on_signals() as stop:
            run(node, stop)
    except PalpateError as error:
        complain(error)
        return 2
    return 0


def run(node: Any, stop: threading.Event) -> None:
    """Track until the event is set. Raises PalpateError if parameters, topics or images are unusable."""
    words = _parameter(node, "shape")
    first_pose = _parameter(node, "first_pose")
    outline = None if words is None else _outline(str(words), _parameter(node, "outline_sigma"))
    if outline is None or (first_pose is None and not isinstance(outline, Unknown)):
        raise SettingError(
            "the object is not known: the parameters shape and first_pose say it, "
            "-p shape:=rectangle -p first_pose:='[0.1, 0.0, 0.3]'"
        )
    sigma = _parameter(node, "first_pose_sigma")
    settings = TrackerSettings(_parameter(node, "tactile") or "learnt")
    calibration = _calibration(_parameter(node, "calibration"))
    sensor = _sensor(str(_parameter(node, "sensor") or DEFAULT_SENSOR), _parameter(node, "mounts"))
    given_model = _parameter(node, "model")
    model = None if given_model is None else TouchModel(str(given_model))
    if isinstance(sensor, Hand):
        fingers = {name: replace(finger, orientation="") for name, finger in sensor.fingers.items()}
        topics = Topics(node, next(iter(sensor.fingers.values())).orientation, tuple(fingers))
        upright = replace(sensor, fingers=fingers)
    else:
        topics = Topics(node, sensor.orientation)
        upright = replace(sensor, orientation="")  # as the topics' images are turned already
    options: Any = {"calibration": calibration, "first_pose_sigma": sigma, "is_view_known": topics.view.is_stated}
    tracker = Tracker(outline, upright, first_pose, settings, model, **options)
    sources = Sources(topics.images, topics.poses, topics.now, upright, topics.placement.time_offset)
    session = LiveSession(tracker, sources, node.get_logger().info)
    session.run(stop, partial(topics.publish, session.counts))
    session.say(", ".join(f"{count} {name.replace('_', ' ')}" for name, count in session.counts.items()))


def _outline(words: str, sigma: float | None) -> Shape | Unknown | Sketch:
    """Return an outline that is known, or one that touch learns: unknown, or a sketch by its standard deviation [m]."""
    unknown = unknown_in_words(words)
    if unknown is None:
        shape = load_shape(words)
        return shape if sigma is None else Sketch(shape, sigma)
    if sigma is not None:
        raise SettingError(f"outline_sigma is of a sketch; found shape {words}, allowed is a name or a file")
    return unknown


def _sensor(words: str, mounts: str | None) -> SensorProfile | Hand:
    """Return a sensor, or with the mounts of its fingers in words a hand."""
    return known_sensor(words) if mounts is None else hand_in_words(words, mounts.split())


def _calibration(words: str | None) -> Any:
    """Return the calibration in a file; of a hand, FILE for each FINGER= with commas."""
    if words is None:
        return None
    if "=" not in words:
        return load_calibration(words)
    return {finger: load_calibration(file) for finger, file in by_finger("calibration", words).items()}


@contextmanager
def ros_node(arguments: Sequence[str]) -> Iterator[Any]:
    """Join ROS as a node, served by a thread of its own, while the block runs.

    It is visible on this machine only, unless the environment says otherwise. Raises SettingError without rclpy.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        rclpy = import_module("rclpy")
    except ImportError as error:
        raise SettingError(
            "ROS 2 topics need rclpy, which comes with ROS 2 and cannot be imported here: source its setup.bash, "
            "and use a Python environment that sees it (python3 -m venv --system-site-packages)"
        ) from error
    no_signals = import_module("rclpy.signals").SignalHandlerOptions.NO
    try:
        rclpy.init(args=list(arguments), signal_handler_options=no_signals)
    except RuntimeError as error:  # of arguments that ROS does not know
        raise SettingError(f"ROS refuses these arguments: {one_line(error)}") from error
    node = rclpy.create_node("palpate")
    executor = import_module("rclpy.executors").SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    try:
        yield node
    finally:
        executor.shutdown()
        thread.join()
        node.destroy_node()
        rclpy.try_shutdown()


def _parameter(node: Any, name: str) -> Any:
    """Return the value of a parameter, None if it is not set."""
    any_type = message_type("rcl_interfaces/msg/ParameterDescriptor")(dynamic_typing=True)
    return node.declare_parameter(name, None, any_type).value or None


class Topics:
    """The topics of a session: images and sensor poses come in, estimates go out.

    The node's parameters are the orientation of images, the pose of the gel in the frame whose poses are published, and
    the normal of the plane through the first pose, into which poses are projected. Topics /palpate/... are published
    below the name of the node, whatever that is.
    """

    def __init__(self, node: Any, orientation: str = "", fingers: Sequence[str] = ()) -> None:
        """Take the node, the orientation of images if its parameter is not given, and the fingers of a hand.

        Raises SettingError if a parameter is unusable, or two fingers have one topic.
        """
        given: dict[str, Any] = {name: _parameter(node, name) for name in ("sensor_T_gel", "time_offset", "plane")}
        stated = {name: value for name, value in given.items() if value}
        self.placement = Placement(str(_parameter(node, "orientation") or orientation), **stated)
        self.view = camera_view(self.placement.orientation)
        self._gel_poses = GelPoses(self.placement)
        self._node = node
        self._clock = node.get_clock()
        self._start: int = self._clock.now().nanoseconds  # times after it are small enough to resolve nanoseconds
        self.images = self._images_of(fingers)
        """The source of touch images; raises FileError if they are no colour images."""
        self.poses = partial(self._messages, SENSOR_POSES, ros.POSE_TYPES, self._pose)
        """The source of sensor poses."""
        self._publishers: dict[str, Any] = {
            topic: node.create_publisher(message_type(type_), topic.replace("/palpate/", "~/", 1), 10)
            for topic, type_ in TOPICS.items()
        }

    def now(self) -> float:
        """Return the time of ROS, which may be simulated [s], after the session's start."""
        return (self._clock.now().nanoseconds - self._start) * 1e-9

    def _images_of(self, fingers: Sequence[str]) -> ImageSource:
        """Return the source of the sensor's images, or of those of a hand's fingers, each with a topic of its own."""
        if not fingers:
            return partial(self._messages, IMAGES, ros.IMAGE_TYPES, self._image)
        topics: dict[str, str] = {}
        for finger in fingers:
            topic = self._node.resolve_topic_name(f"{finger}/{IMAGES}")
            if topic in topics:
                raise SettingError(f"fingers {topics[topic]!r} and {finger!r} have one topic, {topic}; allowed are two")
            topics[topic] = finger
        return together(
            {finger: partial(self._messages, f"{finger}/{IMAGES}", ros.IMAGE_TYPES, self._image) for finger in fingers}
        )

    def _messages(
        self, topic: str, types: Collection[str], convert: Callable[[Any], Any], stop: threading.Event
    ) -> Iterator[Any]:
        """Yield the converted messages of a topic as they arrive and, as text, notes for the user.

        Type and reliability are those of the first publisher. Raises SettingError if its type is none of `types`.
        """
        topic = self._node.resolve_topic_name(topic)
        yield f"waiting for {topic}, of type {' or '.join(types)}"
        publishers = self._node.get_publishers_info_by_topic(topic)
        while not publishers:
            if stop.wait(0.05):
                return
            publishers = self._node.get_publishers_info_by_topic(topic)
        waiting: SimpleQueue[Any] = SimpleQueue()
        type_ = publishers[0].topic_type
        if type_ not in types:
            raise SettingError(f"topic {topic} has messages of type {type_}, allowed are {', '.join(types)}")
        qos = import_module("rclpy.qos").QoSProfile(depth=100, reliability=publishers[0].qos_profile.reliability)
        self._node.create_subscription(message_type(type_), topic, waiting.put, qos)
        while not stop.is_set():
            with suppress(Empty):
                yield convert(waiting.get(timeout=0.05))

    def _image(self, message: Any) -> TouchImage:
        data = ros.image_in(message)
        if self.view != AS_IT_IS:
            data = self.view.of(decode_image(data) if isinstance(data, bytes) else data)
        return TouchImage(self._time_of(message), data)

    def _pose(self, message: Any) -> TimedPose | FrameError:
        (pose,) = ros.poses_of(message)
        return checked_pose(self._time_of(message), pose.numbers, self.now(), self._gel_poses, pose.frame)

    def _time_of(self, message: Any) -> float:
        """Return the time of a message's stamp [s], or that of its arrival if it has none."""
        stamp = ros.stamp_of(message)
        return (stamp - self._start) * 1e-9 if stamp else self.now()

    def publish(self, counts: Mapping[str, int], item: TouchImage | TimedPose | Estimate) -> None:
        """Publish an estimate, with the session's counts in its diagnostics."""
        plane = self._gel_poses.plane
        if not isinstance(item, Estimate) or plane is None:
            return
        stamp = self._start + round(item.time * 1e9)
        words = {name.replace("_", " "): str(count) for name, count in counts.items()}
        for topic, message in estimate_messages(plane, stamp, item, words).items():
            self._publishers[topic].publish(ros.serialized(message))  # rclpy takes bytes, too


@cache
def message_type(name: str) -> Any:
    """Return the class of a message type such as geometry_msgs/msg/Pose; every ROS 2 has those of palpate."""
    package, _, type_ = name.split("/")
    return getattr(import_module(f"{package}.msg"), type_)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
