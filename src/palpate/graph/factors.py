"""Factors: their names, the records that their kernels read and write, and the terms of measurements.

Factors of pushing depend on a step and the one before, all others on their step alone; any may depend on the shared
variables. A new factor is a name here, with the terms of its measurements in `terms_of`, a kernel in `measured` or
`pushing`, and a line in `gauss_newton.of_step` or `of_term`.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.config import SLACK, NoiseSettings
from palpate.graph.belief import Belief
from palpate.graph.contact_geometry import CONTACT_GEOMETRY, ContactModel
from palpate.graph.variables import (
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    LAST_SIZE,
    OBJECT_SIZE,
    SHARED_SIZE,
    STEP_SIZE,
    WIDTH,
)
from palpate.types.measurements import (
    ContactCorner,
    ContactDirection,
    ContactPlace,
    Measurement,
    ObjectPose,
    OwnMeasurement,
    Turn,
)

logger = logging.getLogger(__name__)
_NO_POSE = 12 * (0.0,)  # pose and root of a term that has none

NAMES = (
    *("sticking", "balance", "friction_cone"),
    *("first_pose", "sensor_pose", "contact", "direction", "place", "turn", "corner", "object_pose", "own"),
)
"""Names of the factors. Those of pushing come first: they hold only while nothing but the sensor moves the object.
Every step but the first has those of pushing, every step those of sensor pose and contact, and the first step of a
contact that of the first pose; the others are of measurements that arrive."""
STICKING, BALANCE, FRICTION_CONE, FIRST_POSE, SENSOR_POSE, CONTACT, DIRECTION, PLACE, TURN, CORNER, OBJECT_POSE, OWN = (
    range(len(NAMES))
)
MOST_ROWS = 3 + OBJECT_SIZE
"""Largest number of residual rows of a factor."""


def _record(formats: dict[str, Any]) -> np.dtype:
    """Return a structured type for compiled code."""
    return np.dtype(list(formats.items()), align=True)


TERM = _record(
    dict.fromkeys(("step", "kind", "value", "variance", "from_touch", "arrived", "slope"), "f8")
    | {"pose": "3f8", "root": "(3,3)f8"}
)
"""The term of a measurement: a row (TERM_SIZE,) of numbers.

- step: its step, counted from the beginning of the contact.
- kind: place of its factor in NAMES.
- value, variance: measured angle [rad] or place [m].
- from_touch: 1 if the value was read from touch images, which may be mirrored.
- arrived: the step with which it arrived, which is later if it is late.
- slope: that of a corner; see `measurements.ContactCorner`.
- pose, root: measured pose of the object, and the whitening matrix of its covariance.
"""
TERM_SIZE = TERM.itemsize // 8
STEP = _record(
    {"g": "3f8", "e": "3f8", "object": "3f8", "measured": "3f8", "moved": "f8"}
    | {"turn_g": "c16", "turn_e": "c16", "touch": CONTACT_GEOMETRY, "force_angle": "f8"}
    | {"slide": "f8", "spread": "f8", "cost": "3f8", "cost_of_belief": "f8", "surprise": f"{len(NAMES)}f8"}
    | {"root": f"({STEP_SIZE},{WIDTH})f8", "y": f"{STEP_SIZE}f8"}
)
"""One step of a row of the window.

- g, e, object: sensor pose in the object frame, sensor and object in the world [m, m, rad].
- measured, moved: measured sensor pose, and its distance from that of the step before [m].
- turn_g, turn_e: rotations exp(i theta).
- force_angle: angle of the pushing force from the outline's inward normal, counter-clockwise [rad].
- slide, spread: slide of the object over the sensor by something else in this step, mean and standard deviation [m],
  counter-clockwise along the outline. The latter is 0 in a step without disturbance.
- cost: cost of measurements and of pushing, and 1 if the latter does not count, as for all disturbed steps until one
  hypothesis is left.
- cost_of_belief: that of the first pose, which is no evidence.
- surprise: square of the innovations of each factor when this step was the last one, in units of the variance
  predicted and that of the factor, which is no better than the contact model; see `ROW`.
- root, y: what is left of the step once it is eliminated; see `gauss_newton.eliminate`.
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
    | {"covariance": f"({MOST_ROWS},{MOST_ROWS})f8", "change": "f8"}
    | {"surprise": f"{len(NAMES)}f8"}
    | {"innovations": f"({len(NAMES)},6,3)f8", "moved": f"{LAST_SIZE}f8"}
    | {"last_root": f"({LAST_SIZE},{WIDTH})f8", "last_y": f"{LAST_SIZE}f8", "is_lost": "?"}
)
"""All else in a row of the window.

- shared: shared variables.
- sign: -1.0 if touch images are taken as mirrored, else 1.0.
- first_...: belief about the object at the beginning: pose, variables, and whitening matrix of their joint covariance.
- past, next_past: what older steps say, and what they will say once the oldest step has left.
- covariance: joint covariance of the object's last pose and its variables.
- surprise: mean of those of the last SHORT steps for each factor; 0 until there are so many.
- innovations: of the rows of each factor that arrived with the last step, see `Estimate.innovations`.
- moved: change of the last step and the shared variables in the last Gauss-Newton step.
- change: largest change of a pose in it [m, rad].
- last_root, last_y: what is left of the last step and the shared variables once they are eliminated.
- is_lost: True if there is no solution.
"""
LINEAR = _record(
    {"residual": f"{MOST_ROWS}f8", "jacobian": f"({MOST_ROWS},{WIDTH})f8"}
    | {"information": f"{MOST_ROWS}f8", "weight": f"{MOST_ROWS}f8"}
    | {"error": "3f8", "by_pose": "(3,3)f8", "adjoint": "(3,3)f8"}
)
"""Linearised rows of a factor.

- jacobian: by right (body-frame) perturbations of g and e of the step before and of this step, and by the shared
  variables; 0 before a kernel writes to it.
- information, weight: inverse variances, without and with the weight that the robust kernel leaves.
- error, by_pose, adjoint: room for computing.
"""
WORK = _record(
    {"linear": LINEAR, "system": f"({WIDTH},{WIDTH})f8", "gradient": f"{WIDTH}f8", "change": f"{WIDTH}f8"}
    | {"next_system": f"({WIDTH},{WIDTH})f8", "next_gradient": f"{WIDTH}f8", "next_root": f"({STEP_SIZE},{WIDTH})f8"}
    | {"next_y": f"{STEP_SIZE}f8"}
)
"""Room for computing one row of a window; arrays made in compiled code are slow to compile."""


@dataclass(frozen=True, eq=False)
class Step:
    """Input of one step of a contact."""

    sensor_pose: Array
    """Measured world_T_sensor, (3,) [m, m, rad]."""
    measurements: Sequence[Measurement] = ()
    """Measurements from touch and other sources, those of other times near one of `times`."""
    from_touch: int = 0
    """Number of leading measurements that were read from touch images, which may be mirrored."""
    times: Sequence[float] = (0.0,)
    """Times of the last steps, this one last [s]."""

    def directions(self, belief: Belief, sign: Array) -> list[tuple[Array, float]]:
        """Return the contact directions, each as angles (B,) [rad], given bias and scale, and a variance [rad^2].

        `sign` (B,) is -1 where touch images are taken as mirrored.
        """
        bias, scale = belief[DIRECTION_BIAS][:, 0], belief[DIRECTION_SCALE][:, 0]
        found = []
        for index, one in enumerate(self.measurements):
            if isinstance(one, ContactDirection):
                angle = one.angle * (sign if index < self.from_touch else np.ones_like(sign))
                angle = angle - bias  # then one Newton step towards psi + scale sin(psi) = angle
                found.append((angle - scale * np.sin(angle) / (1.0 + scale * np.cos(angle)), one.variance))
        return found


def timely(measurements: Sequence[Measurement], times: Sequence[float]) -> list[Measurement]:
    """Return the measurements without those of a time before or after all of these [s], which a warning names."""
    kept = []
    for one in measurements:
        time = getattr(one, "time", None)
        if time is None or times[0] - SLACK <= time <= times[-1] + SLACK:
            kept.append(one)
        else:
            found = f"measurement {type(one).__name__} has time {time} s"
            allowed = f"between {times[0]:.3f} s and now"
            logger.warning("frame at %.3f s: %s, which is not %s; it is left out", times[-1], found, allowed)
    return kept


def step_of(measurement: Measurement, times: Sequence[float]) -> int:
    """Return the step nearest to the time of a measurement: 0 is the last of these times [s], -1 the one before."""
    time = getattr(measurement, "time", None)
    return 0 if time is None else int(np.argmin(np.abs(np.asarray(times) - time))) + 1 - len(times)


def terms_of(step: Step, number: int) -> tuple[Array, list[tuple[int, OwnMeasurement]]]:
    """Return the terms (T, TERM_SIZE) that arrive with a step of this number, and own measurements with their steps.

    Terms are in the order of their steps and kinds.
    """
    found: list[tuple[float, ...]] = []
    own: list[tuple[int, OwnMeasurement]] = []
    for index, one in enumerate(step.measurements):
        is_touch = index < step.from_touch
        if isinstance(one, ContactDirection):
            found.append((number, DIRECTION, one.angle, one.variance, is_touch, number, 0.0, *_NO_POSE))
        elif isinstance(one, ContactPlace):
            found.append((number, PLACE, one.place, one.variance, is_touch, number, 0.0, *_NO_POSE))
        elif isinstance(one, Turn):
            found.append((number, TURN, one.angle, one.variance, is_touch, number, 0.0, *_NO_POSE))
        elif isinstance(one, ContactCorner):
            found.append((number, CORNER, one.angle, one.variance, is_touch, number, one.slope, *_NO_POSE))
        elif isinstance(one, ObjectPose):
            root, its = np.linalg.inv(np.linalg.cholesky(one.covariance)), number + step_of(one, step.times)
            found.append((its, OBJECT_POSE, 0.0, 0.0, False, number, 0.0, *one.pose.tolist(), *root.ravel().tolist()))
        elif isinstance(one, OwnMeasurement):
            own.append((number + step_of(one, step.times), one))
    found.sort(key=lambda term: term[:2])
    return np.array(found, np.float64).reshape(-1, TERM_SIZE), own


def make_factors(settings: NoiseSettings, model: ContactModel) -> NDArray[np.void]:
    """Return the input of kernels (1,): groups of settings, and friction radius and centre and span of the model."""
    parts: list[Any] = [("friction_radius", np.float64), ("friction_center", np.complex128), ("span", np.float64)]
    values: list[Any] = [model.friction_radius, model.friction_center, model.span]
    for name, numbers in asdict(settings).items():
        if name == "priors":
            continue
        parts.append((name, [(key, np.float64, np.shape(number)) for key, number in numbers.items()]))
        # Without a kernel, its scale is infinite.
        values.append(tuple(math.inf if number is None else number for number in numbers.values()))
    return np.array([tuple(values)], np.dtype(parts, align=True))
