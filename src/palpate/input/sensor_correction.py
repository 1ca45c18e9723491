"""Correction of a sensor whose images are late, or which is mounted beside its stated place, by a calibration."""

from dataclasses import replace

import numpy as np

from palpate.arrays import Array
from palpate.geometry import se2
from palpate.input.checked_frame import CorrectedFrame
from palpate.touch.calibration import SetUp
from palpate.types.estimate import Estimate
from palpate.types.measurements import Frame

_REMEMBERED = 1.0  # [s] of sensor poses, from which the pose at an image's time is interpolated


def moved_on(estimate: Estimate, motion: Array | None) -> Estimate:
    """Return an estimate that was made for the time of an image at the time of its frame.

    In contact the object moves with the sensor by its `motion` (3,) since then; between contacts it rests.
    """
    if motion is None or not estimate.contact:
        return estimate
    answers = tuple(replace(answer, pose=se2.compose(motion, answer.pose)) for answer in estimate.answers)
    return replace(estimate, pose=se2.compose(motion, estimate.pose), answers=answers)


class SensorCorrection:
    """Gives frames the pose that the sensor had when the image was taken."""

    def __init__(self, set_up: SetUp | None) -> None:
        """Take the errors of the set-up; without them frames stay as they are."""
        self._set_up = set_up
        self._path: list[tuple[float, Array]] = []  # times [s] and poses of the last second, of frames that were used

    def reset(self) -> None:
        """Forget all frames."""
        self._path = []

    def corrected(self, frame: Frame) -> CorrectedFrame:
        """Return a frame with the sensor's true pose when its image was taken. Nothing is remembered of it so far."""
        if self._set_up is None:
            return CorrectedFrame(frame, frame.sensor_pose)
        sideways = self._set_up.sideways[0]
        delay = self._set_up.delay[0]
        latest = se2.compose(frame.sensor_pose, (0.0, -sideways, 0.0))
        path = [*self._before(frame.time), (frame.time, latest)]
        times = np.array([time for time, _ in path])
        poses = np.array([pose for _, pose in path])
        at_image = se2.interpolated(frame.time - delay, times, poses)
        motion = se2.compose(latest, se2.inverse(at_image))
        return CorrectedFrame(replace(frame, sensor_pose=at_image), latest, motion if motion.any() else None)

    def accept(self, used: CorrectedFrame) -> None:
        """Remember a frame that was used."""
        if self._set_up is not None:
            time = used.frame.time
            self._path = [*self._before(time), (time, used.latest_pose)]

    def _before(self, time: float) -> list[tuple[float, Array]]:
        """Return times and poses of the last second before a time [s]."""
        return [(earlier, pose) for earlier, pose in self._path if time - _REMEMBERED < earlier < time]
