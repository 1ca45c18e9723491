"""Measurements that bring their own residual, for sources that palpate does not know; see `OwnMeasurement`.

A measurement of the object's pose is converted to the poses in the graph: with o = e g^-1, a perturbation d of e
perturbs o by `Ad_g d`, one of g by `-Ad_g d`.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.checks import without_gradient
from palpate.errors import EstimationError, SettingError
from palpate.estimation.model import Model
from palpate.estimation.records import MOST_OWN_ROWS
from palpate.estimation.variable import Variable
from palpate.geometry import se2
from palpate.models.pushing.model import MODEL, named
from palpate.models.pushing.variables import OBJECT_POSE, SENSOR, SENSOR_IN_OBJECT
from palpate.types.measurements import OwnMeasurement, check_time

logger = logging.getLogger(__name__)
_LARGEST = 1e12  # [standard deviations]; the square of more could overflow


@dataclass(eq=False)
class OwnMeasurements:
    """The user's own measurements in a window, with the result of the Jacobian check of each class."""

    given: list[tuple[int, OwnMeasurement]] = field(default_factory=list[tuple[int, OwnMeasurement]])
    """Measurements with their steps."""
    time: float = 0.0
    """Time of the last frame [s]."""
    is_right: dict[type, bool] = field(default_factory=dict[type, bool])
    """Classes so far, and True if their Jacobian is the derivative of their residual."""
    warned: set[type] = field(default_factory=set[type])
    """Classes that a warning has already named."""
    model: Model = MODEL
    """Variables that measurements may be of."""

    def evaluated(self, first: int, steps: NDArray[np.void], shared: Array) -> Array:
        """Return the residuals and Jacobians (B, M, 6, 1 + last size) at steps (B, N), of which `first` is the first.

        Columns are the residual and its derivatives by g, e and the shared variables. A measurement that returns
        something unusable, or is of variables that there are not while nothing touches the object, is left out from
        then on; a warning names the first of a class.
        """
        is_resting = bool(steps["is_resting"][0, 0])
        rows: list[Array] = []
        usable: list[tuple[int, OwnMeasurement]] = []
        for step, measurement in self.given:
            kind = type(measurement)
            if not self.is_right.get(kind, True):
                continue
            try:
                _check_variables(self.model, measurement, is_resting)
                rows.append(self._of_all_rows(measurement, steps[step - first], shared))
                usable.append((step, measurement))
            except EstimationError as error:
                which = "it is" if self.is_right.get(kind, True) else "all of them are"
                if kind not in self.warned:
                    logger.warning("frame at %.3f s: %s; %s left out, further ones silently", self.time, error, which)
                self.warned.add(kind)
        self.given = usable
        return np.stack(rows, axis=1) if rows else np.empty((len(shared), 0, MOST_OWN_ROWS, 1 + self.model.last_size))

    def _of_all_rows(self, measurement: OwnMeasurement, step: NDArray[np.void], shared: Array) -> Array:
        """Return residual and Jacobian (B, 6, 1 + last size) of a measurement at its step of all rows (B,)."""
        linear = np.zeros((len(step), MOST_OWN_ROWS, 1 + self.model.last_size))
        for b in range(len(step)):
            values = values_at(self.model, step["g"][b], step["e"][b], shared[b])
            residual, jacobian = self._linearised(measurement, values)
            linear[b, : len(residual), 0] = residual
            linear[b, : len(residual), 1:] = jacobian
        return linear

    def _linearised(self, measurement: OwnMeasurement, values: dict[Variable, Array]) -> tuple[Array, Array]:
        """Return a whitened residual (R,) and its Jacobian (R, last size) by g, e and the shared variables.

        Raises EstimationError, naming the measurement, if it returns something else, or if the first Jacobian of its
        class is not the derivative of the residual.
        """
        kind = type(measurement)
        name = kind.__name__
        variables = [named(variable) for variable in measurement.on]
        at = [values[variable] for variable in variables]
        slopes: Array | None = None
        try:
            residual, jacobian = _returned(measurement, at)
            if jacobian is None or kind not in self.is_right:
                slopes = _differences(measurement, variables, at)
                jacobian = slopes.mean(axis=0) if jacobian is None else jacobian
        except Exception as error:  # somebody else's code must not cost the contact
            raise EstimationError(f"measurement {name} raises {type(error).__name__}: {error}") from error
        width = sum(variable.dimension for variable in variables)
        if residual.ndim != 1 or len(residual) > MOST_OWN_ROWS or jacobian.shape != (len(residual), width):
            found = f"a residual of shape {residual.shape} and a Jacobian of shape {jacobian.shape}"
            wanted = f"(R,) and (R, {width}) with R at most {MOST_OWN_ROWS}"
            raise EstimationError(f"measurement {name} returns {found}; they must be {wanted}")
        if not (np.abs(np.column_stack([residual, jacobian])) < _LARGEST).all():
            raise EstimationError(f"measurement {name} returns a residual or Jacobian that is not finite")
        if slopes is not None and kind not in self.is_right:
            wrong = _wrong_derivative(jacobian, slopes)
            self.is_right[kind] = not wrong
            if wrong:
                raise EstimationError(f"measurement {name} {wrong}")
        return residual, _by_all(self.model, jacobian, variables, values[SENSOR_IN_OBJECT])


def _check_variables(model: Model, measurement: OwnMeasurement, is_resting: bool) -> None:
    """Raise EstimationError if a measurement is of variables that there are not while nothing touches the object."""
    if not is_resting:
        return
    known = (OBJECT_POSE, *model.of("object"))
    for name in measurement.on:
        if named(name) not in known:
            allowed = ", ".join(variable.name for variable in known)
            raise EstimationError(f"measurement {type(measurement).__name__} is of {name}; at rest there are {allowed}")


def values_at(model: Model, g: Array, e: Array, shared: Array) -> dict[Variable, Array]:
    """Return the values of all variables at poses g and e (3,) and shared variables (V,)."""
    values = {SENSOR_IN_OBJECT: g, SENSOR: e, OBJECT_POSE: se2.compose(e, se2.inverse(g))}
    for variable, place in model.in_shared.items():
        values[variable] = shared[place]
    return values


def check_own(measurement: OwnMeasurement) -> None:
    """Raise SettingError on a measurement whose variables, time or residual are missing or wrong."""
    name = type(measurement).__name__
    on: Any = getattr(measurement, "on", None)
    if not any(callable(getattr(measurement, method, None)) for method in ("residual", "linearise")):
        raise SettingError(f"measurement {name} has no method residual(...) that returns its residual")
    if not isinstance(on, tuple | list):
        raise SettingError(f"measurement {name} is on {on!r}; it must be a tuple of names of variables")
    for variable in measurement.on:
        named(variable)
    check_time(name, measurement.time)


def _by_all(model: Model, jacobian: Array, variables: Sequence[Variable], g: Array) -> Array:
    """Return a Jacobian by some variables as one by g, e and the shared variables."""
    by_variable = {
        variable: np.zeros((len(jacobian), variable.dimension)) for variable in (*model.of("step"), *model.shared)
    }
    ends = np.cumsum([variable.dimension for variable in variables])
    for variable, part in zip(variables, np.split(jacobian, ends[:-1], axis=1), strict=True):
        if variable == OBJECT_POSE:
            by_sensor = part @ se2.adjoint(g)
            by_variable[SENSOR] += by_sensor
            by_variable[SENSOR_IN_OBJECT] -= by_sensor
        else:
            by_variable[variable] += part
    return np.concatenate(list(by_variable.values()), axis=1)


def _wrong_derivative(jacobian: Array, slopes: Array) -> str:
    """Return the place at which a Jacobian is not between the slopes at both sides (2, R, C), in words, or "".

    At a kink, such as that of a distance that is 0, these differ.
    """
    size = np.abs(slopes).max(axis=(0, 1))
    slack = 0.05 * size + 1e-3 * size.max(initial=0.0)
    wrong = (jacobian < slopes.min(axis=0) - slack) | (jacobian > slopes.max(axis=0) + slack)
    if not wrong.any():
        return ""
    row, column = np.argwhere(wrong)[0].tolist()
    found = jacobian[row, column]
    expected = slopes[:, row, column].mean()
    return (
        f"returns a Jacobian that is not the derivative of its residual: row {row}, column {column} is {found:.4g}, "
        f"and finite differences are {expected:.4g}"
    )


def _returned(measurement: OwnMeasurement, at: Sequence[Array]) -> tuple[Array, Array | None]:
    """Return the residual (R,) at values of the variables and its Jacobian, None if the measurement gives none."""
    jacobian = None
    if hasattr(measurement, "linearise"):
        residual, jacobian = measurement.linearise(*at)
        jacobian = np.atleast_2d(np.asarray(without_gradient(jacobian), np.float64))
    else:
        residual = measurement.residual(*at)
    return np.atleast_1d(np.asarray(without_gradient(residual), np.float64)), jacobian


def _differences(measurement: OwnMeasurement, variables: Sequence[Variable], at: Sequence[Array]) -> Array:
    """Return the slopes of the residual before and after values of the variables, (2, R, C)."""
    size = 1e-6  # [m], [rad]
    middle, _ = _returned(measurement, at)
    columns: list[list[Array]] = []
    for index, variable in enumerate(variables):
        for step in size * np.eye(variable.dimension):
            ends: list[Array] = []
            for change in (-step, step):
                value = at[index]
                moved = se2.compose(value, change) if variable.scope == "step" else value + change
                ends.append(_returned(measurement, [*at[:index], moved, *at[index + 1 :]])[0])
            before, after = ends
            columns.append([(middle - before) / size, (after - middle) / size])
    return np.moveaxis(np.array(columns), 0, 2)
