"""palpate's own recording file: an MCAP of standard ROS 2 messages that holds all of a Recording without loss.

Foxglove, Rerun and ROS tools show the messages: images as they are encoded, poses of sensor and object in the plane
z = 0 of the frame "world", contact. A metadata record "palpate" and attachments before them hold what messages cannot:
the outline, the sensor, the first pose, and each array to the last bit. `palpate live --record` writes the same
metadata without the arrays; its recordings are read from the messages.

A recording of a hand has version 2, as palpate before it knew of one sensor alone; topics and arrays of its fingers are
below /fingers/NAME and fingers/NAME.
"""

import io
import json
import logging
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import FileError, SettingError
from palpate.files import existing_file, in_file, json_object
from palpate.geometry.shapes import Shape, shape_from_dict, shape_to_dict
from palpate.io import fingers
from palpate.io import ros_messages as ros
from palpate.io.decode_message import decoded
from palpate.io.recording import Recording
from palpate.io.rosbag_reader import CutShort, front_matter, is_mcap, mcap_messages
from palpate.io.rosbag_recording import BagChoices, read_bag
from palpate.types.hand import Hand, hand_from_dict, hand_to_dict
from palpate.types.sensor import SensorProfile, sensor_from_dict
from palpate.types.space import flat

logger = logging.getLogger(__name__)

METADATA = "palpate"
ARRAYS = "palpate/"
VERSION = "1"
HAND_VERSION = "2"
"""Version of recordings of a hand."""
IMAGES = "/sensor/image/compressed"
SENSOR_POSES = "/sensor/pose"
OBJECT_POSES = "/object/pose"
CONTACT = "/sensor/contact"
FINGERS = "/fingers/"
FRAME_ARRAYS = ("time", "sensor_pose", "object_pose", "contact")
_NO_RECORDING = f"is no recording of palpate, which is an MCAP with metadata named {METADATA!r}"
STATED = ("first_pose", "first_pose_sigma", "set_up_sigma", "is_view_known", "warnings")


def is_recording(path: Path) -> bool:
    """Return true for a recording of palpate."""
    return is_mcap(path) and METADATA in front_matter(path)[0]


def describe(
    file: ros.MessageWriter, shape: Shape, sensor: SensorProfile, more: Mapping[str, str] | None = None
) -> None:
    """Add the metadata that make an MCAP of sensor messages a recording; they come before the first message."""
    about = {"version": VERSION, "shape": json.dumps(shape_to_dict(shape))}
    file.writer.add_metadata(METADATA, {**about, "sensor": json.dumps(_plain(asdict(sensor))), **(more or {})})


def _plain(sensor: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a sensor but for the orientation of its camera, as images of recordings are upright."""
    return {name: value for name, value in sensor.items() if name != "orientation"}


def _plain_hand(hand: Hand) -> dict[str, Any]:
    """Return a hand as the metadata hold it."""
    plain = hand_to_dict(hand)
    return plain | {"fingers": {name: _plain(finger) for name, finger in plain["fingers"].items()}}


def about_hand(hand: Hand) -> dict[str, str]:
    """Return the metadata of a hand."""
    return {"version": HAND_VERSION, "hand": json.dumps(_plain_hand(hand))}


def image_topic(finger: str) -> str:
    """Return the topic of the images of a hand's finger."""
    return f"{FINGERS}{finger}/image/compressed"


def write_recording(recording: Recording, path: Path | str, overwrite: bool = False) -> None:
    """Write a recording, whole or not at all; an existing file is replaced only if `overwrite`. Raises FileError."""
    if not isinstance(recording, Recording):
        kind = type(recording).__name__
        raise SettingError(f"found a {kind} to write, expected a Recording; that of read_bag is its .recording")
    stamps = ros.nanoseconds(path, recording.time)
    stated = {name: getattr(recording, name) for name in STATED}
    about = {name: json.dumps(np.asarray(value).tolist()) for name, value in stated.items() if value is not None}
    if not recording.is_shape_known:
        about["is_shape_known"] = "false"
    arrays = {name: getattr(recording, name) for name in FRAME_ARRAYS}
    if recording.hand is not None:
        about |= about_hand(recording.hand)
        arrays |= _finger_arrays(recording)
    arrays |= {f"extra/{name}": value for name, value in recording.extra.items()}
    with ros.new_mcap(path, overwrite) as file:
        describe(file, recording.shape, recording.sensor, about | {"source": recording.source})
        for name, array in arrays.items():
            if array is not None:
                data = io.BytesIO()
                np.save(data, array, allow_pickle=False)
                file.writer.add_attachment(0, 0, f"{ARRAYS}{name}.npy", "application/x-npy", data.getvalue())
        for index, stamp in enumerate(stamps):
            file.add(stamp, _messages_of(recording, index, stamp))


def _finger_arrays(recording: Recording) -> dict[str, Any]:
    """Return the arrays of a hand's fingers by name, as fingers/NAME/contacts."""
    arrays: dict[str, Any] = {}
    for field in fingers.FIELDS[1:]:
        values = getattr(recording, field) or {}
        arrays |= {f"fingers/{finger}/{field}": each for finger, each in values.items()}
    return arrays


def _messages_of_fingers(recording: Recording, hand: Hand, index: int, stamp: int) -> dict[str, Any]:
    """Return the messages of a frame that belong to the fingers of a hand, by topic."""
    messages: dict[str, Any] = {}
    given = {name: poses[index] for name, poses in (recording.finger_poses or {}).items()}
    for finger, pose in hand.poses(recording.sensor_pose[index], given).items():
        topic = f"{FINGERS}{finger}"
        if recording.images is not None and finger in recording.images and recording.images[finger][index]:
            taken = stamp
            if recording.image_times is not None and finger in recording.image_times:
                taken = round(float(recording.image_times[finger][index]) * 1e9)
            messages[image_topic(finger)] = ros.stamped_image(taken, recording.images[finger][index])
        if recording.contacts is not None and finger in recording.contacts:
            messages[f"{topic}/contact"] = ros.message(ros.BOOL, data=bool(recording.contacts[finger][index]))
        messages[f"{topic}/pose"] = ros.stamped_pose(stamp, flat(), pose)
    return messages


def _messages_of(recording: Recording, index: int, stamp: int) -> dict[str, Any]:
    """Return the messages of a frame with its stamp [ns], by topic."""
    plane = flat()
    truth = recording.object_pose
    messages: dict[str, Any] = {}
    if recording.hand is not None:
        messages |= _messages_of_fingers(recording, recording.hand, index, stamp)
    if recording.image is not None:
        messages[IMAGES] = ros.stamped_image(stamp, recording.image[index])
    if recording.contact is not None:
        messages[CONTACT] = ros.message(ros.BOOL, data=bool(recording.contact[index]))
    if truth is not None and not np.isnan(truth[index, 0]):
        messages[OBJECT_POSES] = ros.stamped_pose(stamp, plane, truth[index])
    # Last of all: a frame whose sensor pose is there is whole.
    messages[SENSOR_POSES] = ros.stamped_pose(stamp, plane, recording.sensor_pose[index])
    return messages


def read_recording(path: Path | str) -> Recording:
    """Read a recording of palpate; if it is cut off, the frames that are whole, with a warning. Raises FileError."""
    path = existing_file(path)
    with in_file(path):
        about, attachments = _about_and_attachments(path)
        shape = shape_from_dict(json_object(about.get("shape", ""), "metadata shape"))
        sensor = sensor_from_dict(json_object(about.get("sensor", ""), "metadata sensor"))
        hand = hand_from_dict(json_object(about["hand"], "metadata hand")) if "hand" in about else None
        is_shape_known = about.get("is_shape_known") != "false"
        files = {name: data for name, data in attachments.items() if name.startswith(ARRAYS)}
        if not files:
            # Of a live session: each image gets the sensor's pose at its time. The time of recording is taken, which
            # equals that in the header: a replay may begin at 0 s, which in a header means no stamp.
            orientation = "upright" if about.get("is_view_known") == "true" else ""
            topics = {name: image_topic(name) for name in hand.fingers} if hand else {}
            images = ",".join(f"{name}={topic}" for name, topic in topics.items()) or IMAGES
            choices = BagChoices(orientation, images=images, sensor_poses=SENSOR_POSES, clock="log")
            recording = read_bag(path, shape, choices, hand or sensor).recording
            return replace(recording, is_shape_known=is_shape_known)
        arrays = {name.removeprefix(ARRAYS).removesuffix(".npy"): _parsed(name, data) for name, data in files.items()}
        for name in ("time", "sensor_pose"):
            if name not in arrays:
                raise FileError(f"array {name} is missing, or the file is cut off before it")
        images, count = _frames(path)
        by_finger = {name: arrays.pop(name)[:count] for name in list(arrays) if name.startswith("fingers/")}
        return Recording(
            **{name: arrays[name][:count] for name in FRAME_ARRAYS if name in arrays},
            **{name: _parsed(name, about[name]) for name in STATED if name in about},
            shape=shape,
            sensor=sensor,
            image=images.get(IMAGES) if hand is None else None,
            source=about.get("source", ""),
            extra={name[6:]: value[:count] for name, value in arrays.items() if name.startswith("extra/")},
            file=path,
            hand=hand,
            is_shape_known=is_shape_known,
            **(_finger_fields(hand, by_finger, images) if hand else {}),
        )


def _finger_fields(hand: Hand, arrays: Mapping[str, Any], images: Mapping[str, list[bytes]]) -> dict[str, Any]:
    """Return the fields of a recording that hold values by finger, of arrays by name and images by topic."""
    fields: dict[str, Any] = {}
    for name, array in arrays.items():
        _, finger, field = name.split("/", 2)
        fields.setdefault(field, {})[finger] = array
    of_fingers = {name: images.get(image_topic(name)) for name in hand.fingers}
    of_fingers = {name: each for name, each in of_fingers.items() if each is not None}
    return fields | ({"images": of_fingers} if of_fingers else {})


def _about_and_attachments(path: Path) -> tuple[dict[str, str], dict[str, bytes]]:
    """Return palpate's metadata, and all attachments by name. Raises FileError unless it is a recording of palpate."""
    if not is_mcap(path):
        raise FileError(_NO_RECORDING)
    metadata, attachments = front_matter(path)
    about = metadata.get(METADATA)
    if about is None:
        raise FileError(_NO_RECORDING)
    version = about.get("version")
    if version not in (VERSION, HAND_VERSION):
        allowed = f"versions {VERSION} and {HAND_VERSION}"
        raise FileError(f"has version {version!r}, this palpate reads {allowed}: update palpate")
    return about, attachments


def _parsed(name: str, data: bytes | str) -> Any:
    """Return the array in an attachment, or the numbers in a text of the metadata."""
    try:
        return np.load(io.BytesIO(data), allow_pickle=False) if isinstance(data, bytes) else json.loads(data)
    except Exception as error:  # damaged bytes can raise anything in NumPy's reader of headers
        raise FileError(f"attachment or metadata {name} is damaged") from error


def _frames(path: Path) -> tuple[dict[str, list[bytes]], int]:
    """Return the images by topic, and the number of frames that are whole; warns where the file is cut off.

    A frame without an image of a finger has one of no bytes.
    """
    images: dict[str, list[bytes]] = {}
    count = 0
    try:
        for raw in mcap_messages(path):
            topic, kind = raw.channel[:2]
            if kind == ros.COMPRESSED_IMAGE and (topic == IMAGES or topic.startswith(FINGERS)):
                there = images.setdefault(topic, [])
                if topic != IMAGES:
                    there += [b""] * (count - len(there))
                there.append(decoded(raw, is_own=True).data.tobytes())
            if topic == SENSOR_POSES:
                count += 1
    except CutShort as error:
        if not count:
            raise FileError(f"{error}, before the first frame") from error
        logger.warning("%s; the %d frames before that are read", error, count)
    for topic, there in images.items():
        if topic != IMAGES:
            there += [b""] * (count - len(there))
    return {topic: there[:count] for topic, there in images.items()}, count
