"""The ROS 2 node: tracks the images and sensor poses of topics as `palpate live` does, and publishes estimates."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.config import Tactile, TrackerSettings
from palpate.errors import SettingError
from palpate.io.estimates_mcap import ANSWERS, DIAGNOSTICS, POSES, POSES_WITH_COVARIANCE
from palpate.io.outlines import load_shape
from palpate.io.ros_messages import POSE, POSE_ARRAY, POSE_WITH_COVARIANCE, MessageSink
from palpate.live.poses import TimedPose
from palpate.live.recorder import add_live_estimate
from palpate.live.ros2_topics import Ros2Clock, Ros2Images, Ros2Node, Ros2Poses, message_type
from palpate.live.session import LiveEstimate, LiveState, track_live
from palpate.live.setup import check_size, size_of_images
from palpate.live.sources import Sources, TouchImage
from palpate.touch.calibration import load_calibration
from palpate.tracker import Tracker
from palpate.types.plane import Plane
from palpate.types.sensor import DIGIT, SensorProfile

IMAGES, SENSOR_POSES = "image", "sensor_pose"
"""Topics that the node subscribes to; users remap them."""
CONTACT = "/palpate/contact"
TOPICS = {
    POSES: POSE,
    POSES_WITH_COVARIANCE: POSE_WITH_COVARIANCE,
    ANSWERS: POSE_ARRAY,
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
    CONTACT: "std_msgs/msg/Bool",
}
"""Topics that the node publishes, with their types."""
_RATE_IMAGES = 16  # images from whose stamps the rate is measured


@dataclass(frozen=True, eq=False)
class Parameters:
    """Parameters of the node, named like the options of `palpate live`."""

    shape: str
    """The object: a name, or a file of its outline."""
    first_pose: ArrayLike
    """world_T_object at the start, (3,) [m, m, rad], in the plane of the push."""
    first_pose_sigma: ArrayLike | None = None
    """Standard deviations of that pose, (3,) [m, m, rad]."""
    plane: ArrayLike = (0.0, 0.0, 1.0)
    """Normal of the plane of the push in the frame of the sensor's poses, (3,)."""
    tactile: Tactile = "learnt"
    """Kind of touch measurement."""
    calibration: Path | None = None
    """Calibration of the sensor unit, a file of `palpate calibrate`."""


def run(ros: Ros2Node, stop: threading.Event, say: Callable[[str], Any]) -> LiveState:
    """Track until the event is set; `say` receives notes for the user. Returns the session's counts.

    Raises PalpateError if parameters, topics or images are unusable.
    """
    parameters = read_parameters(ros)
    clock, state = Ros2Clock(ros), LiveState(say)
    images = Ros2Images(ros, IMAGES, clock, clock.epoch)
    poses = Ros2Poses(ros, SENSOR_POSES, clock, clock.epoch, parameters.plane)
    publisher = Publisher(ros, lambda: poses.plane, clock.epoch, state)
    calibration = parameters.calibration and load_calibration(parameters.calibration)
    size = size_of_images(DIGIT, calibration)
    tracker = Tracker(
        load_shape(parameters.shape),
        _with_measured_rate(DIGIT, size, images, stop, say),
        parameters.first_pose,
        TrackerSettings(parameters.tactile),
        calibration=calibration,
        first_pose_sigma=parameters.first_pose_sigma,
    )
    if not stop.is_set():
        say(f"tracking: images of {ros.node.resolve_topic_name(IMAGES)}")
        track_live(tracker, Sources(images.images, poses.poses, clock, size), state, stop, publisher)
    return state


def _with_measured_rate(
    sensor: SensorProfile, size: tuple[int, int], images: Ros2Images, stop: threading.Event, say: Callable[[str], Any]
) -> SensorProfile:
    """Return the sensor with the rate of the first images; SettingError if they have another size."""
    times: list[float] = []
    for image in images.images(stop):
        if isinstance(image, str):
            say(image)
            continue
        check_size("sensor", image.pixels(size).shape[:2], size)
        times.append(image.time)
        if len(times) == _RATE_IMAGES:
            break
    if len(times) < _RATE_IMAGES:
        return sensor
    span = times[-1] - times[0]
    if not span > 0.0:
        raise SettingError(f"the stamps of {_RATE_IMAGES} images span {span:g} s; they have to increase")
    return replace(sensor, rate=(_RATE_IMAGES - 1) / span)


def read_parameters(ros: Ros2Node) -> Parameters:
    """Return the node's parameters; SettingError names one that is missing or of a wrong kind."""
    words = {name: _word(ros, name) for name in ("shape", "tactile", "calibration")}
    numbers = {name: _numbers(ros, name) for name in ("first_pose", "first_pose_sigma", "plane")}
    given: dict[str, Any] = {name: value for name, value in {**words, **numbers}.items() if value is not None}
    if not {"shape", "first_pose"} <= given.keys():
        raise SettingError(
            "the object is not known: the parameters shape and first_pose say it, "
            "-p shape:=rectangle -p first_pose:='[0.1, 0.0, 0.3]'"
        )
    if "calibration" in given:
        given["calibration"] = Path(given["calibration"])
    return Parameters(**given)


def _word(ros: Ros2Node, name: str) -> str | None:
    value = _value(ros, name)
    if value is not None and not isinstance(value, str):
        raise SettingError(f"parameter {name} is {value!r}; allowed is a word")
    return value or None


def _numbers(ros: Ros2Node, name: str) -> ArrayLike | None:
    value = _value(ros, name)
    try:
        numbers = np.array([0.0] * 3 if value is None else value, np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise SettingError(f"parameter {name} is {value!r}; allowed are three finite numbers: '[0.1, 0.0, 0.3]'")
    return None if value is None else numbers


def _value(ros: Ros2Node, name: str) -> Any:
    any_type = message_type("rcl_interfaces/msg/ParameterDescriptor")(dynamic_typing=True)
    return ros.node.declare_parameter(name, None, any_type).value


class NodeSink(MessageSink):
    """Publishes messages; topics /palpate/... are those of the node, whatever its name."""

    def __init__(self, ros: Ros2Node) -> None:
        """Advertise all topics."""
        self._publishers: dict[str, Any] = {
            topic: ros.node.create_publisher(message_type(type_), topic.replace("/palpate/", "~/", 1), 10)
            for topic, type_ in TOPICS.items()
        }

    def add(self, topic: str, type_: str, time: int, **fields: Any) -> None:
        """See MessageSink."""
        self._publishers[topic].publish(self.make(type_, **fields))

    def make(self, type_: str, **fields: Any) -> Any:
        """See MessageSink."""
        if type_ == "diagnostic_msgs/msg/DiagnosticStatus":
            fields["level"] = bytes([fields["level"]])  # rclpy takes a byte
        return message_type(type_)(**fields)


class Publisher:
    """Publishes the estimates of a session; see Listener. Images and sensor poses are on topics already."""

    def __init__(self, ros: Ros2Node, plane: Callable[[], Plane | None], epoch: int, state: LiveState) -> None:
        """Take the node, the plane as soon as it is known, the stamp of 0 s [ns] and the session's counts."""
        self._ros, self._plane, self._epoch, self._state = ros, plane, epoch, state
        self._sink = NodeSink(ros)

    def image(self, image: TouchImage) -> None:
        """See Listener."""

    def pose(self, pose: TimedPose) -> None:
        """See Listener."""

    def estimate(self, last: LiveEstimate) -> None:
        """Publish an estimate."""
        plane, state = self._plane(), self._state
        assert plane is not None
        counts = {
            "images": state.images,
            "tracked": state.tracked,
            "dropped": state.dropped,
            "without a sensor pose": state.without_pose,
            "refused sensor poses": state.refused,
            "lost by ROS": self._ros.lost,
        }
        stamp = self._epoch + round(last.estimate.time * 1e9)
        add_live_estimate(self._sink, plane, stamp, last, {name: str(count) for name, count in counts.items()})
        self._sink.add(CONTACT, TOPICS[CONTACT], stamp, data=last.estimate.contact)
