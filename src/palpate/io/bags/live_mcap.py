"""What `palpate live` records: images, sensor poses and true poses as they came, and the estimates, as ROS 2 messages.

An attachment at the front holds what messages cannot: the outline and the sensor, so that the file is a recording that
can be tracked again.
"""

import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, PalpateError
from palpate.files import json_object
from palpate.geometry.shapes import Shape, shape_from_dict, shape_to_dict
from palpate.io.bags.bag_recording import read_bag
from palpate.io.bags.choices import BagChoices
from palpate.io.bags.containers import raw_messages
from palpate.io.bags.mcap_file import leading_attachments
from palpate.io.bags.messages import POSE_WITH_COVARIANCE, decoded_as, poses_of
from palpate.io.bags.raw import CutShort
from palpate.io.bags.recording_mcap import IMAGES, OBJECT_POSES, SENSOR_POSES
from palpate.types.motion import poses_in_time
from palpate.types.plane import flat, into_plane
from palpate.types.recording import Recording
from palpate.types.seen_poses import SIGMA, poses_at
from palpate.types.sensor import SensorProfile, sensor_from_dict, sensor_to_dict

Array = NDArray[np.float64]

ATTACHMENT, MEDIA_TYPE = "palpate-live.json", "application/json"


def live_attachment(shape: Shape, sensor: SensorProfile) -> bytes:
    """What the attachment says of an object and the sensor whose images are recorded."""
    return json.dumps({"shape": shape_to_dict(shape), "sensor": sensor_to_dict(sensor)}).encode()


def read_live_mcap(path: Path) -> Recording | None:
    """The recording in an MCAP of `palpate live`, each image with the pose at its time; None if it is none."""
    data = leading_attachments(path).get(ATTACHMENT)
    if data is None:
        return None
    try:
        said = json_object(data, ATTACHMENT)
        shape, sensor = shape_from_dict(said["shape"]), sensor_from_dict(said["sensor"])
    except (TypeError, KeyError, PalpateError) as error:
        raise FileError(f"{path}: the attachment {ATTACHMENT} is damaged ({error})") from error
    # By the log's clock, which is the headers': a replay may begin at 0 s, a stamp that stands for none.
    choices = BagChoices(images=IMAGES, sensor_poses=SENSOR_POSES, clock="log")
    reading = read_bag(path, shape, choices, sensor)
    if OBJECT_POSES not in reading.mapping.unused:
        return reading.recording
    try:
        return _with_truth(reading.recording, path)
    except FileError as error:
        raise FileError(f"{path}: {error}") from error


def _with_truth(recording: Recording, path: Path) -> Recording:
    """The recording with the true poses between those of the file, which are in the plane of the sensor's."""
    plane = flat()
    told: dict[int, tuple[tuple[float, ...], Array]] = {}
    with suppress(CutShort):  # which reading the rest has told
        for raw in raw_messages(path):
            if raw.channel.topic == OBJECT_POSES:
                message = decoded_as(POSE_WITH_COVARIANCE, raw)
                told[raw.log_time] = poses_of(message)[0].numbers, np.sqrt(message.pose.covariance[[0, 7, 35]])
    numbers, sigmas = (np.array([told[time][part] for time in sorted(told)]) for part in (0, 1))
    poses = poses_in_time(OBJECT_POSES, plane.frame, np.array(sorted(told)), numbers)
    pose, _, _ = into_plane(plane, poses.position, poses.rotation)
    found, sigma = poses_at(recording.time, poses.time / 1e9, pose, sigmas)
    frames = recording.frames | {"object_pose": f"{OBJECT_POSES}, as an overhead camera told it meanwhile"}
    return replace(recording, object_pose=found, extra={**recording.extra, SIGMA: sigma}, frames=frames)
