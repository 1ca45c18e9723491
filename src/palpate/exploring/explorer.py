"""The estimator of pose and outline together: a sum of Gaussians, each of pose, friction and the curve of tip centres.

Where a tip touches, and along which normal, are known in the world, so that the object's motion follows from them and
from friction alone; what was touched adds up to a curve, and a curve that was touched before corrects the motion.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Array
from palpate.config import TrackerSettings
from palpate.exploring.curve import outline_radii
from palpate.exploring.evidence import Contacts, form_evidence, pose_evidence
from palpate.exploring.explored import Explored
from palpate.exploring.felt import Felt, felt, is_felt
from palpate.exploring.observing import observe
from palpate.exploring.pushing import Push, begin_contact, carry, move
from palpate.exploring.rows import CENTER, CURVE, Place, Rows
from palpate.exploring.shoves import propose_shoves
from palpate.exploring.start import rows_about_origin, rows_behind_contact
from palpate.geometry import se2
from palpate.types.measurements import Frame, Measurement, TouchMeasurement
from palpate.types.outline import Outline, Sketch, Unknown
from palpate.types.sensor import SensorProfile


@dataclass(frozen=True)
class _Settings:
    """Settings of the explorer."""

    interval: float = 0.25
    """Time between two observations of the curve [s], in which errors of directions become others."""
    way: float = 5e-4
    """Motion of the contact between two observations [m]; without, nothing new is seen."""
    smoothing: float = 0.1
    """Time over which directions are smoothed for the motion [s]."""
    reach: float = 0.02
    """Least distance of the curve from the outline [m], so that corners become arcs that harmonics can draw; the centre
    of a smaller tip, or of a flat pad's round end, is nearer."""
    points: int = 128
    """Number of points of the outline."""
    shown: int = 20
    """Largest number of rows, the best ones, whose outlines are shown as one."""
    seed: int = 67
    """Seed by which shoves are drawn."""
    patch: float = 0.004
    """Length to each side of a contact that counts as touched [m]."""


_SETTINGS = _Settings()


@dataclass
class _Contact:
    """A contact while it lasts."""

    sensor_pose: Array
    """Sensor pose at the last frame."""
    time: float
    """Time of the last frame [s]."""
    direction: float
    """Smoothed direction in the sensor frame [rad]."""
    along: float
    """Smoothed place of the touched part along y, from the middle of the tip [m]."""
    observed_at: float = -math.inf
    """Time of the last observation of the curve [s]."""
    way: float = math.inf
    """Motion of the sensor's surface since then [m]."""
    measured: int = 0
    """Number of frames since then in which touch measured a direction or a place."""
    behind: float = 0.0
    """Distance that the tip went back along the normal and has not made up for [m]."""


class Explorer:
    """Estimates pose and outline of one object: `step` takes a frame and returns both after it."""

    takes: tuple[type[Measurement], ...] = (TouchMeasurement,)
    """Kinds of measurements that it takes, of which directions tell of the outline; others are left out with a warning
    before they come to it."""

    def __init__(self, outline: Unknown | Sketch, sensor: SensorProfile, settings: TrackerSettings) -> None:
        """Take the stated sizes or the sketch, the sensor, and settings with the noise of this sensor unit.

        Several tips are taken to touch together.
        """
        self._given = outline
        self._sensor = sensor
        self._settings = settings
        calibration = settings.noise.sensor_pose.calibration
        self._set_up_covariance = np.diag(np.square(calibration))
        # That the curve is a sensor's radius from the outline is as wrong for all its points.
        self._reach_variance = max(calibration[:2]) ** 2 + settings.noise.priors.depth[1] ** 2
        self._sunk = sensor.radius - settings.noise.priors.depth[0]  # distance of a contact from the centre of its part
        self._reach = max(self._sunk, _SETTINGS.reach)
        self._farther = self._reach - self._sunk  # of the curve than the centre of the touched part
        self._angles: Array = np.arange(_SETTINGS.points) * np.float64(2.0 * np.pi / _SETTINGS.points)

    def begin(self, pose: Array, covariance: Array) -> None:
        """Begin with the object's pose (3,) and its covariance (3, 3), and the stated sizes or the sketch."""
        self._begin(rows_about_origin(self._given, pose, covariance, self._settings.noise.priors, self._reach))

    def begin_behind_contact(self, pose: Array, covariance: Array) -> None:
        """Begin with a pose that a contact has made, half the least width behind it along x."""
        assert isinstance(self._given, Unknown)
        self._begin(rows_behind_contact(self._given, pose, covariance, self._settings.noise.priors, self._reach))

    def _begin(self, rows: Rows) -> None:
        """Begin with rows that have not been touched."""
        self._rows = rows
        self._generator = np.random.default_rng(_SETTINGS.seed)
        self._touched = np.zeros(_SETTINGS.points, np.bool_)
        self._is_felt = False
        self._contact: _Contact | None = None
        self._contacts = Contacts(np.empty((0, 2)), np.empty(0), np.empty(0, np.int64))
        self._see_outline()

    def end_contact(self, moved: float = 0.0) -> None:
        """Take the object as released; something else may have moved it meanwhile by this much [m]."""
        self._contact = None
        self._rows.covariance[:, CENTER, CENTER] += moved**2 * np.eye(2)
        radius_squared = np.exp(self._rows.mean[:, Place.FRICTION_RADIUS])
        self._rows.covariance[:, Place.YAW, Place.YAW] += moved**2 / radius_squared

    def step(self, frame: Frame, measurements: Sequence[Measurement]) -> Explored:
        """Take a checked frame with all its measurements, by touch and others; its `contact` is True or False."""
        point = None
        normal = None
        if frame.contact:
            point, normal = self._touch(frame, measurements)
        pose, covariance = self._rows.pose()
        covariance = covariance + self._set_up_covariance
        evidence = pose_evidence(covariance, bool(frame.contact), self._settings.tolerance, self._form)
        return Explored(pose, covariance, self._outline, evidence, point, normal, self._friction())

    def _touch(self, frame: Frame, measurements: Sequence[Measurement]) -> tuple[Array, Array]:
        """Take a frame in contact; return the contact point and the outward normal, (2,) each, in the world."""
        last = self._contact
        measured = (0 if last is None else last.measured) + is_felt(measurements)
        self._is_felt |= measured > 0
        now = felt(self._sensor, measurements, self._settings.noise, measured)
        if last is None:
            if self._contacts.count and self._is_felt:  # with contact alone it does harm
                propose_shoves(self._rows, self._generator)
            begin_contact(self._rows)
            self._contacts = replace(self._contacts, count=self._contacts.count + 1)
            contact = _Contact(frame.sensor_pose, frame.time, now.direction or 0.0, now.along)
        else:
            contact = self._pushed(last, frame, now)
        contact.measured = measured
        self._contact = contact
        normal = np.exp(1j * (frame.sensor_pose[2] + contact.direction))
        point = self._middle(frame.sensor_pose, contact.along) + self._sunk * normal
        if frame.time - contact.observed_at >= _SETTINGS.interval and contact.way >= _SETTINGS.way:
            self._observe(frame, contact, now)
        return _vector(point), -_vector(normal)

    def _observe(self, frame: Frame, contact: _Contact, felt_now: Felt) -> None:
        """Take a contact as a place and a direction of the curve, once for each tip."""
        seen = contact.direction if felt_now.direction is None else felt_now.direction
        direction = frame.sensor_pose[2] + seen
        inward = np.exp(1j * direction)
        of_place = felt_now.along_deviation / self._reach  # a corner turns the direction by as much
        deviation = math.hypot(felt_now.deviation, of_place)
        for tip in se2.transform(frame.sensor_pose, self._parts(felt_now.along)):
            center = complex(tip[0], tip[1]) - self._farther * inward
            observe(self._rows, center, direction, deviation)
            self._mark_touched(center + self._reach * inward)
        contact.observed_at = frame.time
        contact.way = 0.0
        contact.measured = 0
        self._see_outline()

    def _pushed(self, last: _Contact, frame: Frame, felt_now: Felt) -> _Contact:
        """Move the object with the sensor since the last frame; return the contact now."""
        weight = -math.expm1(-(frame.time - last.time) / _SETTINGS.smoothing)
        direction = last.direction
        if felt_now.direction is not None:
            direction += weight * math.remainder(felt_now.direction - direction, 2.0 * math.pi)
        along = last.along + weight * (felt_now.along - last.along)
        before = self._middle(last.sensor_pose, along)
        now = self._middle(frame.sensor_pose, along)
        turn = math.remainder(frame.sensor_pose[2] - last.sensor_pose[2], 2.0 * math.pi)
        normal = complex(np.exp(1j * (frame.sensor_pose[2] + direction)))
        motion = now - before + 1j * turn * self._sunk * normal
        point = before + self._sunk * normal
        if len(self._sensor.tips) > 1:
            carry(self._rows, Push(point, normal, motion), turn)
            behind = 0.0
        else:
            pushing, behind = _pushing_part(motion, normal, last.behind)
            move(self._rows, Push(point, normal, pushing))
        way = last.way + abs(motion)
        return replace(
            last,
            sensor_pose=frame.sensor_pose,
            time=frame.time,
            direction=direction,
            along=along,
            way=way,
            behind=behind,
        )

    def _parts(self, along: float) -> Array:
        """Return the centre of each tip's touched part, (tips, 2) [m] in the sensor frame, by its place along y."""
        return self._sensor.centers + np.array((0.0, along))

    def _middle(self, sensor_pose: Array, along: float) -> complex:
        """Return the middle of all tips' touched parts in the world [m], with a sensor pose (3,)."""
        x, y = se2.transform(sensor_pose, self._parts(along)).mean(axis=0).tolist()
        return complex(x, y)

    def _mark_touched(self, point: complex) -> None:
        """Mark the points of the outline about a contact point in the world as touched."""
        pose, covariance = self._rows.pose()
        in_object = (point - complex(pose[0], pose[1])) * np.exp(-1j * pose[2])
        wide = np.arctan2(_SETTINGS.patch, abs(in_object))
        apart = np.angle(np.exp(1j * (self._angles - np.angle(in_object))))
        self._touched |= np.abs(apart) <= max(wide, np.pi / _SETTINGS.points)
        variance = covariance[0, 0] + covariance[1, 1] + covariance[2, 2] * abs(in_object) ** 2
        points = np.vstack((self._contacts.points, _vector(in_object)))
        deviations = np.append(self._contacts.deviation, math.sqrt(variance))
        numbers = np.append(self._contacts.number, self._contacts.count)
        self._contacts = replace(self._contacts, points=points, deviation=deviations, number=numbers)

    def _see_outline(self) -> None:
        """Take outline and evidence from the rows as they are now."""
        length, _ = self._settings.tolerance
        self._outline = self._outline_of_rows()
        contacts = replace(self._contacts, shoved=float(self._rows.weight @ self._rows.shoves))
        has_directions = self._is_felt or len(self._sensor.tips) > 1  # two that touch at once show one
        self._form = form_evidence(self._outline, contacts, self._given, length, has_directions)

    def _outline_of_rows(self) -> Outline:
        """Return the outline of the best rows together."""
        weight = self._rows.weight
        best = np.argsort(-weight, kind="stable")[: _SETTINGS.shown]
        share = weight[best] / weight[best].sum()
        rows = self._rows
        curve = rows.mean[best][:, CURVE]
        radii, deviations = outline_radii(
            rows.base, curve, rows.covariance[best][:, CURVE, CURVE], rows.pole[best], self._reach, self._angles
        )
        radius = share @ radii
        variance = share @ (np.square(radii - radius) + np.square(deviations)) + self._reach_variance
        points = radius[:, None] * np.column_stack((np.cos(self._angles), np.sin(self._angles)))
        return Outline(points, np.sqrt(variance), self._touched.copy())

    def _friction(self) -> tuple[float, float]:
        """Return the coefficient of friction between sensor and object with its deviation."""
        weight = self._rows.weight
        grips = self._rows.mean[:, Place.GRIP]
        mean = float(weight @ grips)
        variance = float(weight @ (np.square(grips - mean) + self._rows.covariance[:, Place.GRIP, Place.GRIP]))
        return math.exp(mean), math.exp(mean) * math.sqrt(variance)


def _pushing_part(motion: complex, normal: complex, behind: float) -> tuple[complex, float]:
    """Return the part of a tip's motion that pushes, and how far the tip is behind the object then [m].

    A tip that was behind makes up for that first. Else the noise of a sensor that rests would push the object, as a
    step ahead moves it and a step back does not.
    """
    forward = (motion * normal.conjugate()).real
    ahead = forward - behind
    if ahead <= 0.0:
        return 0j, -ahead
    return motion * (ahead / forward), 0.0


def _vector(value: complex) -> Array:
    """Return a complex number as a vector (2,)."""
    return np.array((value.real, value.imag))
