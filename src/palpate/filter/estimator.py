"""Contacts and rests of one object, one after the other: each begins with what the one before left known."""

import logging
import math
from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings, Normal
from palpate.errors import EstimationError
from palpate.filter.belief import Prior
from palpate.filter.consistency import REASONS, Diagnosis, Status
from palpate.filter.contradiction import measured_poses
from palpate.filter.object_path import ObjectPath
from palpate.filter.rest import measured_at_rest
from palpate.filter.touched import Touched, touched
from palpate.filter.untold_yaw import put_aside, put_back
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factor_list import make_factors
from palpate.graph.factors.factor import Step
from palpate.graph.fixed_lag import FixedLag, add_to_all
from palpate.graph.smoother import Smoother, SmootherName, make_smoother
from palpate.graph.values import Knock
from palpate.types.measurements import Measurement, ObjectPose

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]


class Estimator:
    """Estimates the pose of one object from sensor poses and measurements, frame by frame."""

    def __init__(
        self,
        model: ContactModel,
        settings: NoiseSettings,
        smoother: SmootherName,
        first_pose: Array,
        first_deviation: Array,
    ) -> None:
        """Take what touches what, how much is believed, how graphs are solved, and the first world_T_object (3,).

        Its standard deviations (3,) [m, m, rad] are along the axes of the object.
        """
        self._model, self._settings = model, settings
        self._factors = make_factors(settings, model)
        self.begin_contact = make_smoother(smoother, settings, model)
        """What makes the graph of a contact."""
        self._diagnosis = Diagnosis(model, settings.contact.deviation, settings.sensor_pose.calibration)
        deviation = np.concatenate([first_deviation, settings.priors.deviation])
        self.known = Prior(first_pose, settings.priors.mean, np.diag(np.square(deviation)))
        """What is known of the object at the last frame, but for the yaw of a round one; see `untold_yaw`."""
        self._untold_yaw = 0.0  # [rad^2] variance that was put aside
        self.status: Status = "resting"
        """What to make of it."""
        self._contact: Smoother | None = None
        self._sensor_pose: Array | None = None  # at the last frame
        self._start: Prior | None = None  # what the next contact begins with, where it is not what was known before
        self._touched: tuple[Array, float] | None = None  # the sensor's pose and the time of the last frame of contact
        self._resting_since: float | None = None  # [s]
        self._path = ObjectPath()

    @property
    def _whole(self) -> Prior:
        """What is known of the object with the yaw that was put aside."""
        return put_back(self.known, self._untold_yaw)

    @property
    def in_contact(self) -> bool:
        """Whether the object is being touched."""
        return self._contact is not None

    @property
    def is_displaced(self) -> bool:
        """Whether the object must have moved while nothing touched it, and was not found since."""
        return self._diagnosis.displaced

    @property
    def has_contradicting_poses(self) -> bool:
        """Whether measured poses of the object contradict what else is known of it."""
        return bool(self._diagnosis.contradiction)

    @property
    def reason(self) -> str:
        """Why the status is what it is, in words; nothing where all is well."""
        return self._diagnosis.contradiction or REASONS[self.status]

    @property
    def covariance(self) -> Array:
        """Covariance (3, 3) of the object's pose, tangent space at the estimate (right, body frame)."""
        doubt = 0.0 if self.in_contact else self._diagnosis.displacement_covariance()
        return self._diagnosis.covariance(self._whole) + doubt

    @property
    def touched(self) -> Touched | None:
        """Where the sensor touches the object; None between contacts."""
        if self._contact is None:
            return None
        angle = self._contact.pushing_angle() if isinstance(self._contact, FixedLag) else math.nan
        return touched(self._model, self._contact.belief(), angle)

    @property
    def touched_for(self) -> float:
        """Time from the first frame of the current graph to the last one [s]; 0 between contacts."""
        return self._path.lasts

    def gap(self, sensor_pose: Array) -> tuple[float, float]:
        """Return how far from the object a sensor is that stands here (3,), and the standard deviation of that [m]."""
        return self._diagnosis.gap(self.known, sensor_pose)

    def path(self) -> Array:
        """Return all object poses so far (N, 3), each as all later measurements in its contact leave it."""
        settled = self._path.settled
        return settled if self._contact is None else np.concatenate([settled, _object_path(self._contact)])

    def rest(self, sensor_pose: Array, measurements: Sequence[Measurement], time: float) -> None:
        """Take a frame in which nothing touches the object: it stays where it is, unless measurements say otherwise.

        Raises EstimationError, with nothing changed, where they leave no solution.
        """
        if measurements:
            self._measure_at_rest(measurements, time)
        if self._resting_since is None:
            self._resting_since = time
        self._path.stayed(self.known.pose)
        self._sensor_pose = sensor_pose
        self._diagnosis.see_rest(self.known, sensor_pose)
        if self._touched is not None:
            touched_from, last = self._touched
            self._diagnosis.see_after_touch(self.known, touched_from, sensor_pose, time - last)
        self.status = self._diagnosis.at_rest(self._whole)

    def knocked(self, steps: int, slide: Normal, grip: Normal | None = None) -> "Estimator":
        """Return a copy in which something else may have moved the object in the last steps; see Window.

        `grip` is what is to be believed of GRIP instead of its prior, and more certain.
        """
        assert isinstance(self._contact, FixedLag)
        other = self.copied()
        grips = None if grip is None else (self._settings.priors.grip, grip)
        other._contact = contact = self._contact.knocked(steps, slide, grips)
        other.known = contact.belief().prior
        other._diagnosis.forget_errors()
        return other

    def started(self, prior: Prior) -> "Estimator":
        """Return a copy that begins its next contact with something else known."""
        other = self.copied()
        other._start = prior
        return other

    def copied(self) -> "Estimator":
        """Return one that knows the same and may go another way."""
        other = copy(self)
        other._diagnosis = copy(self._diagnosis)
        other._path = self._path.copied()
        return other

    def mean_square(self, name: str, steps: int) -> float:
        """Return how badly a factor fits the last steps of the contact; see Window."""
        return self._contact.mean_square(name, steps) if isinstance(self._contact, FixedLag) else 0.0

    def costs(self) -> Array:
        """Return what each step of the contact costs; see Window."""
        return self._contact.costs() if isinstance(self._contact, FixedLag) else np.empty((0, 2))

    def see_first_touch(self, sensor_pose: Array, measurements: Sequence[Measurement]) -> Prior:
        """See a contact begin with the sensor here (3,) and touch saying this; return what is known of the object then.

        It was displaced where it is touched where it should not be.
        """
        self._diagnosis.see_first_touch(self.known, sensor_pose, measurements)
        diagnosis = self._diagnosis
        return self.unmoved.loosened(diagnosis.displacement_covariance() + diagnosis.contradiction_covariance())

    @property
    def unmoved(self) -> Prior:
        """What is known of the object if nothing moved it since it was last touched."""
        return self.known.loosened(np.diag(np.square(self._settings.first_pose.rest)))

    def touch(self, sensor_pose: Array, measurements: Sequence[Measurement], time: float) -> None:
        """Take a frame of contact, the first of one or the next. Raises EstimationError where the graph is lost."""
        if self._contact is None:
            known = self.see_first_touch(sensor_pose, measurements) if self._start is None else self._start
            known, self._untold_yaw, self._start = put_back(known, self._untold_yaw), 0.0, None
            if not any(isinstance(one, ObjectPose) for one in measurements):
                known, self._untold_yaw = put_aside(known, self._model)
            self.known = known
            self._contact = self.begin_contact(self.known, sensor_pose, measurements, time)
        else:
            self._contact.add(sensor_pose, measurements, time)
        self._take_touch(self._contact, sensor_pose, measurements, time)

    def _take_touch(
        self,
        contact: Smoother,
        sensor_pose: Array,
        measurements: Sequence[Measurement],
        time: float,
        knocked: bool = False,
    ) -> None:
        is_measured = any(isinstance(one, ObjectPose) for one in measurements)
        if is_measured:
            recent = self._path.recent
            step = Step(sensor_pose, self._sensor_pose, measurements, [*(then for then, _ in recent), time])
            measured = measured_poses(step, [*(pose for _, pose in recent), self.known.pose])
            self._diagnosis.see_object_poses(self.known, measured, step.moved)
            is_measured = bool(measured)
        self._believe(contact, sensor_pose, time, knocked)
        self._diagnosis.see_touched_outline(self.known, sensor_pose, is_measured)
        self._touched = sensor_pose, time
        self.status = self._diagnosis.in_contact(self._whole)

    def begin_anew(
        self, sensor_pose: Array, measurements: Sequence[Measurement], time: float, error: EstimationError
    ) -> None:
        """Go on with a new graph from the last pose, where the old one could not be solved.

        Raises EstimationError where that fails, too; the contact is then over.
        """
        reason = (
            f"frame at {time:.3f} s: {error}; the likely reason is a motion that pushing, contact and touch "
            "together leave undetermined, or a sensor pose far from the object"
        )
        logger.warning("%s; starting a new graph from the last pose", reason)
        self._settle(self._path.online)
        before = sensor_pose if self._sensor_pose is None else self._sensor_pose
        pushed = float(np.hypot(*(sensor_pose - before)[:2]))
        self.known = self.known.loosened(self._diagnosis.covariance_of_motion(pushed))
        try:
            self._contact = self.begin_contact(self.known, sensor_pose, measurements, time)
        except EstimationError:
            raise EstimationError(reason) from error
        self._believe(self._contact, sensor_pose, time)
        self.status = "indeterminate"

    def covariance_of_motion(self, length: float) -> Array:
        """Return the covariance (3, 3) of an unknown motion of the object of this size [m]."""
        return self._diagnosis.covariance_of_motion(length)

    def stay(self, frames: int) -> None:
        """Let the object rest for so many frames of which nothing else was believed."""
        self._path.stayed(self.known.pose, frames)

    def end_contact(self, moved: float = 0.0) -> None:
        """The sensor let go of the object, which something else may have moved by so much meanwhile [m]."""
        if self._contact is not None:
            self._settle(_object_path(self._contact))
            self._diagnosis.forget_displacement()
            moved_by = self._diagnosis.covariance_of_motion(moved)
            self.known = self.known.at_next_contact(self._settings.priors).loosened(moved_by)

    def _settle(self, poses: Array) -> None:
        """Keep the poses (N, 3) of the current graph, which is over."""
        self._path.settle(poses)
        self._diagnosis.forget_errors()
        self._contact = self._resting_since = None

    def _believe(self, contact: Smoother, sensor_pose: Array, time: float, knocked: bool = False) -> None:
        self.known = contact.belief().prior
        if not knocked:
            self._diagnosis.see_errors(contact.last_errors())
        self._path.estimated(time, self.known.pose)
        self._sensor_pose = sensor_pose

    def _measure_at_rest(self, measurements: Sequence[Measurement], time: float) -> None:
        since = time if self._resting_since is None else self._resting_since
        whole = self._whole
        prior = whole.loosened(self._diagnosis.displacement_covariance())
        doubted = prior.loosened(self._diagnosis.contradiction_covariance())
        known, tells_pose = measured_at_rest(whole, doubted, measurements, self._factors, self._model, since, time)
        step = Step(prior.pose, None, measurements, [since, time], at_rest=True)
        self._diagnosis.see_object_poses(prior, measured_poses(step, [prior.pose] * 2), moved=0.0)
        self.known, self._untold_yaw = known, 0.0
        if tells_pose:
            self._diagnosis.forget_displacement()
            self._touched = None  # it may have been found elsewhere


def touch_on(
    estimators: Sequence[Estimator],
    sensor_pose: Array,
    measurements: Sequence[Measurement],
    time: float,
    knocks: Sequence[Knock | None],
) -> list[bool]:
    """Let estimators of one contact take its next frame, their windows in one call; return which graphs are solved.

    `knocks` are what each thinks may have moved the object since the last frame besides. Raises EstimationError where
    no graph is solved.
    """
    contacts = [one._contact for one in estimators if isinstance(one._contact, FixedLag)]
    add_to_all(contacts, sensor_pose, measurements, time, knocks)
    is_solved = [contact.is_solved for contact in contacts]
    for one, contact, knock, solved in zip(estimators, contacts, knocks, is_solved, strict=True):
        if solved:
            one._take_touch(contact, sensor_pose, measurements, time, knock is not None)
    return is_solved


def _object_path(contact: Smoother) -> Array:
    g, e = contact.path()
    return se2.compose(e, se2.inverse(g))
