"""A sensor frame that is turned about its z axis, as seen at the first contact, where the object is known best.

The outline and the image each give the direction in which the gel is touched; the difference is the turn. Images that
lie the other way give the opposite direction, so there are two answers: one for upright and one for mirrored images.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Flags
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.status import FrameTurn, turn_words
from palpate.types.measurements import ContactDirection, Frame, Measurement
from palpate.types.sensor import SensorProfile

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Limits:
    """Limits of what is found here."""

    fewest: int = 4
    """Least number of frames of touch for an answer."""
    most: int = 10
    """Frames of touch that are looked at."""
    farthest: float = 4e-3
    """[m] Way of the sensor in the contact up to which the object is still about where it was."""
    samples: int = 100
    """Poses that the object may have at first."""
    iterations: int = 8
    """Steps to the turn with which direction and outline agree."""
    unmodelled: float = math.radians(4.0)
    """[rad] Standard deviation of a direction beyond that stated: outline, mounting, and what all images share."""
    deviations: float = 3.0
    """Standard deviations of a direction beyond which it does not fit."""
    share: float = 0.02
    """Share of the object's poses with which a direction must fit, so that nothing is turned."""
    widest: float = math.radians(10.0)
    """[rad] Standard deviation of a turn up to which it is named."""


_LIMITS = _Limits()


class _Touch(NamedTuple):
    """A frame of the first contact."""

    sensor_pose: Array
    direction: float
    """[rad]"""
    variance: float
    """[rad^2]"""


class FrameTurnMonitor:
    """Compares touch at the first contact with the outline of an object whose first pose is known, and warns once."""

    def __init__(self, shape: Shape, sensor: SensorProfile, pose: Array, covariance: Array) -> None:
        """Take the outline, the sensor, and the object's first pose (3,) with its covariance (3, 3)."""
        self._shape = shape
        self._sensor = sensor
        gauss = Random(0).gauss  # without `np.random`, which takes 3 MB
        draws = np.array([[gauss() for _ in range(3)] for _ in range(_LIMITS.samples)])
        squares, axes = np.linalg.eigh(covariance)
        self._objects = se2.compose(pose, draws * np.sqrt(np.maximum(squares, 0.0)) @ axes.T)
        self._touches: list[_Touch] = []
        self._unread_way = 0.0  # [m] in contact, before a direction was read
        self._contact_pose: Array | None = None  # of the sensor in the frame before, if it touched
        self.is_watching = len(sensor.tips) == 1 and not sensor.flat_width
        """True until all touches that tell have been seen."""
        self.found: FrameTurn | None = None
        """The turn; None if there is none, or it does not show."""

    def see(self, frame: Frame, measured: Sequence[Measurement]) -> None:
        """Take a frame with what was read from its image, while `is_watching`."""
        directions = [one for one in measured if isinstance(one, ContactDirection)]
        has_left = self._has_left(frame)
        if directions and not has_left:
            self._touches.append(_Touch(frame.sensor_pose, directions[0].angle, directions[0].variance))
        self.is_watching = not has_left and len(self._touches) < _LIMITS.most
        if len(self._touches) == _LIMITS.fewest or (len(self._touches) > _LIMITS.fewest and not self.is_watching):
            turn = self._turn()
            if turn is not None and self.found is None:
                logger.warning("frame at %.3f s: %s", frame.time, turn_words(turn))
            self.found = turn

    def _has_left(self, frame: Frame) -> bool:
        """Return true if the object may be elsewhere by now: the first contact ended, or the sensor went far in one."""
        if self._touches:
            way = np.linalg.norm(frame.sensor_pose[:2] - self._touches[0].sensor_pose[:2])
            return not frame.contact or bool(way > _LIMITS.farthest)
        if frame.contact and self._contact_pose is not None:
            self._unread_way += float(np.linalg.norm(frame.sensor_pose[:2] - self._contact_pose[:2]))
        self._contact_pose = frame.sensor_pose if frame.contact else None
        return self._unread_way > _LIMITS.farthest

    def _turn(self) -> FrameTurn | None:
        """Return the turn that the touches so far show, if there is one."""
        direction = float(np.median([touch.direction for touch in self._touches]))
        variance = float(np.median([touch.variance for touch in self._touches])) + _LIMITS.unmodelled**2
        pose = np.median([touch.sensor_pose for touch in self._touches], axis=0)
        fits = [self._fits(pose, shown, _LIMITS.deviations * math.sqrt(variance)) for shown in (direction, -direction)]
        if fits[0]:
            return None
        angle, mirrored_angle = (self._agreeing(pose, shown) for shown in (direction, -direction))
        return FrameTurn(angle, mirrored_angle, may_be_mirrored=fits[1])

    def _fits(self, sensor_pose: Array, direction: float, tolerance: float) -> bool:
        """Return True if a direction [rad] agrees with the outline at enough of the poses that the object may have."""
        fits: Flags = np.abs(self._disagreement(sensor_pose, direction, self._sensor.centers)) < tolerance
        return float(fits.mean()) >= _LIMITS.share

    def _agreeing(self, sensor_pose: Array, direction: float) -> float | None:
        """Return the turn [rad] with which a direction [rad] agrees with the outline; None if it is not known well."""
        # The apex is where it is, however the frame is turned about it; the centre of curvature moves.
        turn = self._disagreement(sensor_pose, direction, np.array(self._sensor.tips))
        for _ in range(_LIMITS.iterations):
            turned = sensor_pose + turn[:, None] * np.array((0.0, 0.0, 1.0))
            turn = se2.wrap(turn + 0.7 * self._disagreement(turned, direction, self._sensor.centers))
        mean = float(np.angle(np.exp(1j * turn).mean()))
        spread = float(np.sqrt(np.square(se2.wrap(turn - mean)).mean()))
        return mean if spread < _LIMITS.widest else None

    def _disagreement(self, sensor_pose: Array, direction: float, point: Array) -> Array:
        """Return the angle [rad] from a direction to the outline's normal next to a point (1, 2) [m] of the sensor.

        There is one for each pose of the object.
        """
        object_T_sensor = se2.between(self._objects, np.broadcast_to(sensor_pose, self._objects.shape))
        place = se2.transform(object_T_sensor[:, None], point)[:, 0]
        step = 1e-4  # [m]
        shifts = step * np.array(((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)))
        distance = self._shape.signed_distance(place + shifts[:, None])
        inward = np.arctan2(distance[3] - distance[2], distance[1] - distance[0])
        return se2.wrap(inward - object_T_sensor[:, 2] - direction)
