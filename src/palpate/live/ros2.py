"""A node of ROS 2 and the messages that it hears. rclpy comes with ROS; palpate does not install it."""

import os
import threading
import time
from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from queue import Empty, SimpleQueue
from typing import Any

from palpate.errors import SettingError
from palpate.live.clock import Clock

DEPTH = 100
"""Messages that ROS keeps for whoever is slow to take them."""

_LOOK = 0.05  # [s] between looks at the event
_PATIENCE = 2.0  # [s] after which it is said that a topic is waited for


class Ros2Node:
    """A node that a thread of its own serves; it keeps to this machine unless ROS is told otherwise."""

    def __init__(self, name: str, arguments: Sequence[str] = ()) -> None:
        """Join ROS under a name, with its usual `arguments` (--ros-args ...). SettingError without rclpy."""
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        rclpy = _rclpy()
        self._context = rclpy.Context()
        signals = import_module("rclpy.signals").SignalHandlerOptions.NO
        rclpy.init(args=list(arguments), context=self._context, signal_handler_options=signals)
        self.node: Any = rclpy.create_node(name, context=self._context)
        """rclpy's own."""
        self.lost = 0
        """How many messages ROS says that it has lost."""
        self._executor = import_module("rclpy.executors").SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, name="palpate-ros2", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave."""
        self._executor.shutdown()
        self._thread.join()
        self.node.destroy_node()
        self._context.try_shutdown()

    def messages(self, topic: str, types: Collection[str], stop: threading.Event) -> Iterator[Any]:
        """Yield each message of a topic as it comes, and in between what is to be said, in words; ends at the event.

        The first publisher says of which of the `types` they are, and whether they are sent again when they get lost.
        Raises SettingError where they are of another type.
        """
        try:
            topic = self.node.resolve_topic_name(topic)
        except import_module("rclpy.exceptions").InvalidTopicNameException as error:
            raise SettingError(f"{topic!r} is no name of a topic: {str(error).splitlines()[0]}") from error
        offered = yield from self._offered(topic, types, stop)
        if offered is None:
            return
        waiting: SimpleQueue[Any] = SimpleQueue()
        qos, events = import_module("rclpy.qos"), import_module("rclpy.event_handler")
        subscription = self.node.create_subscription(
            message_type(offered.topic_type),
            topic,
            waiting.put,
            qos.QoSProfile(depth=DEPTH, reliability=offered.qos_profile.reliability),
            event_callbacks=events.SubscriptionEventCallbacks(message_lost=self._lose),
        )
        try:
            while not stop.is_set():
                with suppress(Empty):
                    yield waiting.get(timeout=_LOOK)
        finally:
            self.node.destroy_subscription(subscription)

    def _offered(self, topic: str, types: Collection[str], stop: threading.Event) -> Generator[str, None, Any]:
        """Return what the first publisher of a topic says of it, None at the event; yield that there is none yet."""
        begin, said = time.monotonic(), False
        while not stop.is_set():
            for offered in self.node.get_publishers_info_by_topic(topic):
                if offered.topic_type not in types:
                    raise SettingError(
                        f"topic {topic} has messages of type {offered.topic_type}, allowed are {', '.join(types)}"
                    )
                return offered
            if not said and time.monotonic() - begin > _PATIENCE:
                said = True
                yield f"nobody publishes {topic} yet; {self._others(types)}"
            stop.wait(_LOOK)
        return None

    def _others(self, types: Collection[str]) -> str:
        """In words, the topics of some types."""
        found = [topic for topic, those in self.node.get_topic_names_and_types() if set(those) & set(types)]
        topics = [topic for topic in found if self.node.count_publishers(topic)]
        return f"topics of its types are {', '.join(sorted(topics))}" if topics else "no topic of its types is there"

    def _lose(self, status: Any) -> None:
        self.lost = status.total_count


class Ros2Clock(Clock):
    """The time of ROS, which may be simulated, in seconds after an epoch."""

    def __init__(self, ros: Ros2Node) -> None:
        """Begin at 0 s, now."""
        self._clock = ros.node.get_clock()
        self.epoch: int = self._clock.now().nanoseconds
        """What is 0 s [ns]; times after it are so short that they hold nanoseconds."""

    def now(self) -> float:
        """The time [s]."""
        return (self._clock.now().nanoseconds - self.epoch) * 1e-9


@cache
def message_type(name: str) -> Any:
    """The class of a type of messages, such as geometry_msgs/msg/Pose. SettingError where it is not installed."""
    package, _, type_ = name.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), type_)
    except ImportError as error:
        raise SettingError(f"messages of type {name} need {package}, which is not installed in this ROS") from error


def _rclpy() -> Any:
    try:
        return import_module("rclpy")
    except ImportError as error:
        raise SettingError(
            "ROS 2 topics need rclpy, which comes with ROS 2 and cannot be imported here: source its setup.bash, and "
            "use a Python environment that sees it (python3 -m venv --system-site-packages)"
        ) from error
