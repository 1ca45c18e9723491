"""The first release of a recording that begins in contact: there its images show the untouched gel.

A sensor cannot pull, so one that has drawn back from its farthest point has let the object go.
"""

import logging
from contextlib import suppress

import numpy as np

from palpate.arrays import Array
from palpate.config import LARGEST_ERROR, UNLIKELY
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.io.recording import Recording
from palpate.touch.background import SteadyImages, first_frames
from palpate.touch.calibration import Calibration
from palpate.touch.contact_detector import touched

logger = logging.getLogger(__name__)


def release_after_start(
    recording: Recording, first_pose: Array, first_pose_sigma: Array, tactile: str
) -> Calibration | None:
    """Return the untouched gel of a recording that begins in contact, as its first pose (3,) allows; else None."""
    if recording.image is None or tactile not in ("auto", "learnt"):
        return None
    sensor, pose, count = recording.sensor, recording.sensor_pose, first_frames(recording.sensor.rate)
    gap = sensor.gaps(pose[:count], np.tile(first_pose, (len(pose[:count]), 1)), recording.shape)
    if gap.min() > LARGEST_ERROR[0] + UNLIKELY * np.hypot(*first_pose_sigma[:2]):
        return None
    ahead = np.append(0.0, np.cumsum(se2.between(pose[:-1], pose[1:])[:, 0]))  # along the sensor's x axis
    steady = SteadyImages(sensor.rate)
    for index in np.flatnonzero(np.maximum.accumulate(ahead) - ahead > LARGEST_ERROR[0]).tolist():
        with suppress(FileError):  # of a damaged image
            image = recording[index].image
            if image is None or (gel := steady.add(image)) is None:
                continue
            untouched = Calibration(gel, is_sure=True)
            if not touched(recording.image[:count], sensor, untouched).any():
                return None
            name, start = recording.file or "the recording", recording.time[index - count + 1] - recording.time[0]
            logger.warning("%s: begins in contact; the untouched gel is taken from %.2f s on", name, start)
            return untouched
    return None
