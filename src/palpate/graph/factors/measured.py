"""Measurements that bring their own residual: a camera's opinion, a tag, whatever a user measures.

A measurement names the unknowns that it is of and linearises itself; see `recording.measurements.OwnMeasurement`. One
of the object's pose is carried over to the poses that the graph holds: with o = e g^-1, a perturbation d of e moves o
by `Ad_g d`, one of g by `-Ad_g d`.
"""

import logging
from collections.abc import Sequence

import numpy as np

from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.graph.factors.factor import Array, Factor, Rows, Step, Terms
from palpate.graph.values import Values
from palpate.graph.variables import OBJECT_POSE, OF_OBJECT, SENSOR, SENSOR_IN_OBJECT, SHARED, Unknown, named
from palpate.types.measurements import OwnMeasurement, check_time

logger = logging.getLogger(__name__)
DATA = np.dtype([("measurement", object), ("time", np.float64)])
_LARGEST = 1e12  # [standard deviations]; the square of more is as good as not finite
ROWS = 6
"""Rows that a measurement may have at most."""


class Measured(Factor):
    """One term for each measurement that brings its own residual."""

    name = "measured"
    steps = ((SENSOR_IN_OBJECT, SENSOR),)
    shared = SHARED
    rows = ROWS
    data = DATA
    given = ()
    holds_at_rest = True

    def terms(self, step: Step) -> Terms | None:
        """See Factor. Raises SettingError on a measurement of an unknown that is not known."""
        said = [one for one in step.of(OwnMeasurement) if _is_at_hand([named(name) for name in one.on], one, step)]
        if not said:
            return None
        data = np.empty(len(said), DATA)
        data["measurement"], data["time"] = said, step.times[-1]
        return Terms(step.places_of(said), data)

    def linearise_into(self, rows: Rows, at: Values, terms: Terms) -> None:
        """See Factor. A measurement that returns something unusable is named in a warning and left out from then on."""
        smoothers = at.smoothers
        rows.residual[:], rows.jacobian[:] = 0.0, 0.0
        rows.information[:] = rows.weight[:] = 1.0
        for t, ((place,), (measurement, time)) in enumerate(zip(terms.places, terms.data, strict=True)):
            if measurement is None:
                continue
            for b in range(smoothers):
                values = {one: at[one][b, place] for one in (SENSOR_IN_OBJECT, SENSOR)}
                values |= {one: at[one][:, b] for one in SHARED}
                try:
                    residual, jacobian = linearised(measurement, values)
                except EstimationError as error:
                    logger.warning("frame at %.3f s: %s; it is left out", time, error)
                    terms.data["measurement"][t] = None
                    rows.residual[:, t], rows.jacobian[:, t] = 0.0, 0.0
                    break
                rows.residual[b, t, : len(residual)] = residual
                rows.jacobian[b, t, : len(residual)] = jacobian


def _is_at_hand(unknowns: Sequence[Unknown], measurement: OwnMeasurement, step: Step) -> bool:
    """Whether a step has the unknowns that a measurement is of; a warning says where it has not."""
    allowed = (OBJECT_POSE, *OF_OBJECT)
    if missing := [one.name for one in unknowns if step.at_rest and one not in allowed]:
        names = ", ".join(one.name for one in allowed)
        found = f"measurement {type(measurement).__name__} is of {missing[0]}"
        logger.warning("frame at %.3f s: %s; at rest there are %s; it is left out", step.times[-1], found, names)
    return not missing


def check_own(measurement: OwnMeasurement) -> None:
    """Raise SettingError on a measurement that does not say, or not rightly, of what and when it is."""
    name, on = type(measurement).__name__, getattr(measurement, "on", None)
    if not isinstance(on, tuple | list):
        raise SettingError(f"measurement {name} is on {on!r}; it must be a tuple of names of unknowns")
    for one in on:
        named(one)
    check_time(name, measurement.time)


_IN_GRAPH = (SENSOR_IN_OBJECT, SENSOR, *SHARED)


def linearised(measurement: OwnMeasurement, values: dict) -> tuple[Array, Array]:
    """Return a measurement's whitened residual (R,) and its Jacobian (R, 6 + SHARED_SIZE) by g, e and what is shared.

    Raises EstimationError where it returns something else than it should.
    """
    g, e = values[SENSOR_IN_OBJECT], values[SENSOR]
    values = {**values, OBJECT_POSE: se2.compose(e, se2.inverse(g))}
    residual, parts = checked(measurement, values)
    jacobian = {one: np.zeros((len(residual), one.dimension)) for one in _IN_GRAPH}
    for unknown, part in parts.items():
        if unknown == OBJECT_POSE:
            by_sensor = part @ se2.adjoint(g)
            jacobian[SENSOR] += by_sensor
            jacobian[SENSOR_IN_OBJECT] -= by_sensor
        else:
            jacobian[unknown] += part
    return residual, np.concatenate([jacobian[one] for one in _IN_GRAPH], axis=1)


def checked(measurement: OwnMeasurement, values: dict) -> tuple[Array, dict]:
    """Return a measurement's whitened residual (R,) and its Jacobian (R, dimension) by each unknown that it is of.

    Raises EstimationError, naming the measurement, where it returns something else than it should.
    """
    name = type(measurement).__name__
    unknowns = [named(one) for one in measurement.on]
    if missing := [one.name for one in unknowns if one not in values]:
        allowed = ", ".join(one.name for one in values)
        raise EstimationError(f"measurement {name} is of {missing[0]}, which there is none of; allowed are {allowed}")
    try:
        residual, jacobian = measurement.linearise(*(values[one] for one in unknowns))
        residual, jacobian = np.asarray(residual, np.float64), np.asarray(jacobian, np.float64)
    except Exception as error:  # somebody else's code must not cost the contact
        raise EstimationError(f"measurement {name} raises {type(error).__name__}: {error}") from error
    width = sum(one.dimension for one in unknowns)
    if residual.ndim != 1 or len(residual) > ROWS or jacobian.shape != (len(residual), width):
        found = f"a residual of shape {residual.shape} and a Jacobian of shape {jacobian.shape}"
        wanted = f"(R,) and (R, {width}) with R at most {ROWS}"
        raise EstimationError(f"measurement {name} returns {found}; they must be {wanted}")
    if not ((np.abs(residual) < _LARGEST).all() and (np.abs(jacobian) < _LARGEST).all()):
        raise EstimationError(f"measurement {name} returns a residual or Jacobian that is not finite")
    ends = np.cumsum([one.dimension for one in unknowns])
    return residual, dict(zip(unknowns, np.split(jacobian, ends[:-1], axis=1), strict=True))
