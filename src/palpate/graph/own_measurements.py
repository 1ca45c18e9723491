"""Measurements that bring their own residual, for sources that palpate does not know; see `OwnMeasurement`.

A measurement of the object's pose is converted to the poses in the graph: with o = e g^-1, a perturbation d of e
perturbs o by `Ad_g d`, one of g by `-Ad_g d`.
"""

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.graph.variables import (
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
from palpate.types.measurements import OwnMeasurement, check_time

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
    """Raise SettingError on a measurement whose variables or time are missing or wrong."""
    name, on = type(measurement).__name__, getattr(measurement, "on", None)
    if not isinstance(on, tuple | list):
        raise SettingError(f"measurement {name} is on {on!r}; it must be a tuple of names of variables")
    for one in on:
        named(one)
    check_time(name, measurement.time)


def linearised(measurement: OwnMeasurement, values: dict[Variable, Array]) -> tuple[Array, Array]:
    """Return a whitened residual (R,) and its Jacobian (R, LAST_SIZE) by g, e and the shared variables.

    Raises EstimationError, naming the measurement, if it returns something else.
    """
    name, variables = type(measurement).__name__, [named(one) for one in measurement.on]
    g, e = values[SENSOR_IN_OBJECT], values[SENSOR]
    values = {**values, OBJECT_POSE: se2.compose(e, se2.inverse(g))}
    try:
        residual, jacobian = measurement.linearise(*(values[one] for one in variables))
        residual, jacobian = np.asarray(residual, np.float64), np.asarray(jacobian, np.float64)
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
