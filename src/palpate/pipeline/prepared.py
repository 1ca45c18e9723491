"""What tracking a recording begins with: the first pose, and how the gel looks untouched where it begins in contact."""

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import NoiseSettings, TrackerSettings
from palpate.errors import SettingError
from palpate.geometry.shapes import shape_to_dict
from palpate.pipeline.truth import trusted_truth
from palpate.touch.background import first_frames
from palpate.touch.calibration import Calibration, turned_as
from palpate.touch.lift import Lift, lift_of
from palpate.touch.model import TouchModel
from palpate.touch.modes import TactileChoice
from palpate.tracker import Tracker
from palpate.types.derived import gaps
from palpate.types.recording import Recording
from palpate.types.sensor import SensorProfile, sensor_to_dict

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]

_REACH, _SURE = 5e-3, 3.0
"""[m] between sensor and object beyond which nothing is touched, and besides so many sigmas of the first pose."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """A recording and what tracking it begins with."""

    recording: Recording
    """What to track."""
    settings: TrackerSettings
    """How."""
    model: TouchModel | None
    """What feels, where touch is learnt; None is the one that comes with palpate."""
    calibration: Calibration | None
    """What the untouched sensor looks like, where it was given or found after the recording began in contact."""
    untouched_from: float | None
    """When it was found so [s]; None where it was not."""
    first_pose: Array
    """world_T_object at the start, (3,) [m, m, rad]."""
    first_pose_sigma: Array
    """How well it is known, (3,) [m, m, rad]."""

    @property
    def sensor(self) -> SensorProfile:
        """The recording's sensor as the calibration has its images."""
        return turned_as(self.recording.sensor, self.calibration)

    def tracker(self) -> Tracker:
        """Return a tracker that has taken no frame yet."""
        given = self.recording.shape, self.sensor, self.first_pose, self.settings, self.model, self.calibration
        return Tracker(*given, first_pose_sigma=self.first_pose_sigma)

    def made_of(self) -> dict[str, Any]:
        """Return what a saved state must have been made of, by words for a message."""
        recording, calibration = self.recording, self.calibration
        return {
            "recording": (recording.source, recording.time, recording.sensor_pose),
            "object": shape_to_dict(recording.shape),
            "sensor": sensor_to_dict(self.sensor),
            "first pose": self.first_pose,
            "first pose sigma": self.first_pose_sigma,
            "setting": self.settings,
            "touch model": None if self.model is None else self.model.hash,
            "calibration": calibration and calibration.hash,
        }


def prepare(
    recording: Recording,
    settings: TrackerSettings,
    first_pose: ArrayLike | None,
    first_pose_sigma: ArrayLike | None,
    model: TouchModel | None,
    calibration: Calibration | None,
) -> Prepared:
    """Return what tracking begins with; see `tracking.run.track`.

    Raises SettingError if the recording lacks what the settings need.
    """
    first, sigma = first_pose_of(recording, settings.noise, first_pose, first_pose_sigma)
    _check(recording, settings)
    lift = None if calibration else lift_of_beginning(recording, first, sigma, settings.tactile)
    return Prepared(
        recording=recording,
        settings=settings,
        model=model,
        calibration=lift.calibration if lift else calibration,
        untouched_from=lift.time if lift else None,
        first_pose=first,
        first_pose_sigma=sigma,
    )


def _check(recording: Recording, settings: TrackerSettings) -> None:
    name = recording.file or "the recording"
    if recording.contact is None and recording.image is None:
        raise SettingError(f"{name}: has neither images nor contact flags, and tracking needs one of them")
    if settings.tactile.startswith("learnt") and recording.image is None:
        raise SettingError(f"{name}: has no images, which tactile {settings.tactile} needs")
    known = recording.object_pose is not None and not np.isnan(recording.object_pose).all()
    if settings.tactile == "oracle" and not known:
        raise SettingError(f"{name}: has no ground truth, which tactile oracle takes its measurements from")


def lift_of_beginning(
    recording: Recording, first_pose: Array, first_pose_sigma: Array, tactile: TactileChoice
) -> Lift | None:
    """Return the first moment without contact where the sensor touches the object in the first images; else None.

    It may do so where it is at the first pose (3,), which is known as well as its sigma (3,) says.
    """
    if recording.image is None or not tactile.startswith(("auto", "learnt")):
        return None
    count = min(first_frames(recording.sensor.rate), len(recording))
    gap = gaps(recording.sensor_pose[:count], np.tile(first_pose, (count, 1)), recording.shape, recording.sensor)
    if gap.min() > _REACH + _SURE * np.hypot(*first_pose_sigma[:2]):
        return None
    lift = lift_of(recording)
    if lift:
        logger.warning(
            "%s: begins in contact; how the gel looks untouched is taken from %.2f s on",
            recording.file or "the recording",
            lift.time,
        )
    return lift


def first_pose_of(
    recording: Recording,
    noise: NoiseSettings,
    given: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Return the first pose (3,) [m, m, rad] and how well it is known (3,).

    It is what is given; else what the recording says; else the first ground truth. Raises SettingError where there is
    none of them.
    """
    deviation = np.array(noise.first_pose.deviation)
    if given is not None:
        first = np.asarray(given, np.float64)
    elif recording.first_pose is not None:
        first = recording.first_pose
        deviation = deviation if recording.first_pose_sigma is None else recording.first_pose_sigma
    else:
        first, deviation = _first_truth(recording), np.array(noise.first_pose.truth)
    return first, deviation if sigma is None else np.asarray(sigma, np.float64)


def _first_truth(recording: Recording) -> Array:
    name = recording.file or "the recording"
    known = trusted_truth(recording)
    if recording.object_pose is None or not known.any():
        raise SettingError(
            f"{name}: has no ground truth to start from; give the object's first pose [m, m, rad]: "
            "--first-pose X Y THETA or --first-pose-unknown, in Python first_pose"
        )
    first = int(np.argmax(known))
    if recording.contact is not None and recording.contact[:first].any():
        logger.warning("%s: the first pose is ground truth of frame %d, after contact began", name, first)
    return recording.object_pose[first]
