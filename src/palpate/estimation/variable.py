"""A variable: one quantity that a factor graph estimates."""

import math
from dataclasses import dataclass
from typing import Literal

Gaussian = tuple[float, float]
"""Mean and standard deviation of each number of a variable."""
Scope = Literal["step", "contact", "object"]
"""Lifetime of a variable: one step, one contact, or the object and all its contacts."""


@dataclass(frozen=True, eq=False)
class Variable:
    """One quantity that the graph estimates."""

    name: str
    """Name in residuals, settings, messages and `OwnMeasurement.on`."""
    scope: Scope
    """Lifetime. Variables of a step are planar poses with right (body-frame) perturbations; the others are vectors."""
    dimension: int = 1
    """Size; of a pose, that of its tangent space."""
    symbol: str = ""
    """Short name in formulas and in the records of steps; by default the name."""
    prior: Gaussian = (0.0, math.inf)
    """Belief before any measurement, of a variable that is not of a step."""
    change: tuple[float, float] = (0.0, 0.0)
    """Change of a variable of the object from one contact to the next, and in each step of a contact, as shares of the
    prior's standard deviation."""

    @property
    def field(self) -> str:
        """Name of the field that holds a variable of a step."""
        return self.symbol or self.name
