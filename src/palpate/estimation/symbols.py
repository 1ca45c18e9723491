"""Symbols of everything that a residual may read, each with the code that loads it and its derivatives.

A residual is called with these once, when code is generated. A pose moves by right (body-frame) perturbations d: its
position by R(theta) d and its angle by d_theta, so the derivatives of its five symbols are linear in cosine and sine.
"""

# SymPy has no types: what it returns is unknown.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sympy

from palpate.errors import SettingError
from palpate.estimation.factor import Factor
from palpate.estimation.model import Model
from palpate.estimation.variable import Variable
from palpate.manifolds.planar import Pose, Vector


class Fields:
    """Symbols by the names of fields; reading another name is an error that says which factor did."""

    def __init__(self, factor: str, name: str, fields: dict[str, Any]) -> None:
        self._factor = factor
        self._name = name
        self._fields = fields

    def __getattr__(self, name: str) -> Any:
        if name not in self._fields:
            known = ", ".join(self._fields)
            raise SettingError(
                f"factor {self._factor!r} reads {self._name}.{name}, which is not known; known are {known}"
            )
        return self._fields[name]


@dataclass
class Symbols:
    """Symbols for one factor."""

    model: Model
    settings: np.dtype
    """Record of the settings; see `models.pushing.settings`."""
    factor: Factor
    load: dict[sympy.Symbol, str] = field(default_factory=dict)
    """Code that loads the value of each symbol."""
    derivatives: dict[sympy.Symbol, dict[int, Any]] = field(default_factory=dict)
    """Derivative of each symbol that is not constant, by columns of the Jacobian."""
    differences: list[sympy.Symbol] = field(default_factory=list)
    """Differences of all numbers of the object's variables from the belief, in their order."""

    def arguments(self) -> dict[str, Any]:
        """Return all that the factor's functions may read, by the names of their parameters."""
        model = self.model
        belief: dict[str, Any] = {"pose": self._pose("belief", "row.first_pose", "row.first_turn")}
        belief["differences"] = tuple(self._difference(k) for k in range(model.object_size))
        arguments: dict[str, Any] = {
            "before": Fields(self.factor.name, "before", self._step("before", 0)),
            "now": Fields(self.factor.name, "now", self._step("now", model.step_size)),
            "belief": Fields(self.factor.name, "belief", belief),
            "measured": Fields(self.factor.name, "measured", self._measured()),
            "noise": Fields(self.factor.name, "noise", self._record("noise", self._settings_group())),
            "support": Fields(self.factor.name, "support", self._record("support", "support")),
            "known": Fields(
                self.factor.name, "known", {name: self._number(f"known_{name}") for name in self.factor.found}
            ),
        }
        for variable in model.shared:
            arguments[variable.name] = self._shared(variable)
        of_finger = [variable for variable in model.shared if variable.base and variable.finger == self.factor.finger]
        for variable in of_finger:
            arguments[variable.known_as] = arguments[variable.name]
        return arguments

    def _number(self, name: str, load: str | None = None, derivatives: dict[int, Any] | None = None) -> sympy.Symbol:
        symbol = sympy.Symbol(name, real=True)
        self.load[symbol] = load or name
        if derivatives:
            self.derivatives[symbol] = derivatives
        return symbol

    def _pose(self, name: str, load: str, turn: str, first_column: int | None = None) -> Pose:
        x = self._number(f"{name}_x", f"{load}[0]")
        y = self._number(f"{name}_y", f"{load}[1]")
        cos = self._number(f"{name}_cos", f"{turn}.real")
        sin = self._number(f"{name}_sin", f"{turn}.imag")
        angle = self._number(f"{name}_angle", f"{load}[2]")
        if first_column is not None:
            by_x = first_column
            by_y = first_column + 1
            by_angle = first_column + 2
            self.derivatives[x] = {by_x: cos, by_y: -sin}
            self.derivatives[y] = {by_x: sin, by_y: cos}
            self.derivatives[cos] = {by_angle: -sin}
            self.derivatives[sin] = {by_angle: cos}
            self.derivatives[angle] = {by_angle: sympy.Integer(1)}
        return Pose(Vector(x, y), cos, sin, angle)

    def _step(self, step: str, first_column: int) -> dict[str, Any]:
        """Return the symbols of a step, whose variables begin at a column."""
        fields: dict[str, Any] = {}
        for variable, place in self.model.in_step.items():
            name = variable.field
            column = first_column + place.start
            fields[name] = self._pose(f"{step}_{name}", f"{step}.{name}", f"{step}.turn_{name}", column)
        for name in self.model.step_poses:
            fields[name] = self._pose(f"{step}_{name}", f"{step}.{name}", f"{step}.turn_{name}")
        for name in self.model.step_numbers:
            fields[name] = self._number(f"{step}_{name}", f"{step}.{name}")
        fields["touch"] = self._touch(step, "touch", first_column)
        if self.factor.finger is not None:
            fields |= self._seen_by_finger(step, self.factor.finger, fields, first_column)
        return fields

    def _seen_by_finger(self, step: str, finger: int, fields: dict[str, Any], first_column: int) -> dict[str, Any]:
        """Return the fields of a finger in a step: its poses in place of the hand's, its contact and numbers."""
        hand_T_finger = self._pose(f"{step}_finger", f"{step}.finger[{finger}]", f"{step}.turn_finger[{finger}]")
        own = {variable.field: fields[variable.field].compose(hand_T_finger) for variable in self.model.of("step")}
        for name in self.model.finger_numbers:
            own[name] = self._number(f"{step}_{name}", f"{step}.{name}[{finger}]")
        own["touch"] = self._touch(step, f"touch_of[{finger}]", first_column)
        return own

    def _touch(self, step: str, record: str, first_column: int) -> Fields:
        """Return the contact geometry in a record of a step."""
        geometry = {name: self._geometry(step, record, name, first_column) for name in self._geometry_names()}
        return Fields(self.factor.name, f"{step}.touch", geometry)

    def _geometry_names(self) -> list[str]:
        return [name for name in self.model.geometry.names or () if "_by_" not in name]

    def _geometry(self, step: str, record: str, name: str, first_column: int) -> Any:
        """Return a number or a vector of the contact geometry, with its derivatives."""
        is_vector = self.model.geometry[name].kind == "c"
        parts = ("real", "imag") if is_vector else ("",)
        symbols: list[Any] = []
        for part, axis in zip(parts, ("x", "y"), strict=False):
            suffix = f".{part}" if part else ""
            label = f"{step}_{name}_{axis}" if part else f"{step}_{name}"
            derivatives: dict[int, Any] = {}
            for variable, place in self.model.in_step.items():
                by = f"{name}_by_{variable.field}"
                if by not in (self.model.geometry.names or ()):
                    continue
                for k in range(variable.dimension):
                    load = f"{step}.{record}.{by}[{k}]{suffix}"
                    derivatives[first_column + place.start + k] = self._number(f"{label}_by_{variable.field}{k}", load)
            symbols.append(self._number(label, f"{step}.{record}.{name}{suffix}", derivatives))
        return Vector(*symbols) if is_vector else symbols[0]

    def _shared(self, variable: Variable) -> Any:
        """Return a shared variable: a number, or a vector of two."""
        first = self.model.in_shared[variable].start
        column = self.model.column(variable)
        names = [variable.name] if variable.dimension == 1 else [f"{variable.name}_{axis}" for axis in "xy"]
        numbers = [
            self._number(name, f"row.shared[{first + k}]", {column + k: sympy.Integer(1)})
            for k, name in enumerate(names)
        ]
        return numbers[0] if variable.dimension == 1 else Vector(*numbers)

    def _difference(self, k: int) -> sympy.Symbol:
        """Return the difference of a number of the object's variables from the belief."""
        place = self.model.contact_size + k
        load = f"(row.shared[{place}] - row.first_values[{k}])"
        symbol = self._number(f"difference_{k}", load, {2 * self.model.step_size + place: sympy.Integer(1)})
        self.differences.append(symbol)
        return symbol

    def _measured(self) -> dict[str, Any]:
        numbers: dict[str, Any] = {
            name: self._number(f"measured_{name}", f"term.data[{k}]") for k, name in enumerate(self.factor.data)
        }
        numbers["variance"] = self._number("measured_variance", "term.variance")
        numbers["sign"] = self._number("sign", "row.sign if term.from_touch == 1.0 else 1.0")
        return numbers

    def _settings_group(self) -> str:
        return self.factor.settings or self.factor.name

    def _record(self, name: str, group: str) -> dict[str, Any]:
        """Return the symbols of a group of settings: numbers, tuples of them, or vectors."""
        if group not in (self.settings.names or ()):
            return {}
        record = self.settings[group]
        fields: dict[str, Any] = {}
        for key in record.names or ():
            load = f"settings.{group}.{key}"
            if record[key].shape:
                count = record[key].shape[0]
                fields[key] = tuple(self._number(f"{name}_{key}{k}", f"{load}[{k}]") for k in range(count))
            elif record[key].kind == "c":
                fields[key] = Vector(
                    self._number(f"{name}_{key}_x", f"{load}.real"), self._number(f"{name}_{key}_y", f"{load}.imag")
                )
            else:
                fields[key] = self._number(f"{name}_{key}", load)
        return fields
