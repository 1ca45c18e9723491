"""Factors: the kinds of terms of the objective, and the terms that arrive with each step.

A term belongs to one step. Those of pushing depend on that step and the one before, all others on their step alone; any
may depend on the shared variables. A new factor is a kind and its terms here, a kernel in `measured` or `pushing`, and
a line in `gauss_newton.linearise`.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings
from palpate.graph.compiled import Array, Integers
from palpate.graph.contact_geometry import CONTACT_GEOMETRY, ContactModel
from palpate.graph.own_measurements import is_available
from palpate.graph.variables import LAST_SIZE, OBJECT_SIZE, SHARED_SIZE, WIDTH
from palpate.types.measurements import ContactDirection, ContactPlace, Measurement, ObjectPose, OwnMeasurement, Turn

logger = logging.getLogger(__name__)
M = TypeVar("M", bound=Measurement)
_SLACK = 0.02  # [s] tolerance on a measurement's time if there is only one step

_PUSHING, _MEASURED = "sticking balance friction_cone", "sensor_pose contact direction place turn object_pose own"
NAMES = (*_PUSHING.split(), "first_pose", *_MEASURED.split())
"""Names of the factors. Those of pushing come first: they hold only while nothing but the sensor moves the object."""
STICKING, BALANCE, FRICTION_CONE, FIRST_POSE, SENSOR_POSE, CONTACT, DIRECTION, PLACE, TURN, OBJECT_POSE, OWN = range(
    len(NAMES)
)
MOST_ROWS = 3 + OBJECT_SIZE
"""Largest number of residual rows of a term."""


def _record(formats: dict[str, Any]) -> np.dtype:
    """Return a structured type for compiled code."""
    return np.dtype(list(formats.items()), align=True)


TERM = _record(
    {"kind": "i8", "step": "i8", "index": "i8", "value": "f8", "variance": "f8", "from_touch": "?"}
    | {"pose": "3f8", "root": "(3,3)f8"}
)
"""A term.

- kind: place of its factor in NAMES.
- step: its step in the window or, in a term that arrives, relative to the new step.
- index: place among own measurements.
- value, variance: measured angle [rad] or place [m]; of pushing, distance of the sensor from the step before [m].
- from_touch: True if the value was read from touch images, which may be mirrored.
- pose, root: measured pose of sensor or object, and the whitening matrix of its covariance.
"""
STEP = _record(
    {"g": "3f8", "e": "3f8", "at_g": "3f8", "at_e": "3f8", "object": "3f8"}
    | {"turn_g": "c16", "turn_e": "c16", "touch": CONTACT_GEOMETRY, "force_angle": "f8"}
    | {"slide": "f8", "spread": "f8", "cost": "2f8", "squares": f"{len(NAMES)}f8"}
)
"""One step of a row of the window.

- g, e, object: sensor pose in the object frame, sensor and object in the world [m, m, rad].
- at_g, at_e: values at which the terms were linearised.
- turn_g, turn_e: rotations exp(i theta).
- force_angle: angle of the pushing force from the outline's inward normal, counter-clockwise [rad].
- slide, spread: slide of the object over the sensor by something else in this step, mean and standard deviation [m],
  counter-clockwise along the outline. The latter is 0 in a step without disturbance.
- cost: cost of measurements and of pushing.
- squares: squared errors of each factor, without kernels [variances].
"""
ROW = _record(
    {"shared": f"{SHARED_SIZE}f8", "at_shared": f"{SHARED_SIZE}f8", "sign": "f8"}
    | {"first_pose": "3f8", "first_values": f"{OBJECT_SIZE}f8", "first_root": f"({MOST_ROWS},{MOST_ROWS})f8"}
    | {"past_information": f"({LAST_SIZE},{LAST_SIZE})f8", "past_gradient": f"{LAST_SIZE}f8"}
    | {"past_g": "3f8", "past_e": "3f8", "past_shared": f"{SHARED_SIZE}f8"}
    | {"next_information": f"({LAST_SIZE},{LAST_SIZE})f8", "next_gradient": f"{LAST_SIZE}f8"}
    | {"covariance": f"({MOST_ROWS},{MOST_ROWS})f8", "errors": "3f8", "change": "f8", "is_lost": "?"}
)
"""All else in a row of the window.

- shared, at_shared: shared variables, and values at which the terms were linearised.
- sign: -1.0 if touch images are taken as mirrored, else 1.0.
- first_...: belief about the object at the beginning: pose, variables, and whitening matrix of their joint covariance.
- past_...: Gaussian on the oldest step and the shared variables, which is what older steps say: information matrix,
  negative gradient, and the values at which it is that.
- next_...: the same once the oldest step has left, at its linearisation; NaN if it is indeterminate.
- covariance: joint covariance of the object's last pose and its variables.
- errors: errors of the last step's sticking and balance, without kernels [standard deviations].
- change: largest change of a pose in the last Gauss-Newton step [m, rad].
- is_lost: True if there is no solution.
"""
LINEAR = _record(
    {"residual": f"{MOST_ROWS}f8", "jacobian": f"({MOST_ROWS},{WIDTH})f8"}
    | {"information": f"{MOST_ROWS}f8", "weight": f"{MOST_ROWS}f8"}
)
"""Rows of one linearised term.

- jacobian: by right (body-frame) perturbations of g and e of the step before and of this step, and by the shared
  variables; 0 before a kernel writes to it.
- information, weight: inverse variances, without and with the weight that the robust kernel leaves.
"""


@dataclass(frozen=True, eq=False)
class Step:
    """Input of one step of a contact."""

    sensor_pose: Array
    """Measured world_T_sensor, (3,) [m, m, rad]."""
    before: Array | None
    """Sensor pose of the step before, (3,); None at the first step of a contact."""
    measurements: Sequence[Measurement]
    """Measurements from touch and other sources."""
    times: Sequence[float]
    """Times of the steps in the window, this one last [s]."""
    at_rest: bool = False
    """True if nothing touches the object; its pose is then the only variable of a step."""
    from_touch: int = 0
    """Number of leading measurements that were read from touch images, which may be mirrored."""

    @cached_property
    def moved(self) -> float:
        """Distance of the sensor from the step before [m]."""
        if self.before is None:
            return 0.0
        return math.hypot(self.sensor_pose[0] - self.before[0], self.sensor_pose[1] - self.before[1])

    def timed(self, kind: type[M]) -> list[M]:
        """Return the measurements of a kind that carries a time; warns of those outside the window and omits them."""
        found = []
        for one in self.measurements:
            if isinstance(one, kind) and self.is_in_window(one):
                found.append(one)
            elif isinstance(one, kind):
                logger.warning(
                    "frame at %.3f s: measurement %s has time %s s, which is not between %.3f s and now; it is left "
                    "out",
                    self.times[-1],
                    kind.__name__,
                    getattr(one, "time", None),
                    self.times[0],
                )
        return found

    def own(self) -> list[OwnMeasurement | None]:
        """Return the measurements with their own residual whose variables the step has; warns of the others."""
        return [one for one in self.timed(OwnMeasurement) if is_available(one, self.at_rest, self.times[-1])]

    def is_in_window(self, measurement: Measurement) -> bool:
        """Return True if the time of a measurement, if it has one, is within the window."""
        time, times = getattr(measurement, "time", None), self.times
        single = self.at_rest or len(times) < 2
        slack = _SLACK if single else 0.5 * (times[-1] - times[0]) / (len(times) - 1)
        return time is None or times[0] - slack <= time <= times[-1] + slack

    def nearest(self, measurements: Sequence[Any]) -> Integers:
        """Return the steps (T,) nearest to the times of measurements; 0 is this step, -1 the one before."""
        last, times = len(self.times) - 1, np.asarray(self.times)
        steps = [0 if one.time is None else int(np.argmin(np.abs(times - one.time))) - last for one in measurements]
        return np.array(steps, np.int64)


@dataclass(frozen=True, eq=False)
class Factors:
    """All factors, with their settings."""

    settings: np.void
    """Groups of NoiseSettings for kernels, and friction radius, friction center and span of the contact model."""
    of_pushing: tuple[int, ...]
    """Kinds of terms on each step but the first."""

    def terms(self, step: Step) -> tuple[NDArray[np.void], list[OwnMeasurement | None]]:
        """Return the terms (T,) that arrive with a step, those of own measurements last, and these measurements."""
        found: list[tuple[int, float, float, bool]] = [(SENSOR_POSE, 0.0, 0.0, False), (CONTACT, 0.0, 0.0, False)]
        kinds = (FIRST_POSE,) if step.before is None else self.of_pushing
        found += [(kind, step.moved, 0.0, False) for kind in kinds]
        for index, one in enumerate(step.measurements):
            from_touch = index < step.from_touch
            if isinstance(one, ContactDirection):
                found.append((DIRECTION, one.angle, one.variance, from_touch))
            elif isinstance(one, ContactPlace):
                found.append((PLACE, one.place, one.variance, from_touch))
            elif isinstance(one, Turn):
                found.append((TURN, one.angle, one.variance, from_touch))
        poses, own = step.timed(ObjectPose), step.own()
        first_pose, first_own = len(found), len(found) + len(poses)
        found += [(OBJECT_POSE, 0.0, 0.0, False)] * len(poses) + [(OWN, 0.0, 0.0, False)] * len(own)
        terms = np.zeros(len(found), TERM)
        terms["kind"], terms["value"], terms["variance"], terms["from_touch"] = zip(*found, strict=True)
        terms["pose"][0] = step.sensor_pose
        if poses:
            of_poses = slice(first_pose, first_own)
            terms["pose"][of_poses] = [one.pose for one in poses]
            covariances = np.array([one.covariance for one in poses])
            terms["root"][of_poses] = np.linalg.inv(np.linalg.cholesky(covariances))
        if poses or own:
            terms["step"][first_pose:] = step.nearest([*poses, *own])
        return terms, own


def make_factors(settings: NoiseSettings, model: ContactModel) -> Factors:
    """Return all factors with these settings."""
    groups = {one.name: getattr(settings, one.name) for one in fields(settings) if one.name != "priors"}
    parts: list[Any] = [("friction_radius", np.float64), ("friction_center", np.complex128), ("span", np.float64)]
    values: list[Any] = [model.friction_radius, model.friction_center, model.span]
    for name, group in groups.items():
        numbers = {one.name: getattr(group, one.name) for one in fields(group)}
        parts.append((name, [(key, np.float64, np.shape(number)) for key, number in numbers.items()]))
        # Without a kernel, its scale is infinite.
        values.append(tuple(math.inf if number is None else number for number in numbers.values()))
    of_pushing = (STICKING, BALANCE) if settings.friction_cone.share is None else (STICKING, BALANCE, FRICTION_CONE)
    return Factors(np.array([tuple(values)], np.dtype(parts, align=True))[0], of_pushing)
