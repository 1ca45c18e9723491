"""By how much the clock of the images is off that of the poses, from when contacts begin.

By the images a contact begins when the gel first shows it; by the poses, when the sensor's surface comes to the outline
of the object, which still rests where it was. The difference is the offset. A pose that is wrong by 1 mm makes it wrong
by as long as the sensor takes for 1 mm, so a fast approach tells more than a slow one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import NoiseSettings
from palpate.errors import SettingError
from palpate.touch.calibration import Calibration, detector_for, turned_as, view_of
from palpate.types import derived
from palpate.types.recording import Recording

Array = NDArray[np.float64]

LARGEST = 1.0
"""[s] The largest offset that is looked for."""
SHOWN = 0.3e-3
"""[m] How exactly the gel shows when it is reached, standard deviation: 13 onsets of simulated DIGITs had 0.25 mm."""
SLOWEST = 1e-3
"""[m/s] An approach that is slower tells nothing."""


@dataclass(frozen=True)
class TimeOffset:
    """Offset to add to the times of the images."""

    seconds: float
    """[s]"""
    sigma: float
    """Standard deviation [s]."""
    contacts: int
    """Number of contacts it was estimated from."""

    @property
    def is_significant(self) -> bool:
        """The offset differs from 0 by more than two standard deviations."""
        return abs(self.seconds) > 2.0 * self.sigma

    def __str__(self) -> str:
        starts = f"the start of {self.contacts} contact{'s' if self.contacts > 1 else ''}"
        used = "" if self.is_significant else "; not significantly different from 0, so 0 is used"
        return f"time offset {self.seconds:.3f} s, sigma {self.sigma:.3f} s, from {starts}{used}"


def time_offset(
    recording: Recording,
    first_pose: ArrayLike | None,
    first_pose_sigma: ArrayLike | None,
    noise: NoiseSettings,
    calibration: Calibration | None = None,
) -> TimeOffset:
    """Estimate the offset from the images and poses of a recording.

    `first_pose` (3,) is world_T_object [m, m, rad] with standard deviations `first_pose_sigma` (3,), and only the first
    contact is used; without a first pose, the ground truth before each contact is. Raises SettingError where no contact
    can be used.
    """
    pose_sigma = noise.sensor_pose.calibration[0]
    if first_pose is not None:
        sigma = noise.first_pose.deviation if first_pose_sigma is None else np.asarray(first_pose_sigma)
        pose_sigma = float(np.hypot(pose_sigma, np.hypot(sigma[0], sigma[1])))
    found = [
        each
        for onset in _onsets(recording, calibration)[: None if first_pose is None else 1]
        if (each := _offset(recording, onset, _rest(recording, onset, first_pose), pose_sigma)) is not None
    ]
    if not found:
        raise SettingError(
            f"{recording.file or 'the recording'}: no contact tells the time offset: a contact has to begin within "
            f"{LARGEST:g} s of when the sensor comes to the object, whose pose has to be known"
        )
    offset, sigma = np.array(found).T
    weight = sigma**-2 / np.sum(sigma**-2)
    # Errors of poses are much the same in every contact, so more contacts do not make sigma smaller.
    return TimeOffset(float(weight @ offset), float(weight @ sigma), len(found))


def _onsets(recording: Recording, calibration: Calibration | None) -> list[int]:
    """The first frames of contacts, by the images."""
    detector, view = detector_for(turned_as(recording.sensor, calibration), calibration), view_of(calibration)
    images = (frame.image for frame in recording)
    touched = np.array([image is not None and detector.update(detector.read(view.of(image))) for image in images])
    return (np.flatnonzero(touched[1:] & ~touched[:-1]) + 1).tolist()


def _rest(recording: Recording, onset: int, first_pose: ArrayLike | None) -> Array | None:
    """Where the object is before a contact, (3,) [m, m, rad]."""
    if first_pose is not None:
        return np.asarray(first_pose, np.float64)
    truth = recording.object_pose
    before = recording.time < recording.time[onset] - LARGEST / 2
    known = before & (np.zeros(len(recording), np.bool_) if truth is None else ~np.isnan(truth).any(axis=1))
    return truth[np.flatnonzero(known)[-1]] if truth is not None and known.any() else None


def _offset(recording: Recording, onset: int, rest: Array | None, pose_sigma: float) -> tuple[float, float] | None:
    """Offset and its sigma [s] by one contact; None where the poses do not come to the object about then."""
    if rest is None:
        return None
    time = recording.time
    seen = 0.5 * (time[onset - 1] + time[onset])
    gap = derived.gaps(recording.sensor_pose, np.tile(rest, (len(time), 1)), recording.shape, recording.sensor)
    reached = np.flatnonzero((gap[:-1] > 0.0) & (gap[1:] <= 0.0) & (np.abs(time[:-1] - seen) < LARGEST))
    if not len(reached):
        return None
    last = reached[np.argmin(np.abs(time[reached] - seen))]
    step = float(time[last + 1] - time[last])
    speed = float(gap[last] - gap[last + 1]) / step
    if speed < SLOWEST:
        return None
    sigma = np.hypot(np.hypot(pose_sigma, SHOWN) / speed, (time[onset] - time[onset - 1]) / np.sqrt(12.0))
    return float(time[last] + gap[last] / speed - seen), float(sigma)
