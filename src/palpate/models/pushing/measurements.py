"""The measurements of one step, and the terms that they bring."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.arrays import Array, Flags
from palpate.estimation.compiled_model import CompiledModel
from palpate.estimation.factor import Factor
from palpate.geometry import se2
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.variables import DIRECTION_BIAS, DIRECTION_SCALE
from palpate.types.measurements import ContactDirection, Measurement, OwnMeasurement

logger = logging.getLogger(__name__)

SLACK = 0.02
"""[s] Tolerance on a measurement's time: clocks of cameras and robots differ."""
_NO_ROOT = 9 * (0.0,)


@dataclass(frozen=True, eq=False)
class OfFinger:
    """A measurement by touch of one finger of a hand."""

    finger: int
    """Number of the finger."""
    measurement: Measurement
    time: float | None = None
    """Time of its image [s]; None for that of its frame."""


@dataclass(frozen=True, eq=False)
class Fingers:
    """N fingers of a hand at one step."""

    mounts: Array
    """hand_T_finger, (N, 3) [m, m, rad]."""
    touches: Flags
    """True for those that touch, (N,)."""
    sunk: Array
    """Indentation beyond the usual one, as the imprint shows it, (N,) [m]."""

    def mounts_in(self, sign: Array) -> Array:
        """Return the mounts (B, N, 3) in hypotheses, of which those with sign (B,) -1 take fingers as exchanged."""
        return np.where(np.asarray(sign)[:, None, None] < 0.0, self.mounts[::-1], self.mounts)


@dataclass(frozen=True, eq=False)
class Step:
    """Input of one step of a contact."""

    sensor_pose: Array
    """Measured world_T_sensor, (3,) [m, m, rad]."""
    measurements: Sequence[Measurement | OfFinger] = ()
    """Measurements from touch and other sources, those of other times near one of `times`."""
    from_touch: int = 0
    """Number of leading measurements that were read from touch images, which may be mirrored."""
    times: Sequence[float] = (0.0,)
    """Times of the last steps, this one last [s]."""
    sunk: float = 0.0
    """Indentation beyond the usual one, as the imprint shows it [m]."""
    fingers: Fingers | None = None
    """Fingers of a hand, of which `sensor_pose` is the pose; None for one sensor."""
    finger: int = 0
    """Number of the finger, of a step as one finger has it."""

    def of_finger(self, finger: int, is_exchanged: bool) -> "Step":
        """Return the step as a finger of the hand has it, at another one's mount if fingers are exchanged."""
        assert self.fingers is not None
        mount = self.fingers.mounts[::-1][finger] if is_exchanged else self.fingers.mounts[finger]
        own = [one.measurement for one in self.measurements if isinstance(one, OfFinger) and one.finger == finger]
        pose = se2.compose(self.sensor_pose, mount)
        return Step(pose, own, times=self.times, sunk=float(self.fingers.sunk[finger]), finger=finger)

    def directions(self, belief: Belief, sign: Array) -> list[tuple[Array, float]]:
        """Return the contact directions, each as angles (B,) [rad], given bias and scale, and a variance [rad^2].

        `sign` (B,) is -1 where touch images are taken as mirrored.
        """
        bias = belief.of_finger(DIRECTION_BIAS, self.finger)[:, 0]
        scale = belief.of_finger(DIRECTION_SCALE, self.finger)[:, 0]
        directions: list[tuple[Array, float]] = []
        for index, measurement in enumerate(self.measurements):
            if not isinstance(measurement, ContactDirection):
                continue
            seen = measurement.angle * sign if index < self.from_touch else np.full_like(sign, measurement.angle)
            angle = seen - bias
            # One Newton step towards psi + scale sin(psi) = angle.
            psi = angle - scale * np.sin(angle) / (1.0 + scale * np.cos(angle))
            directions.append((psi, measurement.variance))
        return directions


def timely(measurements: Sequence[Any], times: Sequence[float]) -> list[Any]:
    """Return the measurements without those of a time before or after all of these [s], which a warning names."""
    kept: list[Measurement] = []
    for measurement in measurements:
        time = getattr(measurement, "time", None)
        if time is None or times[0] - SLACK <= time <= times[-1] + SLACK:
            kept.append(measurement)
        else:
            found = f"measurement {type(measurement).__name__} has time {time} s"
            allowed = f"between {times[0]:.3f} s and now"
            logger.warning("frame at %.3f s: %s, which is not %s; it is left out", times[-1], found, allowed)
    return kept


def step_of(measurement: Measurement | OfFinger, times: Sequence[float]) -> int:
    """Return the step nearest to the time of a measurement: 0 is the last of these times [s], -1 the one before."""
    time = getattr(measurement, "time", None)
    if time is None:
        return 0
    return int(np.argmin(np.abs(np.asarray(times) - time))) + 1 - len(times)


def measurement_and_finger(given: Measurement | OfFinger) -> tuple[Measurement, int]:
    """Return a measurement and the number of the finger that it is of, 0 of a single sensor."""
    return (given.measurement, given.finger) if isinstance(given, OfFinger) else (given, 0)


def terms_of(compiled: CompiledModel, step: Step, number: int) -> tuple[Array, list[tuple[int, OwnMeasurement]]]:
    """Return the terms that arrive with a step of this number, and own measurements with their steps.

    Terms are rows (T, numbers of `estimation.records.term_type`) in the order of their steps and kinds.
    """
    model = compiled.model
    terms: list[tuple[float, ...]] = []
    own: list[tuple[int, OwnMeasurement]] = []
    for index, given in enumerate(step.measurements):
        at = number + step_of(given, step.times)
        measurement, finger = measurement_and_finger(given)
        kind = model.factors_by_measurement.get((type(measurement), finger))
        if isinstance(measurement, OwnMeasurement):
            own.append((at, measurement))
        elif kind is not None:
            numbers = _numbers_of(measurement, model.factors[kind], compiled.term_data)
            terms.append((at, kind, number, index < step.from_touch, *numbers))
    terms.sort(key=lambda term: term[:2])
    return np.array(terms, np.float64).reshape(-1, compiled.term_size), own


def _numbers_of(measurement: Measurement, factor: Factor, most: int) -> tuple[float, ...]:
    """Return variance, data and root of a measurement, in the order of a term; `most` numbers of data have room."""
    variance = getattr(measurement, "variance", 0.0)
    by_name = (getattr(measurement, name) for name in factor.data)
    data = tuple(by_name if factor.numbers is None else factor.numbers(measurement))
    padding = (most - len(data)) * (0.0,)
    root = _NO_ROOT if factor.root is None else factor.root(measurement).ravel().tolist()
    return (variance, *data, *padding, *root)
