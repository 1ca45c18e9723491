"""ROS messages as plain numbers and bytes: the types that palpate reads, and writes into MCAP. ROS is not needed."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.errors import FileError
from palpate.files import new_file, whole_file
from palpate.hints import library
from palpate.types.images import codec_of
from palpate.types.space import Plane, out_of_plane

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
POLYGON = "geometry_msgs/msg/PolygonStamped"
POINTS = "sensor_msgs/msg/PointCloud2"
BOOL = "std_msgs/msg/Bool"

IMAGE_TYPES = (IMAGE, COMPRESSED_IMAGE, "foxglove.RawImage", "foxglove.CompressedImage")
POSE_TYPES = (POSE, POSE_WITH_COVARIANCE, TRANSFORM, ODOMETRY, "foxglove.PoseInFrame")
_ROS_TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
TRANSFORM_TYPES = (*_ROS_TRANSFORM_TYPES, "foxglove.FrameTransform", "foxglove.FrameTransforms")
READ_TYPES = (*IMAGE_TYPES, *POSE_TYPES, *TRANSFORM_TYPES, BOOL)

ENCODINGS = {
    **dict.fromkeys(("rgb8", "rgb"), (3, (0, 1, 2))),
    **dict.fromkeys(("bgr8", "bgr", "8UC3"), (3, (2, 1, 0))),
    "rgba8": (4, (0, 1, 2)),
    **dict.fromkeys(("bgra8", "8UC4"), (4, (2, 1, 0))),
    **dict.fromkeys(("yuv422", "uyvy", "uyvy422"), (2, "YUV2RGB_UYVY")),
    **dict.fromkeys(("yuv422_yuy2", "yuyv", "yuyv422", "yuy2"), (2, "YUV2RGB_YUYV")),
    **{f"bayer_{order}8": (1, f"Bayer{order.upper()}2RGB") for order in ("rggb", "bggr", "gbrg", "grbg")},
}
"""Encodings of `Image` that are read: bytes of a pixel, and its channels in the order of RGB or OpenCV's conversion.

8UC3 and 8UC4 do not name the order of colours; the driver of the DIGIT and OpenCV, which publish them, have blue first.
"""


class Channel(NamedTuple):
    """A stream of messages of one topic and type."""

    topic: str
    """Name, such as /digit/image_raw."""
    type: str
    """Message type as ROS 2 names it, such as sensor_msgs/msg/Image, or a schema of Foxglove."""
    encoding: str
    """Serialisation: "cdr" (ROS 2), "ros1", "protobuf" or "json" (Foxglove), or another that is not read."""

    @property
    def is_read(self) -> bool:
        """True if the messages can be decoded and used."""
        encodings = ("protobuf", "json") if self.is_foxglove else ("cdr", "ros1")
        return self.encoding in encodings and self.type in READ_TYPES

    @property
    def is_foxglove(self) -> bool:
        """True if the type is a schema of Foxglove."""
        return self.type.startswith("foxglove.")


class RawMessage(NamedTuple):
    """A message that is not decoded yet."""

    channel: Channel
    log_time: int
    """Time of recording [ns]."""
    data: bytes
    schema: bytes = b""
    """Definition of its type in an MCAP."""


class Pose(NamedTuple):
    """A pose in space, or a transform: `frame_T_child`."""

    frame: str
    """Frame in which the pose is given."""
    child: str
    """Frame whose pose a transform or odometry gives; "" for a pose."""
    stamp: int
    """[ns]"""
    numbers: tuple[float, ...]
    """Position x, y, z [m] and quaternion x, y, z, w."""


class MessageWriter:
    """Writer of messages into an open MCAP."""

    def __init__(self, writer: Any) -> None:
        """Take the writer of `mcap`."""
        self.writer = writer
        self._channels: dict[str, int] = {}

    def add(self, time: int, messages: Mapping[str, Any]) -> None:
        """Add messages, by their topics, as sent and recorded at a time [ns]."""
        for topic, content in messages.items():
            if topic not in self._channels:
                text = ros_types("cdr").generate_msgdef(content.__msgtype__, ros_version=2)[0].encode()
                schema = self.writer.register_schema(content.__msgtype__, "ros2msg", text)
                self._channels[topic] = self.writer.register_channel(topic, "cdr", schema)
            self.writer.add_message(self._channels[topic], time, serialized(content), time)


@contextmanager
def new_mcap(path: Path | str, overwrite: bool = False, growing: bool = False) -> Iterator[MessageWriter]:
    """Open a new MCAP that is written whole or not at all; an existing one is replaced only if `overwrite`.

    If it is `growing`, it is written in place: should the process be killed, only the last few kB are lost.
    """
    from mcap.writer import CompressionType, Writer

    with nullcontext(new_file(path, overwrite)) if growing else whole_file(path, overwrite) as target:
        try:
            with target.open("wb") as file:
                # Images are compressed already; data checksums find a damaged record anywhere.
                writer = Writer(file, compression=CompressionType.NONE, use_chunking=not growing, enable_data_crcs=True)
                writer.start(profile="ros2", library="palpate")
                try:
                    yield MessageWriter(writer)
                finally:
                    writer.finish()
        except OSError as error:
            raise FileError(f"{path}: cannot be written ({error})") from error


def nanoseconds(path: Path | str, time: Array) -> list[int]:
    """Return times (N,) [s] as stamps [ns], counted from the first time if that is below 0.

    Raises FileError if ROS cannot express a time.
    """
    latest = 2.0**31  # [s]
    time = time - min(time[0], 0.0)
    is_wrong = (time < 0.0) | (time >= latest)
    if is_wrong.any():
        first = int(np.argmax(is_wrong))
        raise FileError(
            f"{path}: frame {first} is at {time[first]:g} s, stamps of ROS messages go from 0 to {latest:g} s"
        )
    whole = np.floor(time)
    return (whole.astype(np.int64) * 10**9 + np.rint((time - whole) * 1e9).astype(np.int64)).tolist()


def message(type_: str, **fields: Any) -> Any:
    """Return a message of ROS 2, or a part of one, such as geometry_msgs/msg/Pose."""
    return ros_types("cdr").types[type_](**fields)


def serialized(message: Any) -> bytes:
    """Return a message of ROS 2 as CDR."""
    return bytes(ros_types("cdr").serialize_cdr(message, message.__msgtype__))


def header(time: int, frame: str) -> Any:
    """Return the header of a message at a time [ns], given in a frame."""
    stamp = message("builtin_interfaces/msg/Time", sec=time // 10**9, nanosec=time % 10**9)
    return message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def pose_in_space(plane: Plane, pose: Array) -> Any:
    """Return the Pose message of a pose in a plane (3,) [m, m, rad]."""
    position, rotation = out_of_plane(plane, pose)
    point = message("geometry_msgs/msg/Point", **dict(zip("xyz", position.tolist(), strict=True)))
    quaternion = message("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", rotation.tolist(), strict=True)))
    return message("geometry_msgs/msg/Pose", position=point, orientation=quaternion)


def stamped_pose(time: int, plane: Plane, pose: Array) -> Any:
    """Return the PoseStamped of a pose in a plane (3,) at a time [ns]."""
    return message(POSE, header=header(time, plane.frame), pose=pose_in_space(plane, pose))


def stamped_image(time: int, image: bytes) -> Any:
    """Return the CompressedImage of an encoded image, which may be damaged, at a time [ns]."""
    data = np.frombuffer(image, np.uint8)
    codec = codec_of(image) or "jpeg"
    return message(COMPRESSED_IMAGE, header=header(time, "sensor"), format=codec, data=data)


def point_cloud(header: Any, points: Array) -> Any:
    """Return the PointCloud2 of points (P, 3) [m]."""
    rows = points.astype("<f4")
    size = rows.itemsize
    field = ros_types("cdr").types["sensor_msgs/msg/PointField"]
    fields = [
        field(name=axis, offset=size * index, datatype=field.FLOAT32, count=1) for index, axis in enumerate("xyz")
    ]
    layout = {"height": 1, "width": len(rows), "point_step": 3 * size, "row_step": rows.nbytes, "fields": fields}
    data = np.frombuffer(rows.tobytes(), np.uint8)
    return message(POINTS, header=header, is_bigendian=False, is_dense=True, data=data, **layout)


def stamp_of(message: Any) -> int | None:
    """Return the time in a message's header [ns], or in that of its first transform; None if it has no header."""
    stamped = message.transforms[0] if hasattr(message, "transforms") else message
    if not hasattr(stamped, "header"):
        return None
    return stamped.header.stamp.sec * 10**9 + stamped.header.stamp.nanosec


def poses_of(message: Any) -> list[Pose]:
    """Return the pose in a message of POSE_TYPES, or the transforms in one of TRANSFORM_TYPES; none in others."""
    if hasattr(message, "transforms"):
        return [_transform(stamped) for stamped in message.transforms]
    if hasattr(message, "transform"):
        return [_transform(message)]
    if not hasattr(message, "pose"):
        return []
    pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
    return [_pose(message, getattr(message, "child_frame_id", ""), pose.position, pose.orientation)]


def _transform(message: Any) -> Pose:
    return _pose(message, message.child_frame_id, message.transform.translation, message.transform.rotation)


def _pose(message: Any, child: str, position: Any, rotation: Any) -> Pose:
    numbers = (position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w)
    # ROS 1 allowed a slash before the names of frames.
    return Pose(message.header.frame_id.lstrip("/"), child.lstrip("/"), stamp_of(message) or 0, numbers)


def yuv_order(message: Any) -> str:
    """Return the encoding that the bytes of an Image in YUV 4:2:2 are in if its label names the other order, else "".

    Every second byte is brightness, which changes little from one pixel to the next; the bytes between are two colours
    in turn.
    """
    label = str(getattr(message, "encoding", "")).strip().lower()
    others = {"YUV2RGB_UYVY": "yuv422_yuy2", "YUV2RGB_YUYV": "yuv422"}
    other = others.get(str(ENCODINGS.get(label, (0, ""))[1]), "")
    if not other or message.width < 4 or len(message.data) != message.height * message.step:
        return ""
    rows = np.asarray(message.data, np.uint8).reshape(message.height, -1)[:, : 2 * message.width].astype(np.int16)
    first = float(np.median(np.abs(np.diff(rows[:, ::2], axis=1))))
    second = float(np.median(np.abs(np.diff(rows[:, 1::2], axis=1))))
    brightness, colour = (second, first) if other == "yuv422_yuy2" else (first, second)
    return other if brightness > 2.0 * colour + 2.0 else ""  # [grey levels], of noise


def image_in(message: Any, encoding: str = "") -> bytes | NDArray[np.uint8]:
    """Return the bytes of a CompressedImage, or the pixels (height, width, 3) RGB of an Image.

    `encoding` is taken in place of that of the message. Raises FileError where it is no colour image.
    """
    if hasattr(message, "format"):
        data = bytes(message.data)
        colour = message.format.split(";")[0].strip()
        if codec_of(data) is None or colour.startswith("mono") or colour.endswith("C1"):
            raise FileError(f"images are {message.format!r}, allowed are colour images as JPEG or PNG")
        return data
    label = (encoding or message.encoding).strip().lower()
    encoding = next((name for name in ENCODINGS if name.lower() == label), "")
    if not encoding:
        raise FileError(
            f"images are encoded as {message.encoding!r}, allowed are {', '.join(ENCODINGS)}: colour images"
        )
    size, conversion = ENCODINGS[encoding]
    height = message.height
    width = message.width
    step = message.step  # bytes of a row
    name = f"an image of {height} rows and {width} columns"
    if not height or not width or step < size * width or len(message.data) != height * step:
        raise FileError(
            f"{name} has {len(message.data)} bytes in rows of {step}, expected {size} bytes a column and all rows"
        )
    rows = np.asarray(message.data, np.uint8).reshape(height, step)[:, : size * width]
    pixels = np.ascontiguousarray(rows.reshape(height, width, size))
    if not isinstance(conversion, str):
        return np.ascontiguousarray(pixels[..., conversion])
    cv2 = library("cv2", "camera", f"encoding {encoding} of images")
    try:
        return np.asarray(cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{conversion}")), np.uint8)
    except cv2.error as error:  # such as an odd width
        raise FileError(f"{name} is no {message.encoding}") from error


@cache
def ros_types(encoding: str) -> Any:
    """Return the message types of ROS 2 ("cdr") or ROS 1 ("ros1"), as objects of `rosbags`."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if encoding == "cdr":
        # The oldest release loads fastest, and the types that palpate uses are the same in all.
        return get_typestore(Stores.ROS2_DASHING)
    store = get_typestore(Stores.ROS1_NOETIC)
    for name in _ROS_TRANSFORM_TYPES:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
    return store


@cache
def types_by_definition(type_: str, definition: bytes) -> Any:
    """Return a type of ROS 2 and those that it is made of, by its definition in an MCAP, as objects of `rosbags`."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition.decode(), type_))
    return store
