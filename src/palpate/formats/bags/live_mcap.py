"""What `palpate live` records: images and sensor poses as they came, and the estimates, as ROS 2 messages.

An attachment at the front holds what messages cannot: the outline and the sensor, so that the file is a recording that
can be tracked again.
"""

import json
from pathlib import Path

from palpate.errors import FileError, PalpateError
from palpate.files import json_object
from palpate.formats.bags.bag_recording import read_bag
from palpate.formats.bags.choices import BagChoices
from palpate.formats.bags.mcap_file import leading_attachments
from palpate.formats.bags.recording_mcap import IMAGES, SENSOR_POSES
from palpate.geometry.shapes import Shape, shape_from_dict, shape_to_dict
from palpate.recording.recording import Recording
from palpate.recording.sensor import SensorProfile, sensor_from_dict, sensor_to_dict

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
    return read_bag(path, shape, BagChoices(images=IMAGES, sensor_poses=SENSOR_POSES, clock="log"), sensor).recording
