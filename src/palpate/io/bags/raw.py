"""Messages of a bag as its container keeps them, before anybody decodes them."""

from typing import NamedTuple


class Channel(NamedTuple):
    """What messages of one topic are."""

    topic: str
    """Its name, such as /digit/image_raw."""
    type: str
    """Type of its messages as ROS 2 names it, such as sensor_msgs/msg/Image; of other encodings as the file has it."""
    encoding: str
    """How messages are encoded: "cdr" (ROS 2), "ros1", or what else the file says, such as "protobuf"."""


class RawMessage(NamedTuple):
    """One message."""

    channel: Channel
    log_time: int
    """When it was recorded [ns]."""
    data: bytes


class CutShort(Exception):
    """A bag ends too early or is damaged from some place on; what was yielded before it is raised is whole."""
