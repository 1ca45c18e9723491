"""A variable: one quantity that a factor graph estimates."""

import math
from dataclasses import dataclass
from typing import Literal

from palpate.errors import SettingError

Gaussian = tuple[float, float]
"""Mean and standard deviation of each number of a variable."""
Scope = Literal["step", "contact", "object"]
"""Lifetime of a variable: one step, one contact, or the object and all its contacts."""


@dataclass(frozen=True)
class Variable:
    """One quantity that the graph estimates; equal by value, as a copied tracker has copies of them."""

    name: str
    """Name in residuals, settings, messages and `OwnMeasurement.on`."""
    scope: Scope
    """Lifetime. Variables of a step are planar poses with right (body-frame) perturbations; the others are vectors."""
    dimension: int = 1
    """Size: 3 of a pose, which is that of its tangent space; of the others 1, a number, or 2, a vector of the plane."""
    symbol: str = ""
    """Short name in formulas and in the records of steps; by default the name."""
    prior: Gaussian = (0.0, math.inf)
    """Belief before any measurement, of a variable that is not of a step; `palpate.config.Priors` takes its place for
    those that it names."""
    change: tuple[float, float] = (0.0, 0.0)
    """Change of a variable of the object from one contact to the next, and in each step of a contact, as shares of the
    prior's standard deviation."""
    finger: int = 0
    """Number of the finger whose contact it belongs to, in a model of several."""
    base: str = ""
    """Name by which factors of its finger and settings know it; by default its own."""

    def __post_init__(self) -> None:
        allowed = (3,) if self.scope == "step" else (1, 2)
        if self.dimension not in allowed:
            raise SettingError(f"variable {self.name!r} has dimension {self.dimension}; allowed are {allowed}")

    @property
    def known_as(self) -> str:
        """Name by which factors of its finger and settings know it."""
        return self.base or self.name

    @property
    def field(self) -> str:
        """Name of the field that holds a variable of a step."""
        return self.symbol or self.name
