"""Bags that several tests use, written by `rosbags`, which is none of our code, and what is in them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from recording_samples import encoded
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

CONTAINERS = ("mcap", "ros2", "ros1")
START = 1_700_000_000_000_000_000
"""[ns] of the first pose; that of the first image is 20 ms later."""
FRAMES = 24

ROS2 = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))


@dataclass(frozen=True)
class Message:
    topic: str
    log_time: int
    type: str
    content: dict[str, Any]


def image_times(count: int = FRAMES) -> Any:
    """The stamps of images at 30 Hz (count,) [ns]."""
    return START + 20_000_000 + np.round(np.arange(count) / 30 * 1e9).astype(np.int64)


def pose_times(count: int = 2 * FRAMES + 20) -> Any:
    """The stamps of poses at 50 Hz (count,) [ns]."""
    return START + np.arange(count, dtype=np.int64) * 20_000_000


def true_pose(time: Any) -> Any:
    """Where the sensor is at times [ns], (N, 3) [m, m, rad]: straight on, turning evenly through an angle of pi."""
    seconds = (np.asarray(time) - START) * 1e-9
    yaw = np.pi - 0.3 + 0.8 * seconds
    return np.column_stack([0.1 + 0.05 * seconds, -0.2 * seconds, np.angle(np.exp(1j * yaw))])


def touch_images(count: int = FRAMES) -> Any:
    """DIGIT images (count, 320, 240, 3) RGB: smooth, and red and blue unlike."""
    rows, columns = np.mgrid[0:320, 0:240]
    number = np.arange(count)[:, None, None]
    red, green = (rows + 3 * number) % 256, (columns + rows // 2) * np.ones_like(number) % 256
    return np.stack([red, green, np.full_like(red, 40)], axis=-1).astype(np.uint8)


def header(stamp: int, frame: str = "world") -> dict[str, Any]:
    return {"stamp": {"sec": int(stamp) // 10**9, "nanosec": int(stamp) % 10**9}, "frame_id": frame}


def image_message(stamp: int, pixels: Any, encoding: str = "rgb8", padding: int = 0, **changes: Any) -> Message:
    """A `sensor_msgs/Image` of pixels (height, width, 3) in RGB; `padding` bytes end each row."""
    height, width = pixels.shape[:2]
    ordered = pixels if encoding == "rgb8" else pixels[:, :, ::-1]
    rows = np.pad(ordered.reshape(height, -1), ((0, 0), (0, padding)), constant_values=77)
    content = {
        "header": header(stamp, "digit"),
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": rows.shape[1],
        "data": rows.reshape(-1),
    }
    return Message("/digit/image_raw", int(stamp) + 3_000_000, "sensor_msgs/msg/Image", content | changes)


def compressed_message(stamp: int, pixels: Any, codec: Any = "jpeg", format: str = "bgr8; jpeg compressed") -> Message:
    data = np.frombuffer(encoded(pixels, codec), np.uint8)
    content = {"header": header(stamp, "digit"), "format": format, "data": data}
    return Message("/digit/image/compressed", int(stamp) + 3_000_000, "sensor_msgs/msg/CompressedImage", content)


def pose_content(position: Any, rotation: Rotation) -> dict[str, Any]:
    return {
        "position": dict(zip("xyz", map(float, position), strict=True)),
        "orientation": dict(zip("xyzw", map(float, rotation.as_quat()), strict=True)),
    }


def pose_message(stamp: int, pose: Any, topic: str = "/ee_pose", frame: str = "world", height: float = 0.1) -> Message:
    """A planar pose (3,) as a `PoseStamped`."""
    content = pose_content([*pose[:2], height], Rotation.from_euler("z", pose[2]))
    type_ = "geometry_msgs/msg/PoseStamped"
    return Message(topic, int(stamp) + 1_000_000, type_, {"header": header(stamp, frame), "pose": content})


def transform_message(
    stamp: int, parent: str, child: str, position: Any, rotation: Any, static: bool = False
) -> Message:
    pose = pose_content(position, rotation)
    transform = {"translation": pose["position"], "rotation": pose["orientation"]}
    content = {"header": header(stamp, parent), "child_frame_id": child, "transform": transform}
    topic = "/tf_static" if static else "/tf"
    return Message(topic, int(stamp) + 1_000_000, "tf2_msgs/msg/TFMessage", {"transforms": [content]})


def push_messages(compressed: bool = True) -> list[Message]:
    """A bag's messages: images at 30 Hz, poses at 50 Hz, and a topic that says nothing of either."""
    make = compressed_message if compressed else image_message
    images = [make(stamp, pixels) for stamp, pixels in zip(image_times(), touch_images(), strict=True)]
    times = pose_times()
    poses = [pose_message(stamp, pose) for stamp, pose in zip(times, true_pose(times), strict=True)]
    words = [Message("/chatter", START + 5, "std_msgs/msg/String", {"data": "hello"})]
    return sorted(images + poses + words, key=lambda message: message.log_time)


def write_bag(path: Path, container: str, messages: list[Message], **settings: Any) -> Path:
    """Write a bag by `rosbags` and return its path: the file, of ROS 2 SQLite the folder."""
    path.parent.mkdir(exist_ok=True)
    if container == "ros1":
        path, store = path.with_suffix(".bag"), ROS1
        writer, serialize = rosbag1.Writer(path), ROS1.serialize_ros1
    else:
        plugin = rosbag2.StoragePlugin.MCAP if container == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer, store = rosbag2.Writer(path, version=9, storage_plugin=plugin), ROS2
        serialize = ROS2.serialize_cdr
    for name, value in settings.items():
        getattr(writer, name)(*value)
    with writer:
        topics: dict[str, Any] = {}
        for message in messages:
            if message.topic not in topics:
                topics[message.topic] = writer.add_connection(message.topic, message.type, typestore=store)
            data = serialize(build_message(store, message.type, message.content), message.type)
            writer.write(topics[message.topic], message.log_time, data)
    return next(path.glob("*.mcap"), path)


def build_message(store: Any, type_: str, content: Any) -> Any:
    """The message object of a type from its fields as dictionaries."""
    kinds = dict(store.fielddefs[type_][1])
    if store is ROS1 and type_ == "std_msgs/msg/Header":
        content = {"seq": 0, **content}
    values = {}
    for name, value in content.items():
        kind, what = kinds[name]
        if kind.name == "NAME":
            values[name] = build_message(store, what, value)
        elif kind.name == "SEQUENCE" and what[0][0].name == "NAME":
            values[name] = [build_message(store, what[0][1], each) for each in value]
        else:
            values[name] = value
    return store.types[type_](**values)


def decoded_by_another(path: Path) -> dict[str, list[Any]]:
    """Return (log time, message) by topic as `mcap-ros2-support` decodes them; palpate itself uses `rosbags`."""
    by_topic: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for _, channel, raw, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            by_topic.setdefault(channel.topic, []).append((raw.log_time, message))
    return by_topic
