"""palpate's recordings as MCAP, and back without loss.

Messages are for other programs: images as they are encoded, poses of sensor and object in the plane z = 0 of the frame
"world". What they cannot hold stands in an attachment, palpate's own recording file without its images: times and yaws
to the last bit, the outline, the sensor, contacts. It comes first, so that a file that is cut off still has it.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.io.bags.containers import raw_messages
from palpate.io.bags.contents import warn_of_cut
from palpate.io.bags.mcap_file import leading_attachments
from palpate.io.bags.mcap_writer import nanoseconds, new_mcap
from palpate.io.bags.messages import COMPRESSED_IMAGE, POSE, decoded_as
from palpate.io.bags.raw import CutShort
from palpate.io.palpate_h5 import recording_from_bytes, recording_to_bytes
from palpate.types.images import Codec
from palpate.types.plane import flat, out_of_plane
from palpate.types.recording import Recording
from palpate.types.stored_images import ImageSpool, SpooledImages

ATTACHMENT, MEDIA_TYPE = "palpate-recording.h5", "application/x-hdf5"
IMAGES, SENSOR_POSES, OBJECT_POSES = "/sensor/image/compressed", "/sensor/pose", "/object/pose"


def write_recording_mcap(recording: Recording, path: Path, overwrite: bool = False) -> None:
    """Write a recording. Raises FileError if the file exists and `overwrite` is not set, or times cannot be stamps."""
    stamps = nanoseconds(path, recording.time)
    plane = flat()
    sensor, sensor_turn = out_of_plane(plane, recording.sensor_pose)
    nowhere = np.full((len(recording), 3), np.nan)
    truth = nowhere if recording.object_pose is None else recording.object_pose
    known = ~np.isnan(truth[:, 0])
    placed, object_turn = out_of_plane(plane, np.nan_to_num(truth))
    with new_mcap(path, overwrite) as file:
        file.attach(ATTACHMENT, MEDIA_TYPE, recording_to_bytes(replace(recording, image=None)))
        for index, stamp in enumerate(stamps):
            if recording.image is not None:
                data = np.frombuffer(recording.image[index], np.uint8)
                header = file.header(stamp, "sensor")
                file.add(IMAGES, COMPRESSED_IMAGE, stamp, header=header, format=recording.codec, data=data)
            header = file.header(stamp, plane.frame)
            if known[index]:
                pose = file.pose(placed[index], object_turn[index])
                file.add(OBJECT_POSES, POSE, stamp, header=header, pose=pose)
            # Last of all: a frame whose sensor pose is there is whole.
            file.add(SENSOR_POSES, POSE, stamp, header=header, pose=file.pose(sensor[index], sensor_turn[index]))


def read_recording_mcap(path: Path) -> Recording | None:
    """The recording in an MCAP that palpate wrote, or None; of one that is cut off, the whole frames."""
    attachments = leading_attachments(path)
    if ATTACHMENT not in attachments:
        return None
    recording = recording_from_bytes(attachments[ATTACHMENT], path)
    try:
        images, codec, frames = _read_frames(path)
        if not 0 < frames <= len(recording) or 0 < len(images) < frames:
            found = f"{frames} frames and {len(images)} images"
            raise FileError(f"holds {found} of a recording of {len(recording)} frames, expected one image a frame")
        return replace(_first(recording, frames), image=images.first(frames) if images else None, codec=codec)
    except FileError as error:
        raise FileError(f"{path}: {error}") from error


def _read_frames(path: Path) -> tuple[SpooledImages, Codec, int]:
    """The images, how they are encoded, and how many frames are whole."""
    spool, places = ImageSpool(), list[tuple[int, int]]()
    codec: Codec = "jpeg"
    frames = 0
    try:
        for raw in raw_messages(path):
            if raw.channel.topic == IMAGES:
                message = decoded_as(COMPRESSED_IMAGE, raw)
                places.append(spool.add(message.data.tobytes()))
                codec = message.format
            frames += raw.channel.topic == SENSOR_POSES
    except CutShort as error:
        warn_of_cut(error, frames, "frames")
    return SpooledImages(spool, places), codec, frames


def _first(recording: Recording, count: int) -> Recording:
    """The first frames of a recording without images."""
    arrays = ("time", "sensor_pose", "object_pose", "contact", "episode")
    values = {name: getattr(recording, name) for name in arrays}
    cut = {name: None if value is None else value[:count] for name, value in values.items()}
    return replace(recording, **cut, extra={name: value[:count] for name, value in recording.extra.items()})
