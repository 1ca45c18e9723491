"""Measurements that bring their own residual, for sources that palpate does not know; see `OwnMeasurement`.

A measurement of the object's pose is converted to the poses in the graph: with o = e g^-1, a perturbation d of e
perturbs o by `Ad_g d`, one of g by `-Ad_g d`.
"""

import logging

import numpy as np

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.graph.factors.factor import Array, Factor, Linear, Step, Terms
from palpate.graph.values import Values
from palpate.graph.variables import OBJECT_POSE, OF_OBJECT, SENSOR, SENSOR_IN_OBJECT, SHARED, named
from palpate.types.measurements import OwnMeasurement, check_time

logger = logging.getLogger(__name__)
DATA = np.dtype([("measurement", object), ("time", np.float64)])
_LARGEST = 1e12  # [standard deviations]; the square of more could overflow
_ROWS = 6  # of a measurement, at most


class Measured(Factor):
    """One term for each measurement that brings its own residual."""

    name = "measured"
    on = (SENSOR_IN_OBJECT, SENSOR)
    shared = SHARED
    rows = _ROWS
    data = DATA
    holds_at_rest = True

    def terms(self, step: Step) -> Terms | None:
        """See Factor. Raises SettingError on a measurement of a variable that does not exist."""
        found = [one for one in step.timed(OwnMeasurement) if _is_available(one, step)]
        if not found:
            return None
        data = np.empty(len(found), DATA)
        data["measurement"], data["time"] = found, step.times[-1]
        return Terms(step.nearest(found), data)

    def linearise(self, at: Values, terms: Terms, out: Linear | None = None) -> Linear:
        """See Factor. A measurement that returns something unusable is named in a warning and ignored from then on."""
        out = self.room(at.rows, len(terms.step)) if out is None else out
        out.residual[:], out.jacobian[:] = 0.0, 0.0
        out.information[:] = out.weight[:] = 1.0
        for t, (step, (measurement, time)) in enumerate(zip(terms.step, terms.data, strict=True)):
            if measurement is None:
                continue
            for b in range(at.rows):
                values = {SENSOR_IN_OBJECT: at.sensor_in_object[b, step], SENSOR: at.sensor[b, step]}
                values |= {one: at[one][b] for one in SHARED}
                try:
                    residual, jacobian = linearised(measurement, values)
                except EstimationError as error:
                    logger.warning("frame at %.3f s: %s; it is left out", time, error)
                    terms.data["measurement"][t] = None
                    out.residual[:, t], out.jacobian[:, t] = 0.0, 0.0
                    break
                out.residual[b, t, : len(residual)] = residual
                out.jacobian[b, t, : len(residual)] = jacobian
        return out


def _is_available(measurement: OwnMeasurement, step: Step) -> bool:
    """Return True if a step has the variables of a measurement; warns if not."""
    allowed = (OBJECT_POSE, *OF_OBJECT)
    if missing := [name for name in measurement.on if step.at_rest and named(name) not in allowed]:
        names = ", ".join(one.name for one in allowed)
        found = f"measurement {type(measurement).__name__} is of {missing[0]}"
        logger.warning("frame at %.3f s: %s; at rest there are %s; it is left out", step.times[-1], found, names)
    return not missing


def check_own(measurement: OwnMeasurement) -> None:
    """Raise SettingError on a measurement whose variables or time are missing or wrong."""
    name, on = type(measurement).__name__, getattr(measurement, "on", None)
    if not isinstance(on, tuple | list):
        raise SettingError(f"measurement {name} is on {on!r}; it must be a tuple of names of variables")
    for one in on:
        named(one)
    check_time(name, measurement.time)


_IN_GRAPH = (SENSOR_IN_OBJECT, SENSOR, *SHARED)


def linearised(measurement: OwnMeasurement, values: dict) -> tuple[Array, Array]:
    """Return a whitened residual (R,) and its Jacobian (R, 6 + SHARED_SIZE) by g, e and the shared variables.

    Raises EstimationError if it returns something else.
    """
    g, e = values[SENSOR_IN_OBJECT], values[SENSOR]
    values = {**values, OBJECT_POSE: se2.compose(e, se2.inverse(g))}
    residual, parts = checked(measurement, values)
    jacobian = {one: np.zeros((len(residual), one.dimension)) for one in _IN_GRAPH}
    for variable, part in parts.items():
        if variable == OBJECT_POSE:
            by_sensor = part @ se2.adjoint(g)
            jacobian[SENSOR] += by_sensor
            jacobian[SENSOR_IN_OBJECT] -= by_sensor
        else:
            jacobian[variable] += part
    return residual, np.concatenate([jacobian[one] for one in _IN_GRAPH], axis=1)


def checked(measurement: OwnMeasurement, values: dict) -> tuple[Array, dict]:
    """Return a measurement's whitened residual (R,) and its Jacobian (R, dimension) by each of its variables.

    Raises EstimationError, naming the measurement, if it returns something else.
    """
    name = type(measurement).__name__
    variables = [named(one) for one in measurement.on]
    if missing := [one.name for one in variables if one not in values]:
        allowed = ", ".join(one.name for one in values)
        raise EstimationError(f"measurement {name} is of {missing[0]}, which is not here; allowed are {allowed}")
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
    ends = np.cumsum([one.dimension for one in variables])
    return residual, dict(zip(variables, np.split(jacobian, ends[:-1], axis=1), strict=True))
