"""What messages say: images as encoded bytes, poses and transforms as numbers, and their stamps [ns]."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.io.bags.raw import Channel, RawMessage
from palpate.types.images import Codec, codec_of, encode_image

IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
POSE, POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"
POSE_ARRAY = "geometry_msgs/msg/PoseArray"
TRANSFORMS, OLD_TRANSFORMS = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"

IMAGE_TYPES = (IMAGE, COMPRESSED_IMAGE)
POSE_TYPES = (POSE, POSE_WITH_COVARIANCE)
TRANSFORM_TYPES = (TRANSFORMS, OLD_TRANSFORMS)
READ = (*IMAGE_TYPES, *POSE_TYPES, *TRANSFORM_TYPES)
"""The types that are read; messages of others are left alone."""

COLOURS = {"rgb8": False, "bgr8": True, "8UC3": True}
"""Encodings of `Image` that are read, and whether blue comes first. 8UC3 does not say; the driver of the DIGIT and
OpenCV, from which such images come, have blue first."""


class Pose(NamedTuple):
    """A pose in space, or a transform: `frame_T_child`."""

    frame: str
    """The frame that it is given in."""
    child: str
    """The frame that a transform places; "" for a pose."""
    stamp: int
    """[ns]"""
    numbers: tuple[float, ...]
    """Position x, y, z [m] and quaternion x, y, z, w."""


def is_read(channel: Channel) -> bool:
    """Whether messages of a channel are of a type and in an encoding that are read."""
    return channel.type in READ and channel.encoding in ("cdr", "ros1")


def decoded(raw: RawMessage) -> Any:
    """The message, its fields as attributes. Raises FileError that names the topic where its bytes are damaged."""
    store = ros_types(raw.channel.encoding)
    decode = store.deserialize_cdr if raw.channel.encoding == "cdr" else store.deserialize_ros1
    try:
        return decode(raw.data, raw.channel.type)
    except Exception as error:  # what damaged bytes lead to
        seconds = raw.log_time * 1e-9
        raise FileError(
            f"{raw.channel.topic}: the message recorded at {seconds:.9f} s does not decode as {raw.channel.type}"
        ) from error


def decoded_as(type_: str, raw: RawMessage) -> Any:
    """The message, which has to be of this type. Raises FileError that names the topic."""
    if raw.channel.type != type_:
        raise FileError(f"{raw.channel.topic} holds {raw.channel.type or 'messages of no type'}, expected {type_}")
    return decoded(raw)


def stamp_of(message: Any) -> int | None:
    """The time in a message's header [ns], of several transforms the first; None where there is none."""
    if hasattr(message, "transforms"):
        return stamp_of(message.transforms[0]) if message.transforms else None
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def poses_of(message: Any) -> list[Pose]:
    """The pose in a message of POSE_TYPES, or the transforms in one of TRANSFORM_TYPES."""
    if hasattr(message, "transforms"):
        return [
            _pose(each, each.child_frame_id, each.transform.translation, each.transform.rotation)
            for each in message.transforms
        ]
    pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
    return [_pose(message, "", pose.position, pose.orientation)]


def image_of(message: Any) -> tuple[bytes, Codec]:
    """An image as bytes: those of a CompressedImage, or of an Image made into a PNG. FileError where it is no colour
    image that is read.
    """
    if hasattr(message, "format"):
        return compressed_image(message)
    return encode_image(raw_image(message), "png"), "png"


def raw_image(message: Any) -> NDArray[np.uint8]:
    """The pixels (height, width, 3) RGB of an Image. FileError where it is no colour image that is read."""
    if message.encoding not in COLOURS:
        raise FileError(f"images are encoded as {message.encoding!r}, allowed are {', '.join(COLOURS)}: colour images")
    height, width, step = message.height, message.width, message.step
    if not height or not width or step < 3 * width or len(message.data) != height * step:
        raise FileError(
            f"an image of {height} rows and {width} columns has {len(message.data)} bytes in rows of {step}, "
            "expected 3 a column and all rows"
        )
    pixels = np.asarray(message.data, np.uint8).reshape(height, step)[:, : 3 * width].reshape(height, width, 3)
    return np.ascontiguousarray(pixels[:, :, ::-1] if COLOURS[message.encoding] else pixels)


def compressed_image(message: Any) -> tuple[bytes, Codec]:
    """The bytes of a CompressedImage and how they are encoded. FileError where it is no colour image that is read."""
    data = message.data.tobytes()
    colour = message.format.split(";")[0].strip()
    if colour.startswith("mono") or colour.endswith("C1"):
        raise FileError(f"images are {message.format!r}, allowed are colour images")
    if (codec := codec_of(data)) is None:
        raise FileError(f"compressed images are {message.format!r}, whose bytes are neither a PNG nor a JPEG")
    return data, codec


def _pose(message: Any, child: str, position: Any, rotation: Any) -> Pose:
    numbers = (position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w)
    # ROS 1 allowed a slash before the names of frames.
    return Pose(message.header.frame_id.lstrip("/"), child.lstrip("/"), stamp_of(message) or 0, numbers)


@cache
def ros_types(encoding: str) -> Any:
    """The types of ROS 2 ("cdr") or ROS 1 ("ros1"), as `rosbags` has them."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if encoding == "cdr":
        return get_typestore(Stores.ROS2_JAZZY)
    store = get_typestore(Stores.ROS1_NOETIC)
    for name in TRANSFORM_TYPES:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
    return store
