"""Publishing estimates: the same messages as in a file of estimates, and whether the sensor touches the object."""

from collections.abc import Callable
from typing import Any

from palpate.io.bags.estimates_mcap import ANSWERS, DIAGNOSTICS, POSES, POSES_WITH_COVARIANCE
from palpate.io.bags.message_sink import MessageSink
from palpate.io.bags.messages import POSE, POSE_ARRAY, POSE_WITH_COVARIANCE
from palpate.live.estimate_messages import add_estimate
from palpate.live.images import TouchImage
from palpate.live.poses import SensorPlace, TimedPose
from palpate.live.ros2 import Ros2Node, message_type
from palpate.live.state import LiveState
from palpate.types.estimate import Estimate
from palpate.types.plane import Plane

CONTACT = "/palpate/contact"
TOPICS = {
    POSES: POSE,
    POSES_WITH_COVARIANCE: POSE_WITH_COVARIANCE,
    ANSWERS: POSE_ARRAY,
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
    CONTACT: "std_msgs/msg/Bool",
}
"""What is published, and its types."""

_DEPTH = 10  # messages kept for subscribers that are slow
_BYTE = "diagnostic_msgs/msg/DiagnosticStatus"  # whose level is a byte


class NodeSink(MessageSink):
    """Publishes what is put into it; topics /palpate/... are those of the node, whatever it is called."""

    def __init__(self, ros: Ros2Node) -> None:
        """Take the node that publishes, and let it say so."""
        self._publishers: dict[str, Any] = {
            topic: ros.node.create_publisher(message_type(type_), topic.replace("/palpate/", "~/", 1), _DEPTH)
            for topic, type_ in TOPICS.items()
        }

    def add(self, topic: str, type_: str, time: int, **fields: Any) -> None:
        """Publish a message."""
        self._publishers[topic].publish(self.make(type_, **fields))

    def make(self, type_: str, **fields: Any) -> Any:
        """A message, or a part of one."""
        if type_ == _BYTE:
            fields["level"] = bytes([fields["level"]])
        return message_type(type_)(**fields)


class Publisher:
    """Publishes each estimate of a session at once."""

    def __init__(self, ros: Ros2Node, plane: Callable[[], Plane | None], epoch: int, state: LiveState) -> None:
        """Take the node, the plane as soon as it is known, what is 0 s [ns], and the counts that diagnoses tell."""
        self._ros, self._plane, self._epoch, self._state = ros, plane, epoch, state
        self._sink = NodeSink(ros)

    def image(self, image: TouchImage) -> None:
        """Images are published already."""

    def pose(self, pose: TimedPose) -> None:
        """Poses of the sensor are published already."""

    def estimate(self, estimate: Estimate, place: SensorPlace, latency: float) -> None:
        """Publish an estimate, with how the sensor's pose was known and how long it took [s]."""
        plane, state = self._plane(), self._state
        assert plane is not None
        counts = {
            "images": state.images,
            "tracked": state.tracked,
            "dropped": state.dropped,
            "without a sensor pose": state.unplaced,
            "refused sensor poses": state.refused,
            "lost by ROS": self._ros.lost,
        }
        stamp = self._epoch + round(estimate.time * 1e9)
        told = {name: str(count) for name, count in counts.items()}
        add_estimate(self._sink, plane, stamp, estimate, place, latency, told)
        self._sink.add(CONTACT, TOPICS[CONTACT], stamp, data=estimate.contact)
