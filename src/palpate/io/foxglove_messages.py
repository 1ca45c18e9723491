"""Messages by Foxglove's schemas, as its SDK writes them into an MCAP, turned into the ROS messages that say the same.

They come as Protobuf, which is decoded by the schema in the file, or as JSON, in which bytes are base64. A message
without a timestamp, which the SDK allows, has its time of recording.
"""

import json
from base64 import b64decode
from functools import cache
from typing import Any

import numpy as np

from palpate.io import ros_messages as ros

ENCODINGS = ("protobuf", "json")
COMPRESSED_IMAGE = "foxglove.CompressedImage"
RAW_IMAGE = "foxglove.RawImage"
POSE = "foxglove.PoseInFrame"
TRANSFORM = "foxglove.FrameTransform"
TRANSFORMS = "foxglove.FrameTransforms"


def as_ros(raw: ros.RawMessage) -> Any:
    """Return a message by one of Foxglove's schemas as a message of ROS. Any error says that it does not decode."""
    content = _Fields(json.loads(raw.data)) if raw.channel.encoding == "json" else _from_protobuf(raw)
    type_ = raw.channel.type
    if type_ == TRANSFORMS:
        return _transforms(list(content.transforms), raw.log_time)
    if type_ == TRANSFORM:
        return _transforms([content], raw.log_time)
    header = ros.header(_stamp(content, raw.log_time), content.frame_id)
    if type_ == POSE:
        pose = ros.message(
            "geometry_msgs/msg/Pose",
            position=_numbers("geometry_msgs/msg/Point", content.pose.position),
            orientation=_numbers("geometry_msgs/msg/Quaternion", content.pose.orientation),
        )
        return ros.message(ros.POSE, header=header, pose=pose)
    data = np.frombuffer(b64decode(content.data) if isinstance(content.data, str) else content.data, np.uint8)
    if type_ == COMPRESSED_IMAGE:
        return ros.message(ros.COMPRESSED_IMAGE, header=header, format=content.format, data=data)
    size = {name: int(getattr(content, name)) for name in ("height", "width", "step")}
    return ros.message(ros.IMAGE, header=header, encoding=content.encoding, is_bigendian=0, data=data, **size)


class _Fields(dict[str, Any]):
    """A JSON object whose fields are attributes, as those of a message of Protobuf."""

    def __getattr__(self, name: str) -> Any:
        value = self[name]
        if isinstance(value, list):
            return [_Fields(item) if isinstance(item, dict) else item for item in value]
        return _Fields(value) if isinstance(value, dict) else value


def _from_protobuf(raw: ros.RawMessage) -> Any:
    return _message_type(raw.channel.type, raw.schema).FromString(raw.data)


@cache
def _message_type(name: str, schema: bytes) -> Any:
    """Return the type of a message of Protobuf by the descriptors in a schema of MCAP."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.message_factory import GetMessages

    return GetMessages(FileDescriptorSet.FromString(schema).file)[name]


def _stamp(content: Any, log_time: int) -> int:
    """Return the timestamp of a message [ns], or the time of recording if it has none."""
    if isinstance(content, dict):
        time = content.get("timestamp") or {}
        return int(time.get("sec", 0)) * 10**9 + int(time.get("nsec", 0)) or log_time
    return content.timestamp.ToNanoseconds() or log_time


def _numbers(type_: str, content: Any) -> Any:
    """Return a point, vector or quaternion of ROS."""
    names = "xyzw" if type_.endswith("Quaternion") else "xyz"
    return ros.message(type_, **{name: float(getattr(content, name)) for name in names})


def _transforms(contents: list[Any], log_time: int) -> Any:
    """Return a message of transforms."""
    stamped = []
    for content in contents:
        transform = ros.message(
            "geometry_msgs/msg/Transform",
            translation=_numbers("geometry_msgs/msg/Vector3", content.translation),
            rotation=_numbers("geometry_msgs/msg/Quaternion", content.rotation),
        )
        header = ros.header(_stamp(content, log_time), content.parent_frame_id)
        child = content.child_frame_id
        kind = "geometry_msgs/msg/TransformStamped"
        stamped.append(ros.message(kind, header=header, child_frame_id=child, transform=transform))
    return ros.message("tf2_msgs/msg/TFMessage", transforms=stamped)
