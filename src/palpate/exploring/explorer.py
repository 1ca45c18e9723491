"""The estimator of pose and outline together.

A stand-in until there is one: the object stays where it began, moves with the sensor in contact, and its outline is
what was given of it.
"""

from collections.abc import Sequence

import numpy as np

from palpate.arrays import Array
from palpate.config import TrackerSettings
from palpate.exploring.evidence import form_evidence, pose_evidence
from palpate.exploring.explored import Explored
from palpate.geometry import se2
from palpate.types.measurements import ContactDirection, Frame, Measurement, TouchMeasurement, Turn
from palpate.types.outline import Outline, Sketch, Unknown
from palpate.types.sensor import SensorProfile


class Explorer:
    """Estimates pose and outline of one object: `step` takes a frame and returns what is known after it."""

    takes: tuple[type[Measurement], ...] = (TouchMeasurement,)
    """Kinds of measurements that it takes; others are left out with a warning before they come to it."""

    def __init__(self, outline: Unknown | Sketch, sensor: SensorProfile, settings: TrackerSettings) -> None:
        """Take what is known of the outline; the sensor; and the settings, with the noise of this sensor unit."""
        self._given = outline
        self._settings = settings
        self._usual = _prior_of(outline)

    def begin(self, pose: Array, covariance: Array) -> None:
        """Begin with the object's pose (3,) and its covariance (3, 3), and what was given of the outline."""
        self._pose = pose
        self._covariance = covariance
        self._touched = np.zeros(len(self._usual.points), np.bool_)
        self._has_directions = False
        self._held: Array | None = None  # sensor_T_object in this contact

    def end_contact(self, moved: float = 0.0) -> None:
        """Take the object as released; something else may have moved it meanwhile by this much [m]."""
        self._held = None
        self._covariance = self._covariance + np.diag((moved**2, moved**2, 0.0))

    def step(self, frame: Frame, measurements: Sequence[Measurement]) -> Explored:
        """Take a checked frame with all its measurements, by touch and others; its `contact` is True or False."""
        if frame.contact:
            self._has_directions |= any(isinstance(one, ContactDirection | Turn) for one in measurements)
            if self._held is None:
                self._held = se2.between(frame.sensor_pose, self._pose)
                self._covariance = self._covariance + np.diag((1e-6, 1e-6, 1e-4))
            self._pose = se2.compose(frame.sensor_pose, self._held)
            x, y, _ = se2.between(self._pose, frame.sensor_pose).tolist()
            places = len(self._touched)
            self._touched[(round(np.arctan2(y, x) * places / (2.0 * np.pi)) + np.arange(-3, 4)) % places] = True
        deviation = np.where(self._touched, 1e-3, self._usual.deviation)
        outline = Outline(self._usual.points, deviation, self._touched.copy())
        length, _ = self._settings.tolerance
        form = form_evidence(outline, self._given, length, self._has_directions)
        evidence = pose_evidence(self._covariance, bool(frame.contact), self._settings.tolerance, form)
        return Explored(self._pose, self._covariance, outline, evidence)


def _prior_of(given: Unknown | Sketch, count: int = 128) -> Outline:
    """Return what is known of an outline before it is touched."""
    angle = np.arange(count) * (2.0 * np.pi / count)
    if isinstance(given, Unknown):
        radius = np.full(count, 0.5 * given.mean_width)
        deviation = np.full(count, 0.25 * (given.size[1] - given.size[0]))
    else:
        corners = given.shape.outline(2000)
        order = np.argsort(np.arctan2(corners[:, 1], corners[:, 0]) % (2.0 * np.pi))
        at = np.arctan2(corners[order, 1], corners[order, 0]) % (2.0 * np.pi)
        radius = np.interp(angle, at, np.hypot(*corners[order].T), period=2.0 * np.pi)
        deviation = np.full(count, given.sigma)
    points = radius[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    return Outline(points, deviation, np.zeros(count, np.bool_))
