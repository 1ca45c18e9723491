"""Factors: their names, the records that their kernels read and write, and the terms of measurements.

Factors of pushing depend on a step and the one before, all others on their step alone; any may depend on the shared
variables. A new factor is a name here, with the terms of its measurements in `terms_of`, a kernel in `measured` or
`pushing`, and a line in `gauss_newton.of_step` or `of_term`.
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
from palpate.graph.variables import LAST_SIZE, OBJECT_SIZE, SHARED_SIZE, STEP_SIZE, WIDTH
from palpate.types.measurements import ContactDirection, ContactPlace, Measurement, ObjectPose, OwnMeasurement, Turn

logger = logging.getLogger(__name__)
M = TypeVar("M", bound=Measurement)
_SLACK = 0.02  # [s] tolerance on a measurement's time if there is only one step
_NO_POSE = 12 * (0.0,)  # pose and root of a term that has none

_PUSHING, _OTHERS = "sticking balance friction_cone", "first_pose sensor_pose contact direction place turn object_pose"
NAMES = (*_PUSHING.split(), *_OTHERS.split(), "own")
"""Names of the factors. Those of pushing come first: they hold only while nothing but the sensor moves the object.
Every step but the first has those of pushing, every step those of sensor pose and contact, and the first step of a
contact that of the first pose; the others are of measurements that arrive."""
STICKING, BALANCE, FRICTION_CONE, FIRST_POSE, SENSOR_POSE, CONTACT, DIRECTION, PLACE, TURN, OBJECT_POSE, OWN = range(
    len(NAMES)
)
MOST_ROWS = 3 + OBJECT_SIZE
"""Largest number of residual rows of a factor."""


def _record(formats: dict[str, Any]) -> np.dtype:
    """Return a structured type for compiled code."""
    return np.dtype(list(formats.items()), align=True)


TERM = _record(
    dict.fromkeys(("step", "kind", "index", "value", "variance", "from_touch"), "f8")
    | {"pose": "3f8", "root": "(3,3)f8"}
)
"""The term of a measurement: a row (TERM_SIZE,) of numbers.

- step: its step, counted from the beginning of the contact.
- kind: place of its factor in NAMES.
- index: place among own measurements.
- value, variance: measured angle [rad] or place [m].
- from_touch: 1 if the value was read from touch images, which may be mirrored.
- pose, root: measured pose of the object, and the whitening matrix of its covariance.
"""
TERM_SIZE = TERM.itemsize // 8
STEP = _record(
    {"g": "3f8", "e": "3f8", "object": "3f8", "measured": "3f8", "moved": "f8"}
    | {"turn_g": "c16", "turn_e": "c16", "touch": CONTACT_GEOMETRY, "force_angle": "f8"}
    | {"slide": "f8", "spread": "f8", "cost": "2f8", "squares": f"{len(NAMES)}f8"}
    | {"root": f"({STEP_SIZE},{WIDTH})f8", "y": f"{STEP_SIZE}f8"}
)
"""One step of a row of the window.

- g, e, object: sensor pose in the object frame, sensor and object in the world [m, m, rad].
- measured, moved: measured sensor pose, and its distance from that of the step before [m].
- turn_g, turn_e: rotations exp(i theta).
- force_angle: angle of the pushing force from the outline's inward normal, counter-clockwise [rad].
- slide, spread: slide of the object over the sensor by something else in this step, mean and standard deviation [m],
  counter-clockwise along the outline. The latter is 0 in a step without disturbance.
- cost: cost of measurements and of pushing.
- squares: squared errors of each factor, without kernels [variances].
- root, y: what is left of the step once it is eliminated; see `block_tridiagonal.eliminate`.
"""
PAST = _record(
    {"information": f"({LAST_SIZE},{LAST_SIZE})f8", "gradient": f"{LAST_SIZE}f8"}
    | {"g": "3f8", "e": "3f8", "shared": f"{SHARED_SIZE}f8"}
)
"""A Gaussian on the oldest step and the shared variables, which is what older steps say: information matrix, negative
gradient, and the values at which it is that. The information is NaN if it is indeterminate."""
ROW = _record(
    {"shared": f"{SHARED_SIZE}f8", "sign": "f8"}
    | {"first_pose": "3f8", "first_values": f"{OBJECT_SIZE}f8", "first_root": f"({MOST_ROWS},{MOST_ROWS})f8"}
    | {"past": PAST, "next_past": PAST}
    | {"covariance": f"({MOST_ROWS},{MOST_ROWS})f8", "errors": "3f8", "change": "f8"}
    | {"last_root": f"({LAST_SIZE},{WIDTH})f8", "last_y": f"{LAST_SIZE}f8", "is_lost": "?"}
)
"""All else in a row of the window.

- shared: shared variables.
- sign: -1.0 if touch images are taken as mirrored, else 1.0.
- first_...: belief about the object at the beginning: pose, variables, and whitening matrix of their joint covariance.
- past, next_past: what older steps say, and what they will say once the oldest step has left.
- covariance: joint covariance of the object's last pose and its variables.
- errors: errors of the last step's sticking and balance, without kernels [standard deviations].
- change: largest change of a pose in the last Gauss-Newton step [m, rad].
- last_root, last_y: what is left of the last step and the shared variables once they are eliminated.
- is_lost: True if there is no solution.
"""
LINEAR = _record(
    {"residual": f"{MOST_ROWS}f8", "jacobian": f"({MOST_ROWS},{WIDTH})f8"}
    | {"information": f"{MOST_ROWS}f8", "weight": f"{MOST_ROWS}f8", "columns": f"{WIDTH}i8"}
    | {"error": "3f8", "by_pose": "(3,3)f8", "adjoint": "(3,3)f8"}
)
"""Linearised rows of a factor.

- jacobian: by right (body-frame) perturbations of g and e of the step before and of this step, and by the shared
  variables; 0 before a kernel writes to it.
- information, weight: inverse variances, without and with the weight that the robust kernel leaves.
- columns, error, by_pose, adjoint: room for computing.
"""
WORK = _record(
    {"linear": LINEAR, "system": f"({WIDTH},{WIDTH})f8", "gradient": f"{WIDTH}f8", "change": f"{WIDTH}f8"}
    | {"next_system": f"({WIDTH},{WIDTH})f8", "next_gradient": f"{WIDTH}f8", "next_root": f"({STEP_SIZE},{WIDTH})f8"}
    | {
        "next_y": f"{STEP_SIZE}f8",
        "inverse": f"({LAST_SIZE},{LAST_SIZE})f8",
        "covariance": f"({LAST_SIZE},{LAST_SIZE})f8",
    }
)
"""Room for computing one row of a window; arrays made in compiled code are slow to compile."""


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


def terms_of(step: Step, number: int) -> tuple[Array, list[OwnMeasurement | None]]:
    """Return the terms (T, TERM_SIZE) that arrive with a step of this number, and the own measurements among them.

    They are in the order of their steps and kinds.
    """
    found: list[tuple[float, ...]] = []
    for index, one in enumerate(step.measurements):
        from_touch = index < step.from_touch
        if isinstance(one, ContactDirection):
            found.append((number, DIRECTION, 0, one.angle, one.variance, from_touch, *_NO_POSE))
        elif isinstance(one, ContactPlace):
            found.append((number, PLACE, 0, one.place, one.variance, from_touch, *_NO_POSE))
        elif isinstance(one, Turn):
            found.append((number, TURN, 0, one.angle, one.variance, from_touch, *_NO_POSE))
    poses, own = step.timed(ObjectPose), step.own()
    for one, ago in zip(poses, step.nearest(poses), strict=True):
        root = np.linalg.inv(np.linalg.cholesky(one.covariance))
        found.append((number + ago, OBJECT_POSE, 0, 0.0, 0.0, False, *one.pose.tolist(), *root.ravel().tolist()))
    for index, ago in enumerate(step.nearest(own)):
        found.append((number + ago, OWN, index, 0.0, 0.0, False, *_NO_POSE))
    found.sort(key=lambda term: term[:2])
    return np.array(found, np.float64).reshape(-1, TERM_SIZE), own


def make_factors(settings: NoiseSettings, model: ContactModel) -> NDArray[np.void]:
    """Return what kernels need (1,): groups of settings, and friction radius and centre and span of the model."""
    groups = {one.name: getattr(settings, one.name) for one in fields(settings) if one.name != "priors"}
    parts: list[Any] = [("friction_radius", np.float64), ("friction_center", np.complex128), ("span", np.float64)]
    values: list[Any] = [model.friction_radius, model.friction_center, model.span]
    for name, group in groups.items():
        numbers = {one.name: getattr(group, one.name) for one in fields(group)}
        parts.append((name, [(key, np.float64, np.shape(number)) for key, number in numbers.items()]))
        # Without a kernel, its scale is infinite.
        values.append(tuple(math.inf if number is None else number for number in numbers.values()))
    return np.array([tuple(values)], np.dtype(parts, align=True))
