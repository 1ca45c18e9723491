"""MCAPs by Foxglove's schemas, as Protobuf with the fields of its SDK 0.30 or as JSON, written by `mcap`."""

import json
from base64 import b64encode
from pathlib import Path
from typing import Any

from bag_samples import image_times, pose_times, touch_images, true_pose
from google.protobuf import descriptor_pb2, json_format, message_factory, timestamp_pb2
from mcap.writer import Writer
from recording_samples import encoded
from scipy.spatial.transform import Rotation

TIME = "google.protobuf.Timestamp"
FIELDS = {
    "Vector3": "x 1 double, y 2 double, z 3 double",
    "Quaternion": "x 1 double, y 2 double, z 3 double, w 4 double",
    "Pose": "position 1 foxglove.Vector3, orientation 2 foxglove.Quaternion",
    "CompressedImage": f"timestamp 1 {TIME}, data 2 bytes, format 3 string, frame_id 4 string",
    "RawImage": f"timestamp 1 {TIME}, width 2 fixed32, height 3 fixed32, encoding 4 string, step 5 fixed32, "
    "data 6 bytes, frame_id 7 string",
    "PoseInFrame": f"timestamp 1 {TIME}, frame_id 2 string, pose 3 foxglove.Pose",
    "FrameTransform": f"timestamp 1 {TIME}, parent_frame_id 2 string, child_frame_id 3 string, "
    "translation 4 foxglove.Vector3, rotation 5 foxglove.Quaternion",
    "FrameTransforms": "transforms 1 foxglove.FrameTransform repeated",
}
"""Name, number and type of the fields of each schema."""


def _schema() -> descriptor_pb2.FileDescriptorSet:
    """The definition of all schemas, as an MCAP holds it."""
    files = descriptor_pb2.FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    file = files.file.add(name="foxglove.proto", package="foxglove", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    kinds = descriptor_pb2.FieldDescriptorProto
    for name, fields in FIELDS.items():
        message = file.message_type.add(name=name)
        for field in fields.split(", "):
            word, number, kind, *repeated = field.split()
            added = message.field.add(name=word, number=int(number))
            added.label = kinds.LABEL_REPEATED if repeated else kinds.LABEL_OPTIONAL
            added.type = kinds.TYPE_MESSAGE if "." in kind else kinds.Type.Value(f"TYPE_{kind.upper()}")
            if "." in kind:
                added.type_name = f".{kind}"
    return files


SCHEMA = _schema()
TYPES = message_factory.GetMessages(SCHEMA.file)


class FoxgloveFile:
    """A file that messages are added to, in one encoding, with or without timestamps."""

    def __init__(self, writer: Writer, encoding: str, stamped: bool) -> None:
        self.writer = writer
        self.encoding = encoding
        self.stamped = stamped
        self.channels: dict[str, int] = {}

    def add(self, topic: str, schema: str, time: int, late: int, **fields: Any) -> None:
        """Add a message of a time [ns] that is recorded late [ns]; bytes are given as they are."""
        if self.stamped:
            fields |= {"timestamp": {"sec": int(time) // 10**9, "nsec": int(time) % 10**9}}
        name = f"foxglove.{schema}"
        if topic not in self.channels:
            kind = {"protobuf": "protobuf", "json": "jsonschema"}[self.encoding]
            definition = SCHEMA.SerializeToString() if self.encoding == "protobuf" else b"{}"
            schema_id = self.writer.register_schema(name, kind, definition)
            self.channels[topic] = self.writer.register_channel(topic, self.encoding, schema_id)
        log_time = int(time) + late
        self.writer.add_message(self.channels[topic], log_time, self._encoded(name, fields), log_time)

    def _encoded(self, name: str, fields: dict[str, Any]) -> bytes:
        texts = {key: b64encode(value).decode() for key, value in fields.items() if isinstance(value, bytes)}
        content = fields | texts
        if self.encoding == "json":
            return json.dumps(content).encode()
        stamp: Any = content.pop("timestamp", None)
        message: Any = json_format.ParseDict(content, TYPES[name]())
        if stamp:
            message.timestamp.seconds = stamp["sec"]
            message.timestamp.nanos = stamp["nsec"]
        return message.SerializeToString()


def place(pose: Any, height: float = 0.1) -> dict[str, Any]:
    """A pose in the plane (3,) as fields of a position and a rotation."""
    rotation = Rotation.from_euler("z", pose[2]).as_quat().tolist()
    position = dict(zip("xyz", [float(pose[0]), float(pose[1]), height], strict=True))
    return {"position": position, "orientation": dict(zip("xyzw", rotation, strict=True))}


def write_foxglove(
    path: Path, encoding: str = "protobuf", poses: str = "pose", raw: bool = False, stamped: bool = True
) -> Path:
    """The push of `bag_samples`: images at 30 Hz; and poses, or transforms of a hand with a mount that is sent once."""
    with path.open("wb") as opened:
        writer = Writer(opened)
        writer.start(profile="", library="foxglove-sdk")
        file = FoxgloveFile(writer, encoding, stamped)
        late = 1_000_000 if stamped else 0
        if poses != "pose":
            at = {"translation": {"x": 0.01, "y": 0.0, "z": 0.0}, "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
            names = {"parent_frame_id": "hand", "child_frame_id": "digit"}
            file.add("/mount", "FrameTransform", pose_times()[0], late, **names, **at)
        for time, pose in zip(pose_times(), true_pose(pose_times()), strict=True):
            given = place(pose)
            if poses == "pose":
                file.add("/ee_pose", "PoseInFrame", time, late, frame_id="world", pose=given)
            else:
                names = {"parent_frame_id": "world", "child_frame_id": "hand"}
                at = {"translation": given["position"], "rotation": given["orientation"]}
                file.add("/hand", "FrameTransform", time, late, **names, **at)
        for time, pixels in zip(image_times(), touch_images(), strict=True):
            if raw:
                size = {"width": 240, "height": 320, "step": 720, "encoding": "rgb8"}
                file.add("/digit/raw", "RawImage", time, late, frame_id="digit", data=pixels.tobytes(), **size)
            else:
                data = encoded(pixels)
                file.add("/digit/image", "CompressedImage", time, late, frame_id="digit", data=data, format="png")
        writer.finish()
    return path
