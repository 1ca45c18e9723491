"""palpate as a ROS 2 node: a live session whose sources and results are topics.

`python -m palpate.ros2 --ros-args -p shape:=NAME -p first_pose:='[x, y, theta]' -r image:=/digit/image_raw ...`
"""

import sys
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from palpate.cli.console import complain
from palpate.config import TrackerSettings
from palpate.errors import PalpateError, SettingError
from palpate.io.estimates_mcap import ANSWERS, DIAGNOSTICS, POSES, POSES_WITH_COVARIANCE
from palpate.io.outlines import load_shape
from palpate.io.ros_messages import BOOL, POSE, POSE_ARRAY, POSE_WITH_COVARIANCE, MessageSink
from palpate.live.camera import size_of_images
from palpate.live.recorder import add_live_estimate
from palpate.live.ros2_topics import Ros2Clock, Ros2Node, Ros2Poses, message_type, ros2_images
from palpate.live.session import LiveEstimate, LiveState, stop_on_signals, track_live
from palpate.live.sources import Sources, TimedPose, TouchImage
from palpate.touch.calibration import load_calibration
from palpate.tracker import Tracker
from palpate.types.measurements import finite_numbers
from palpate.types.sensor import DIGIT
from palpate.types.space import Plane

IMAGES, SENSOR_POSES = "image", "sensor_pose"
"""Topics that the node subscribes to; users remap them."""
CONTACT = "/palpate/contact"
TOPICS = {
    POSES: POSE,
    POSES_WITH_COVARIANCE: POSE_WITH_COVARIANCE,
    ANSWERS: POSE_ARRAY,
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
    CONTACT: BOOL,
}
"""Topics that the node publishes, with their types."""


def main(arguments: Sequence[str]) -> int:
    """Run the node until Ctrl-C and return its exit code."""
    try:
        ros = Ros2Node("palpate", arguments)
    except PalpateError as error:
        complain(error)
        return 2
    logger = ros.node.get_logger()
    try:
        with stop_on_signals() as stop:
            counts = run(ros, stop, logger.info).counts
    except PalpateError as error:
        logger.error(str(error))
        return 2
    else:
        logger.info(", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items()))
        return 0
    finally:
        ros.close()


def run(ros: Ros2Node, stop: threading.Event, say: Callable[[str], Any]) -> LiveState:
    """Track until the event is set; `say` receives notes for the user. Returns the session's counts.

    Raises PalpateError if parameters, topics or images are unusable.
    """
    shape, first_pose = _parameter(ros, "shape"), _numbers(ros, "first_pose")
    if shape is None or first_pose is None:
        raise SettingError(
            "the object is not known: the parameters shape and first_pose say it, "
            "-p shape:=rectangle -p first_pose:='[0.1, 0.0, 0.3]'"
        )
    sigma, normal, unit = _numbers(ros, "first_pose_sigma"), _numbers(ros, "plane"), _parameter(ros, "calibration")
    settings = TrackerSettings(_parameter(ros, "tactile") or "learnt")
    calibration = None if unit is None else load_calibration(Path(str(unit)))
    clock, state, size = Ros2Clock(ros), LiveState(say), size_of_images(DIGIT, calibration)
    images = partial(ros2_images, ros, IMAGES, clock)
    poses = Ros2Poses(ros, SENSOR_POSES, clock, normal or (0.0, 0.0, 1.0))
    outline = load_shape(str(shape))
    tracker = Tracker(outline, DIGIT, first_pose, settings, calibration=calibration, first_pose_sigma=sigma)
    publisher = Publisher(ros, lambda: poses.plane, clock.epoch, state)
    say(f"tracking: images of {ros.node.resolve_topic_name(IMAGES)}")
    track_live(tracker, Sources(images, poses.poses, clock, DIGIT, size), state, stop, publisher.publish)
    return state


def _parameter(ros: Ros2Node, name: str) -> Any:
    """Return the value of a parameter of the node, None if it is not set."""
    any_type = message_type("rcl_interfaces/msg/ParameterDescriptor")(dynamic_typing=True)
    return ros.node.declare_parameter(name, None, any_type).value or None


def _numbers(ros: Ros2Node, name: str) -> list[float] | None:
    if (value := _parameter(ros, name)) is None:
        return None
    numbers = finite_numbers(value, (3,))
    if numbers is None:
        raise SettingError(f"parameter {name} is {value!r}; allowed are three finite numbers: '[0.1, 0.0, 0.3]'")
    return numbers.tolist()


class Publisher(MessageSink):
    """Publishes the estimates of a session; topics /palpate/... are those of the node, under any name of it."""

    def __init__(self, ros: Ros2Node, plane: Callable[[], Plane | None], epoch: int, state: LiveState) -> None:
        """Take the node, the plane as soon as it is known, the stamp of 0 s [ns] and the session's counts."""
        self._plane, self._epoch, self._state = plane, epoch, state
        self._publishers: dict[str, Any] = {
            topic: ros.node.create_publisher(message_type(type_), topic.replace("/palpate/", "~/", 1), 10)
            for topic, type_ in TOPICS.items()
        }

    def publish(self, item: TouchImage | TimedPose | LiveEstimate) -> None:
        """Publish an estimate, with the session's counts in its diagnostics."""
        if not isinstance(item, LiveEstimate):
            return
        plane = self._plane()
        assert plane is not None
        stamp = self._epoch + round(item.estimate.time * 1e9)
        counts = {name.replace("_", " "): str(count) for name, count in self._state.counts.items()}
        add_live_estimate(self, plane, stamp, item, counts)
        self.add(CONTACT, BOOL, stamp, data=item.estimate.contact)

    def add(self, topic: str, type_: str, time: int, **fields: Any) -> None:
        """Publish a message."""
        self._publishers[topic].publish(self.make(type_, **fields))

    def make(self, type_: str, **fields: Any) -> Any:
        """Return a message, or a part of one."""
        if type_ == "diagnostic_msgs/msg/DiagnosticStatus":
            fields["level"] = bytes([fields["level"]])  # rclpy takes a byte
        return message_type(type_)(**fields)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
