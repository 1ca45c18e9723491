"""Measurements that bring their own residual, for sources that palpate does not know; see `OwnMeasurement`.

A measurement of the object's pose is converted to the poses in the graph: with o = e g^-1, a perturbation d of e
perturbs o by `Ad_g d`, one of g by `-Ad_g d`.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.arrays import Array
from palpate.checks import without_gradient
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
    VARIABLES,
    Variable,
    named,
)
from palpate.types.measurements import OwnMeasurement, check_time

logger = logging.getLogger(__name__)
_LARGEST = 1e12  # [standard deviations]; the square of more could overflow
_ROWS = 6  # of a measurement, at most


@dataclass(eq=False)
class OwnMeasurements:
    """The user's own measurements in a window, with the result of the Jacobian check of each class."""

    given: list[tuple[int, OwnMeasurement]] = field(default_factory=list)
    """Measurements with their steps."""
    time: float = 0.0
    """Time of the last frame [s]."""
    is_right: dict[type, bool] = field(default_factory=dict)
    """Classes so far, and True if their Jacobian is the derivative of their residual."""
    warned: set[type] = field(default_factory=set)
    """Classes that a warning has already named."""

    def evaluated(self, first: int, g: Array, e: Array, shared: Array, at_rest: bool = False) -> Array:
        """Return the residuals and Jacobians (B, M, 6, 1 + LAST_SIZE) at poses (B, N, 3), those of the `first` step on.

        Columns are the residual and its derivatives by g, e and the shared variables. A measurement that returns
        something unusable, or is of variables that there are not while nothing touches the object, is left out from
        then on; a warning tells of the first of a class.
        """
        known = (OBJECT_POSE, *OF_OBJECT) if at_rest else (OBJECT_POSE, *VARIABLES)
        rows, usable = [], []
        for step, measurement in self.given:
            its, k, kind = np.zeros((len(g), _ROWS, 1 + LAST_SIZE)), step - first, type(measurement)
            if not self.is_right.get(kind, True):
                continue
            try:
                if missing := [name for name in measurement.on if named(name) not in known]:
                    found = f"measurement {kind.__name__} is of {missing[0]}"
                    raise EstimationError(f"{found}; at rest there are {', '.join(one.name for one in known)}")
                for b in range(len(g)):
                    residual, jacobian = self._linearised(measurement, values_at(g[b, k], e[b, k], shared[b]))
                    its[b, : len(residual), 0], its[b, : len(residual), 1:] = residual, jacobian
                rows.append(its)
                usable.append((step, measurement))
            except EstimationError as error:
                which = "it is" if self.is_right.get(kind, True) else "all of them are"
                if kind not in self.warned:
                    logger.warning("frame at %.3f s: %s; %s left out, further ones silently", self.time, error, which)
                self.warned.add(kind)
        self.given = usable
        return np.stack(rows, axis=1) if rows else np.empty((len(g), 0, _ROWS, 1 + LAST_SIZE))

    def _linearised(self, measurement: OwnMeasurement, values: dict[Variable, Array]) -> tuple[Array, Array]:
        """Return a whitened residual (R,) and its Jacobian (R, LAST_SIZE) by g, e and the shared variables.

        Raises EstimationError, naming the measurement, if it returns something else, or if the first Jacobian of its
        class is not the derivative of the residual.
        """
        kind, variables = type(measurement), [named(one) for one in measurement.on]
        at, name, slopes = [values[one] for one in variables], kind.__name__, None
        try:
            residual, jacobian = _returned(measurement, at)
            if jacobian is None or kind not in self.is_right:
                slopes = _differences(measurement, variables, at)
                jacobian = slopes.mean(axis=0) if jacobian is None else jacobian
        except Exception as error:  # somebody else's code must not cost the contact
            raise EstimationError(f"measurement {name} raises {type(error).__name__}: {error}") from error
        width = sum(one.dimension for one in variables)
        if residual.ndim != 1 or len(residual) > _ROWS or jacobian.shape != (len(residual), width):
            found = f"a residual of shape {residual.shape} and a Jacobian of shape {jacobian.shape}"
            wanted = f"(R,) and (R, {width}) with R at most {_ROWS}"
            raise EstimationError(f"measurement {name} returns {found}; they must be {wanted}")
        if not (np.abs(np.column_stack([residual, jacobian])) < _LARGEST).all():
            raise EstimationError(f"measurement {name} returns a residual or Jacobian that is not finite")
        if slopes is not None and kind not in self.is_right:
            wrong = _wrong_derivative(jacobian, slopes)
            self.is_right[kind] = not wrong
            if wrong:
                raise EstimationError(f"measurement {name} {wrong}")
        return residual, _by_all(jacobian, variables, values[SENSOR_IN_OBJECT])


def values_at(g: Array, e: Array, shared: Array) -> dict[Variable, Array]:
    """Return the values of all variables at poses g and e (3,) and shared variables (SHARED_SIZE,)."""
    values = {SENSOR_IN_OBJECT: g, SENSOR: e, OBJECT_POSE: se2.compose(e, se2.inverse(g))}
    return values | {one: shared[IN_SHARED[one]] for one in SHARED}


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


def _by_all(jacobian: Array, variables: Sequence[Variable], g: Array) -> Array:
    """Return a Jacobian by some variables as one by g, e and the shared variables."""
    by_each = {one: np.zeros((len(jacobian), one.dimension)) for one in (SENSOR_IN_OBJECT, SENSOR, *SHARED)}
    ends = np.cumsum([one.dimension for one in variables])
    for variable, part in zip(variables, np.split(jacobian, ends[:-1], axis=1), strict=True):
        if variable == OBJECT_POSE:
            by_sensor = part @ se2.adjoint(g)
            by_each[SENSOR] += by_sensor
            by_each[SENSOR_IN_OBJECT] -= by_sensor
        else:
            by_each[variable] += part
    return np.concatenate(list(by_each.values()), axis=1)


def _wrong_derivative(jacobian: Array, slopes: Array) -> str:
    """Return the place at which a Jacobian is not between the slopes at both sides (2, R, C), in words, or "".

    At a kink, such as that of a distance that is 0, these differ.
    """
    size = np.abs(slopes).max(axis=(0, 1))
    slack = 0.05 * size + 1e-3 * size.max(initial=0.0)
    wrong = (jacobian < slopes.min(axis=0) - slack) | (jacobian > slopes.max(axis=0) + slack)
    if not wrong.any():
        return ""
    row, column = map(int, np.argwhere(wrong)[0])
    found, expected = jacobian[row, column], slopes[:, row, column].mean()
    return (
        f"returns a Jacobian that is not the derivative of its residual: row {row}, column {column} is {found:.4g}, "
        f"and finite differences are {expected:.4g}"
    )


def _returned(measurement: OwnMeasurement, at: Sequence[Array]) -> tuple[Array, Array | None]:
    """Return the residual (R,) at values of the variables and its Jacobian, None if the measurement gives none."""
    is_alone = not hasattr(measurement, "linearise")
    residual, jacobian = (measurement.residual(*at), None) if is_alone else measurement.linearise(*at)
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
