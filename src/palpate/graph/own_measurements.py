"""Measurements that bring their own residual, for sources that palpate does not know; see `OwnMeasurement`.

A Jacobian that comes with a residual is compared with finite differences once, and replaced by them if it differs.
A measurement of the object's pose is converted to the poses in the graph: with o = e g^-1, a perturbation d of e
perturbs o by `Ad_g d`, one of g by `-Ad_g d`.
"""

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.checks import without_gradient
from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.graph.variables import (
    CONTACT_SIZE,
    IN_SHARED,
    LAST_SIZE,
    OBJECT_POSE,
    OF_OBJECT,
    SENSOR,
    SENSOR_IN_OBJECT,
    SHARED,
    Variable,
    named,
)
from palpate.types.measurements import Measurement, OwnMeasurement, check_time

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]
_LARGEST = 1e12  # [standard deviations]; the square of more could overflow
_ROWS = 6  # of a measurement, at most


def evaluated(
    own: list[OwnMeasurement | None], steps: Sequence[int], g: Array, e: Array, shared: Array, time: float
) -> Array:
    """Return the residuals and Jacobians (B, M, 6, 1 + LAST_SIZE) of own measurements at poses (B, N, 3).

    Columns are the residual and its derivatives by g, e and the shared variables. A measurement that returns something
    unusable is named in a warning and ignored from then on: it becomes None.
    """
    rows = np.zeros((len(g), len(own), _ROWS, 1 + LAST_SIZE))
    for index, (measurement, step) in enumerate(zip(own, steps, strict=True)):
        for b in range(len(g)):
            if measurement is None:
                break
            values = {SENSOR_IN_OBJECT: g[b, step], SENSOR: e[b, step]}
            values |= {one: shared[b, IN_SHARED[one]] for one in SHARED}
            try:
                residual, jacobian = linearised(measurement, values)
            except EstimationError as error:
                logger.warning("frame at %.3f s: %s; it is left out", time, error)
                own[index] = None
                rows[:, index] = 0.0
                break
            rows[b, index, : len(residual), 0], rows[b, index, : len(residual), 1:] = residual, jacobian
    return rows


def is_available_at_rest(measurement: OwnMeasurement, time: float) -> bool:
    """Return True if there are the variables of a measurement while nothing touches the object; warns if not."""
    allowed = (OBJECT_POSE, *OF_OBJECT)
    if missing := [name for name in measurement.on if named(name) not in allowed]:
        names = ", ".join(one.name for one in allowed)
        found = f"measurement {type(measurement).__name__} is of {missing[0]}"
        logger.warning("frame at %.3f s: %s; at rest there are %s; it is left out", time, found, names)
    return not missing


def check_own(measurement: OwnMeasurement) -> None:
    """Raise SettingError on a measurement whose variables, time or residual are missing or wrong."""
    name, on = type(measurement).__name__, getattr(measurement, "on", None)
    if not any(callable(getattr(measurement, method, None)) for method in ("residual", "linearise")):
        raise SettingError(f"measurement {name} has no method residual(...) that returns its residual")
    if not isinstance(on, tuple | list):
        raise SettingError(f"measurement {name} is on {on!r}; it must be a tuple of names of variables")
    for one in on:
        named(one)
    check_time(name, measurement.time)


def linearised(measurement: OwnMeasurement, values: dict[Variable, Array]) -> tuple[Array, Array]:
    """Return a whitened residual (R,) and its Jacobian (R, LAST_SIZE) by g, e and the shared variables.

    Raises EstimationError, naming the measurement, if it returns something else.
    """
    name, variables = _name(measurement), [named(one) for one in measurement.on]
    g, e = values[SENSOR_IN_OBJECT], values[SENSOR]
    values = {**values, OBJECT_POSE: se2.compose(e, se2.inverse(g))}
    at = [values[one] for one in variables]
    try:
        residual, jacobian = _returned(measurement, at)
        if jacobian is None:
            jacobian = _differences(measurement, variables, at).mean(axis=0)
    except Exception as error:  # somebody else's code must not cost the contact
        raise EstimationError(f"measurement {name} raises {type(error).__name__}: {error}") from error
    width = sum(one.dimension for one in variables)
    if residual.ndim != 1 or len(residual) > _ROWS or jacobian.shape != (len(residual), width):
        found = f"a residual of shape {residual.shape} and a Jacobian of shape {jacobian.shape}"
        wanted = f"(R,) and (R, {width}) with R at most {_ROWS}"
        raise EstimationError(f"measurement {name} returns {found}; they must be {wanted}")
    if not ((np.abs(residual) < _LARGEST).all() and (np.abs(jacobian) < _LARGEST).all()):
        raise EstimationError(f"measurement {name} returns a residual or Jacobian that is not finite")
    by_each = {one: np.zeros((len(residual), one.dimension)) for one in (SENSOR_IN_OBJECT, SENSOR, *SHARED)}
    ends = np.cumsum([one.dimension for one in variables])
    for variable, part in zip(variables, np.split(jacobian, ends[:-1], axis=1), strict=True):
        if variable == OBJECT_POSE:
            by_sensor = part @ se2.adjoint(g)
            by_each[SENSOR] += by_sensor
            by_each[SENSOR_IN_OBJECT] -= by_sensor
        else:
            by_each[variable] += part
    return residual, np.concatenate(list(by_each.values()), axis=1)


class _Residual(OwnMeasurement):
    """The residual alone of a measurement whose Jacobian is not the derivative of it."""

    def __init__(self, measurement: OwnMeasurement) -> None:
        self.measurement = measurement
        vars(self).update(on=measurement.on, time=measurement.time)

    def residual(self, *at: Array) -> Array:
        return _returned(self.measurement, at)[0]


class CheckedMeasurements:
    """Own measurements whose Jacobians are compared with finite differences, those of each class once."""

    def __init__(self) -> None:
        self._is_right: dict[type, bool] = {}

    def of(
        self, measurements: Sequence[Measurement], pose: Array, values: Array, sensor_pose: Array, time: float
    ) -> Sequence[Measurement]:
        """Return measurements, of those with a wrong Jacobian the residual alone; a warning names their class.

        They are compared at the object's pose (3,) and variables (OBJECT_SIZE,), and the sensor's pose (3,).
        """
        if not any(isinstance(one, OwnMeasurement) for one in measurements):
            return measurements
        shared = np.concatenate([np.zeros(CONTACT_SIZE), values])
        known = {SENSOR: sensor_pose, SENSOR_IN_OBJECT: se2.between(pose, sensor_pose), OBJECT_POSE: pose}
        known |= {one: shared[IN_SHARED[one]] for one in SHARED}
        return [self._one(one, known, time) if isinstance(one, OwnMeasurement) else one for one in measurements]

    def _one(self, measurement: OwnMeasurement, values: dict[Variable, Array], time: float) -> OwnMeasurement:
        kind = type(measurement)
        if kind not in self._is_right:
            wrong = _wrong_derivative(measurement, values)
            self._is_right[kind] = not wrong
            if wrong:
                logger.warning("frame at %.3f s: %s; finite differences are used in its place", time, wrong)
        return measurement if self._is_right[kind] else _Residual(measurement)


def _wrong_derivative(measurement: OwnMeasurement, values: dict[Variable, Array]) -> str:
    """Return the place at which the Jacobian of a measurement is not the derivative of its residual, in words, or "".

    At a kink, such as that of a distance that is 0, any value between the slopes at both sides is right.
    """
    variables = [named(one) for one in measurement.on]
    at = [values[one] for one in variables]
    try:
        jacobian, both = _returned(measurement, at)[1], _differences(measurement, variables, at)
    except Exception:  # `linearised` reports it
        return ""
    if jacobian is None or jacobian.shape != both.shape[1:] or not np.isfinite(both).all():
        return ""
    size = np.abs(both).max(axis=(0, 1))
    slack = 0.05 * size + 1e-3 * size.max(initial=0.0)
    wrong = (jacobian < both.min(axis=0) - slack) | (jacobian > both.max(axis=0) + slack)
    if not wrong.any():
        return ""
    row, column = map(int, np.argwhere(wrong)[0])
    return (
        f"measurement {_name(measurement)} returns a Jacobian that is not the derivative of its residual: row {row}, "
        f"column {column} is {jacobian[row, column]:.4g}, and finite differences are {both[:, row, column].mean():.4g}"
    )


def _name(measurement: OwnMeasurement) -> str:
    return type(measurement.measurement if isinstance(measurement, _Residual) else measurement).__name__


def _returned(measurement: OwnMeasurement, at: Sequence[Array]) -> tuple[Array, Array | None]:
    """Return the residual (R,) at values of the variables and its Jacobian, None if the measurement gives none."""
    if hasattr(measurement, "linearise"):
        found = measurement.linearise(*at)
        residual, jacobian = (found, None) if isinstance(found, np.ndarray | float) else found
    else:
        residual, jacobian = measurement.residual(*at), None
    residual = np.atleast_1d(np.asarray(without_gradient(residual), np.float64))
    if jacobian is not None:
        jacobian = np.atleast_2d(np.asarray(without_gradient(jacobian), np.float64))
    return residual, jacobian


def _differences(measurement: OwnMeasurement, variables: Sequence[Variable], at: Sequence[Array]) -> Array:
    """Return the slopes of the residual before and after values of the variables, (2, R, C)."""
    size = 1e-6  # [m], [rad]
    middle, _ = _returned(measurement, at)
    columns = []
    for index, one in enumerate(variables):
        for step in size * np.eye(one.dimension):
            moved = [se2.compose(at[index], way) if one.scope == "step" else at[index] + way for way in (-step, step)]
            before, after = (_returned(measurement, [*at[:index], each, *at[index + 1 :]])[0] for each in moved)
            columns.append([(middle - before) / size, (after - middle) / size])
    return np.moveaxis(np.array(columns), 0, 2)
