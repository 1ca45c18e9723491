"""Checks that the poses of a recording belong to its images: what is alive may be of something else."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array, Flags
from palpate.config import LARGEST_ERROR, UNLIKELY
from palpate.geometry import se2
from palpate.input.push_direction import SIDEWAYS_PUSH, axis_words
from palpate.io.recording import Recording


@dataclass(frozen=True)
class _Limits:
    """Limits of what is found here."""

    still: float = 1e-3
    """[m] and, over ten times the length, [rad]: a sensor that pushes moves farther."""
    shortest_touch: int = 8
    """Frames in contact from which a sensor that pushes has moved."""
    close: float = 1e-3
    """[m] Distance from the object's true outline at which a sensor touches it."""
    far: float = 0.02
    """[m] Distance from the object at which no touch can be, even with large errors of mounting and outline."""


_LIMITS = _Limits()


def mismatches(
    recording: Recording, contact: Flags, first_pose: Array | None = None, first_pose_sigma: Array | None = None
) -> Iterator[str]:
    """Yield a sentence on each sign that poses and images are not of one sensor, or its frame is another.

    `contact` (N,) is contact as the images, or flags, show it, and `first_pose` (3,) the object's, with its standard
    deviations (3,) [m, m, rad], by default those of the recording.
    """
    pose = recording.sensor_pose
    turns = se2.wrap(pose[:, 2] - pose[0, 2])
    extent = max(float(np.ptp(pose[:, :2], axis=0).max()), 0.1 * float(np.ptp(turns)))
    if contact.sum() >= _LIMITS.shortest_touch and extent < _LIMITS.still:
        yield (
            f"the sensor's pose does not change, it stands within {1e3 * extent:.2g} mm, though it touches: are its "
            "poses those of this sensor, and does their source give new ones?"
        )
    if recording.image is None:
        return
    steps = se2.between(pose[:-1], pose[1:])[contact[:-1] & contact[1:], :2].sum(axis=0)
    angle = float(np.arctan2(steps[1], steps[0]))
    if abs(angle) >= SIDEWAYS_PUSH and np.hypot(*steps) * np.cos(SIDEWAYS_PUSH) >= LARGEST_ERROR[0]:
        yield axis_words(angle)
    if first_pose is None:
        first_pose = recording.first_pose
        first_pose_sigma = recording.first_pose_sigma
    if first_pose is None:
        return
    object_pose = np.where(np.isfinite(recording.truth), recording.truth, first_pose)
    gap = recording.sensor.gaps(pose, object_pose, recording.shape)
    sigma = np.zeros(3) if first_pose_sigma is None else first_pose_sigma
    margin = LARGEST_ERROR[0] + UNLIKELY * float(np.hypot(*sigma[:2]))
    at_first = recording.sensor.gaps(pose, np.broadcast_to(first_pose, pose.shape), recording.shape)
    touches = (gap < _LIMITS.close) & np.isfinite(recording.truth[:, 0])
    if not contact.any() and (at_first.min() < -margin or touches.sum() >= _LIMITS.shortest_touch):
        yield (
            f"the images show no touch, though the sensor goes {-1e3 * min(at_first.min(), 0.0):.0f} mm into the place "
            "where the object is at first: are they of the camera of this sensor?"
        )
    is_known = contact & np.isfinite(recording.truth[:, 0])
    if is_known.sum() >= _LIMITS.shortest_touch and np.median(gap[is_known]) > _LIMITS.far:
        yield (
            f"the images show a touch where the sensor is {1e3 * np.median(gap[is_known]):.0f} mm from the object: are "
            "they of the camera of this sensor, and are both poses in one frame?"
        )
