"""Offset between the clocks of images and poses, estimated from the starts of contacts.

In images a contact starts when the gel first shows it; by the poses, when the sensor's surface reaches the outline of
the object at rest. The difference is the offset. A pose error of 1 mm makes it wrong by the time in which the sensor
moves 1 mm, so a fast approach measures it better than a slow one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import NoiseSettings
from palpate.errors import SettingError
from palpate.touch.calibration import Calibration, detector_for, turned_as, view_of
from palpate.types.recording import Recording

Array = NDArray[np.float64]

LARGEST = 1.0
"""Largest offset considered [s]."""
SHOWN = 0.3e-3
"""Accuracy of the position at which the gel shows a contact [m]: 13 contacts of simulated DIGITs had 0.25 mm."""
SLOWEST = 1e-3
"""Slowest approach that is used [m/s]."""


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
    starts, truth = _contact_starts(recording, calibration), recording.object_pose
    if first_pose is not None:
        sigma = noise.first_pose.deviation if first_pose_sigma is None else np.asarray(first_pose_sigma)
        pose_sigma = float(np.hypot(pose_sigma, np.hypot(sigma[0], sigma[1])))
        rests = [(start, np.asarray(first_pose, np.float64)) for start in starts[:1]]
    else:
        known = np.zeros(len(recording), np.bool_) if truth is None else ~np.isnan(truth).any(axis=1)
        before = ((start, known & (recording.time < recording.time[start] - LARGEST / 2)) for start in starts)
        rests = [
            (start, truth[np.flatnonzero(flags)[-1]]) for start, flags in before if truth is not None and flags.any()
        ]
    found = [each for start, rest in rests if (each := _offset(recording, start, rest, pose_sigma)) is not None]
    if not found:
        raise SettingError(
            f"{recording.file or 'the recording'}: no contact shows the time offset: one has to start within "
            f"{LARGEST:g} s of when the sensor reaches the object, whose pose has to be known"
        )
    offset, sigma = np.array(found).T
    weight = sigma**-2 / np.sum(sigma**-2)
    # Pose errors are much the same in every contact, so more contacts do not make sigma smaller.
    return TimeOffset(float(weight @ offset), float(weight @ sigma), len(found))


def _contact_starts(recording: Recording, calibration: Calibration | None) -> list[int]:
    """Return the first frames of contacts in the images."""
    detector, view = detector_for(turned_as(recording.sensor, calibration), calibration), view_of(calibration)
    images = (frame.image for frame in recording)
    touched = np.array([image is not None and detector.update(detector.read(view.of(image))) for image in images])
    return (np.flatnonzero(touched[1:] & ~touched[:-1]) + 1).tolist()


def _offset(recording: Recording, start: int, rest: Array, pose_sigma: float) -> tuple[float, float] | None:
    """Return the offset and its sigma [s] by one contact with the object at rest (3,); None if it cannot be used."""
    time = recording.time
    seen = 0.5 * (time[start - 1] + time[start])
    gap = recording.sensor.gaps(recording.sensor_pose, np.tile(rest, (len(time), 1)), recording.shape)
    reached = np.flatnonzero((gap[:-1] > 0.0) & (gap[1:] <= 0.0) & (np.abs(time[:-1] - seen) < LARGEST))
    if not len(reached):
        return None
    last = reached[np.argmin(np.abs(time[reached] - seen))]
    speed = float(gap[last] - gap[last + 1]) / float(time[last + 1] - time[last])
    if speed < SLOWEST:
        return None
    sigma = np.hypot(np.hypot(pose_sigma, SHOWN) / speed, (time[start] - time[start - 1]) / np.sqrt(12.0))
    return float(time[last] + gap[last] / speed - seen), float(sigma)
