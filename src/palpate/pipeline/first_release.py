"""The untouched gel of a recording that begins in contact, from images after its first release.

A sensor cannot pull, so once it has drawn back from its farthest point it no longer touches the object.
"""

import logging
from contextlib import suppress

import numpy as np

from palpate.arrays import Array, Flags
from palpate.config import LARGEST_ERROR, UNLIKELY
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.io.recording import Recording
from palpate.touch.background import SteadyImages, first_frames
from palpate.touch.calibration import Calibration
from palpate.touch.contact_detector import touched

logger = logging.getLogger(__name__)


def release_after_start(
    recording: Recording, first_pose: Array, first_pose_sigma: Array, tactile: str, largest: Shape | None = None
) -> Calibration | None:
    """Return a calibration with the untouched gel of a recording that begins in contact.

    None if by its first pose (3,) it cannot begin in contact, or if no later images show an untouched gel against which
    the first ones are touched. `largest` is the largest outline that the object may have, by default the recording's.
    """
    if recording.image is None or tactile not in ("auto", "learnt"):
        return None
    sensor = recording.sensor
    count = first_frames(sensor.rate)
    first_sensor_poses = recording.sensor_pose[:count]
    gap = sensor.gaps(first_sensor_poses, np.tile(first_pose, (len(first_sensor_poses), 1)), largest or recording.shape)
    if gap.min() > LARGEST_ERROR[0] + UNLIKELY * np.hypot(*first_pose_sigma[:2]):
        return None
    steady = SteadyImages(sensor.rate)
    for index in np.flatnonzero(_has_drawn_back(recording.sensor_pose)).tolist():
        with suppress(FileError):  # of a damaged image
            image = recording[index].image
            gel = None if image is None else steady.add(image)
            if gel is None:
                continue
            untouched = Calibration(gel, is_sure=True)
            if not touched(recording.image[:count], sensor, untouched).any():
                return None
            name = recording.file or "the recording"
            start = recording.time[index - count + 1] - recording.time[0]
            logger.warning("%s: begins in contact; the untouched gel is taken from %.2f s on", name, start)
            return untouched
    return None


def _has_drawn_back(sensor_pose: Array) -> Flags:
    """Return flags of poses (N, 3) that are behind the farthest point so far, along the sensor's x axis."""
    forward = np.append(0.0, np.cumsum(se2.between(sensor_pose[:-1], sensor_pose[1:])[:, 0]))  # [m]
    return np.maximum.accumulate(forward) - forward > LARGEST_ERROR[0]
