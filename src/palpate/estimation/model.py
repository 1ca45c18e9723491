"""A model: the variables and factors of a graph, and their places in vectors and matrices.

A *step* has a vector of its own variables; the variables that all steps of a contact share form another one, first
those of the contact, then those of the object. The columns of a Jacobian are those of the step before, of this step,
and of the shared variables.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from palpate.errors import SettingError
from palpate.estimation.factor import READS, Factor, Steps
from palpate.estimation.variable import Scope, Variable

_STAGE: dict[Steps | None, int] = {"pair": 0, "every": 1, "first": 1, None: 2}
"""Order in which factors are added to the system."""


@dataclass(frozen=True, eq=False)
class Model:
    """Variables and factors, in the order of their places."""

    variables: tuple[Variable, ...]
    """All variables."""
    factors: tuple[Factor, ...]
    """All factors: those of pairs of steps, then those of every or the first step, then those of measurements."""
    geometry: np.dtype
    """Fields `now.touch`, computed from variables of the step; those with `_by_NAME` are derivatives by a variable."""
    step_numbers: tuple[str, ...] = ()
    """Further numbers of a step that factors read as `now.NAME`."""
    step_poses: tuple[str, ...] = ()
    """Known poses of a step that factors read as `now.NAME`."""
    fingers: int = 0
    """Number of fingers, each with a contact geometry of its own; 0 for one sensor, which has that of the step."""
    finger_numbers: tuple[str, ...] = ()
    """Further numbers of a step that each finger has, and that its factors read as `now.NAME`."""

    def __post_init__(self) -> None:
        for factor in self.factors:
            shared = [variable.name for variable in self.shared]
            for name in factor.variables:
                if name not in shared:
                    known = ", ".join((*shared, *READS))
                    raise SettingError(
                        f"factor {factor.name!r} reads {name!r}, which the model lacks; known are {known}"
                    )
        stages = [_STAGE[factor.steps] for factor in self.factors]
        if stages != sorted(stages):
            raise SettingError("factors of pairs of steps come first, and those of measurements last")

    def extended(self, variables: Sequence[Variable] = (), factors: Sequence[Factor] = ()) -> "Model":
        """Return the model with more variables and factors, such as of a sensor that palpate does not know."""
        before = [factor for factor in self.factors if factor.steps is not None]
        measured = [factor for factor in self.factors if factor.steps is None]
        pairs = [factor for factor in (*before, *factors) if factor.steps == "pair"]
        single = [factor for factor in (*before, *factors) if factor.steps in ("every", "first")]
        measured += [factor for factor in factors if factor.steps is None]
        return replace(self, variables=(*self.variables, *variables), factors=(*pairs, *single, *measured))

    def of(self, *scopes: Scope) -> tuple[Variable, ...]:
        """Return the variables of some scopes, in the order of these."""
        return tuple(variable for scope in scopes for variable in self.variables if variable.scope == scope)

    @cached_property
    def shared(self) -> tuple[Variable, ...]:
        """Variables that all steps of a contact share."""
        return self.of("contact", "object")

    @cached_property
    def step_size(self) -> int:
        """Numbers of one step."""
        return size(self.of("step"))

    @cached_property
    def shared_size(self) -> int:
        """Numbers of the shared variables."""
        return size(self.shared)

    @cached_property
    def object_size(self) -> int:
        """Numbers of the variables that belong to the object."""
        return size(self.of("object"))

    @cached_property
    def contact_size(self) -> int:
        """Numbers of the variables that belong to a contact."""
        return size(self.of("contact"))

    @property
    def last_size(self) -> int:
        """Numbers of one step and the shared variables."""
        return self.step_size + self.shared_size

    @property
    def width(self) -> int:
        """Numbers of two steps and the shared variables."""
        return 2 * self.step_size + self.shared_size

    @cached_property
    def in_shared(self) -> dict[Variable, slice]:
        """Places of variables in the vector of the shared ones."""
        return places(self.shared)

    @cached_property
    def in_object(self) -> dict[Variable, slice]:
        """Places of variables in the vector of the object's."""
        return places(self.of("object"))

    @cached_property
    def in_step(self) -> dict[Variable, slice]:
        """Places of variables in the vector of a step."""
        return places(self.of("step"))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the factors, and of measurements that bring their own residual."""
        return (*(factor.name for factor in self.factors), "own")

    def column(self, variable: Variable) -> int:
        """Return the first column of a shared variable in a Jacobian."""
        return 2 * self.step_size + self.in_shared[variable].start

    def prior_mean(self, variables: Sequence[Variable]) -> list[float]:
        """Return the prior mean of each number of some variables."""
        return [variable.prior[0] for variable in variables for _ in range(variable.dimension)]

    def prior_deviation(self, variables: Sequence[Variable]) -> list[float]:
        """Return the prior standard deviation of each number of some variables."""
        return [variable.prior[1] for variable in variables for _ in range(variable.dimension)]

    @cached_property
    def factors_by_measurement(self) -> dict[tuple[type, int], int]:
        """Places of the factors that measurements bring, by the class of these and the finger, 0 without fingers."""
        return {
            (factor.measurement, factor.finger or 0): k
            for k, factor in enumerate(self.factors)
            if factor.measurement is not None
        }


def size(variables: Sequence[Variable]) -> int:
    """Return the number of numbers of some variables."""
    return sum(variable.dimension for variable in variables)


def places(variables: Sequence[Variable]) -> dict[Variable, slice]:
    """Return the places of variables in the vector that holds them in this order."""
    ends = np.cumsum([variable.dimension for variable in variables]).tolist()
    return {variable: slice(end - variable.dimension, end) for variable, end in zip(variables, ends, strict=True)}
