"""An explorer as a tracker uses it: with the object frame that the first contact makes, and the expected distance.

Without a drawing and a first pose, the origin of the object frame is half the least size behind the first contact, and
its x axis along the direction of that contact.
"""

import logging
from collections.abc import Sequence
from typing import NoReturn

import numpy as np

from palpate.arrays import Array
from palpate.config import ANYWHERE_SIGMA, TrackerSettings
from palpate.errors import SettingError
from palpate.exploring.explored import Explored
from palpate.exploring.explorer import Explorer
from palpate.exploring.felt import felt
from palpate.geometry import se2
from palpate.types.estimate import Clearance
from palpate.types.measurements import Frame, Measurement
from palpate.types.outline import Sketch, Unknown
from palpate.types.sensor import SensorProfile

logger = logging.getLogger(__name__)


class Exploration:
    """Explores one object: `step` takes a frame and returns pose and outline after it."""

    is_mirrored = False
    """False, as images are taken as they lie."""

    def __init__(self, outline: Unknown | Sketch, sensor: SensorProfile, settings: TrackerSettings) -> None:
        """Take the stated sizes or the sketch, the sensor, and settings with the noise of this sensor unit."""
        self._given = outline
        self._sensor = sensor
        self._noise = settings.noise
        self._explorer = Explorer(outline, sensor, settings)
        self._left_out: set[str] = set()  # kinds of measurements that were warned of

    def begin(self, pose: Array, covariance: Array) -> None:
        """Begin with the object's pose (3,) and its covariance (3, 3); if it is anywhere, the first contact makes it.

        Raises SettingError if a sketch is anywhere, as its object frame is that of the drawing.
        """
        self._is_placed = bool(np.sqrt(covariance.diagonal()[:2]).max() < ANYWHERE_SIGMA[0])
        if not self._is_placed and isinstance(self._given, Sketch):
            raise SettingError(
                "first pose of a sketch is unknown; allowed is the pose x [m], y [m], theta [rad] of the drawing"
            )
        self._last: Explored | None = None
        self._sensor_pose: Array | None = None  # at the last frame
        self._explorer.begin(pose, covariance)

    def end_contact(self, moved: float = 0.0) -> None:
        """Take the object as released; something else may have moved it meanwhile by this much [m]."""
        self._explorer.end_contact(moved)

    def clearance(self, sensor_pose: Array) -> Clearance:
        """Return the predicted distance of a sensor at a pose (3,) from the object."""
        if self._last is None or not self._is_placed:
            return Clearance(0.0, 1.0)  # it may be anywhere
        position = np.linalg.eigvalsh(self._last.covariance[:2, :2])[1]
        band = self._last.outline.deviation.max()
        return Clearance(self._gap(sensor_pose, self._last), float(np.sqrt(position + band**2)))

    def withdrawal(self, sensor_pose: Array) -> float:
        """Return the motion of the sensor out of the object since the last frame, if the object rests [m]."""
        if self._last is None or self._sensor_pose is None:
            return 0.0
        return self._gap(sensor_pose, self._last) - self._gap(self._sensor_pose, self._last)

    def variable(self, name: str) -> NoReturn:
        """Raise SettingError: the variables of an exploration are not those of pushing a known outline."""
        raise SettingError(f"variable {name!r} is of a known outline; of one that is learnt there is Estimate.outline")

    def step(self, frame: Frame, measurements: Sequence[Measurement]) -> Explored:
        """Take a checked frame with all its measurements, by touch and others."""
        if not self._is_placed and frame.contact:
            self._place(frame, measurements)
        self._last = self._explorer.step(frame, self._taken(frame, measurements))
        self._sensor_pose = frame.sensor_pose
        return self._last

    def _taken(self, frame: Frame, measurements: Sequence[Measurement]) -> list[Measurement]:
        """Return the measurements that an explorer takes; the first of another kind is warned of."""
        taken = [one for one in measurements if isinstance(one, Explorer.takes)]
        for kind in {
            type(one).__name__ for one in measurements if not isinstance(one, Explorer.takes)
        } - self._left_out:
            self._left_out.add(kind)
            logger.warning("frame at %.3f s: %s is left out, as the outline is not known", frame.time, kind)
        return taken

    def _place(self, frame: Frame, measurements: Sequence[Measurement]) -> None:
        """Make the object frame by the first contact, whose direction is that of the sensor if touch has none."""
        assert isinstance(self._given, Unknown)
        self._is_placed = True
        first = felt(self._sensor, measurements, self._noise, frames=1)
        angle = first.direction or 0.0
        part = self._sensor.center + np.array((0.0, first.along))
        contact = np.array((*(part + self._sensor.radius * _unit(angle)), angle))
        origin = np.array((0.5 * self._given.size[0], 0.0, 0.0))
        pose = se2.compose(se2.compose(frame.sensor_pose, contact), origin)
        known = np.diag(np.square((1e-4, 1e-4, 1e-4)))  # by its definition
        self._explorer.begin_behind_contact(pose, known)

    def _gap(self, sensor_pose: Array, known: Explored) -> float:
        """Return the distance of a sensor at a pose (3,) from the outline as it is known [m]."""
        centers = se2.transform(se2.between(known.pose, sensor_pose), self._sensor.round_centers)
        return float(known.outline.signed_distance(centers).min()) - self._sensor.radius


def _unit(angle: float) -> Array:
    """Return the unit vector (2,) at an angle [rad]."""
    return np.array((np.cos(angle), np.sin(angle)))
