"""A model as compiled code takes it: sizes, the kinds of its factors, and compiled functions."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from palpate.arrays import Array, Integers, Records
from palpate.compiled import Compiled, kernel
from palpate.estimation.eliminate import Elimination, elimination
from palpate.estimation.factor import Role
from palpate.estimation.model import Model
from palpate.estimation.records import RecordTypes

MEASUREMENT = 0
PROCESS = 1
BELIEF = 2
"""Roles of factors in compiled code; see `estimation.factor.Role`."""
ROLES: dict[Role, int] = {"measurement": MEASUREMENT, "process": PROCESS, "belief": BELIEF}


class Functions(NamedTuple):
    """A model as compiled code takes it: sizes, kinds of factors, and compiled functions."""

    step_size: int
    """Numbers of a step."""
    shared_size: int
    """Numbers of the shared variables."""
    pairs: int
    """Number of factors of pairs of steps, which come first."""
    step_factors: int
    """Number of all factors that steps have without a measurement."""
    factors: int
    """Number of all factors."""
    elimination: Elimination
    """Compiled elimination for these sizes."""
    roles: tuple[int, ...]
    """Role of each factor."""
    is_first: tuple[bool, ...]
    """True for factors of the first step of a contact alone."""
    is_compared: tuple[bool, ...]
    """True for factors whose residuals are innovations."""
    move_step: Any
    """Perturb the variables of a step."""
    copy_step: Any
    """Copy the variables of a step to a past one."""
    difference: Any
    """Write the tangent vector from a past step to this one."""
    prepare_step: Any
    """Write what several factors read at a step, such as contact geometry."""
    prepare_process: Any
    """Write what factors of pairs read and what depends on several steps."""
    prepare_last: Any
    """Write the same for the last step once the steps have moved."""
    put_object_pose: Any
    """Write the pose of the object that follows from the variables of a step."""
    put_object_derivative: Any
    """Write the derivative of that pose by the variables of the step."""
    linearise_step: Any
    """Linearise a factor that needs no measurement."""
    linearise_measured: Any
    """Linearise the factor of a measurement."""


Own = tuple[Integers, Array]
"""Steps (M,) of measurements with their own residual, and their rows, (B, M, R, 1 + last size) or those of one row."""


class Given(NamedTuple):
    """Inputs that stay the same for a window."""

    settings: Records
    """Settings that factors read, (1,)."""
    drift: Array
    """Variances by which numbers of the last step and shared variables change from step to step; within the window
    these count as constant."""
    surface: Any
    """The surfaces in contact, from which steps are prepared."""
    places: Array
    """Table (K, C) in which factors look up what no formula gives."""
    work: Records
    """Room for computing, (1,)."""


@dataclass(frozen=True, eq=False)
class CompiledModel:
    """A model with its records and the compiled functions that Python calls."""

    model: Model
    """Variables and factors."""
    records: RecordTypes
    """Types of its records."""
    improve: Compiled
    """Take Gauss-Newton steps of some rows of a window; see `estimation.gauss_newton`."""
    begin_step: Compiled
    """Give the last of the steps its first values."""

    @cached_property
    def term_size(self) -> int:
        """Numbers of a term."""
        return self.records.term.itemsize // 8

    @cached_property
    def term_data(self) -> int:
        """Largest number of numbers that a measurement has besides its variance."""
        return self.records.term["data"].shape[0]


def functions_of(model: Model, **functions: Any) -> Functions:
    """Return a model for compiled code, with the compiled functions that its generated module and folder define."""
    return Functions(
        step_size=model.step_size,
        shared_size=model.shared_size,
        pairs=sum(factor.steps == "pair" for factor in model.factors),
        step_factors=sum(factor.steps is not None for factor in model.factors),
        factors=len(model.factors),
        elimination=elimination(model.step_size, model.shared_size),
        roles=tuple(ROLES[factor.role] for factor in model.factors),
        is_first=tuple(factor.steps == "first" for factor in model.factors),
        is_compared=tuple(factor.is_compared for factor in model.factors),
        **functions,
    )


@kernel
def copy_own(step_size: int, own: Array, out: Records) -> int:
    """Write the rows (R, 1 + last size) of a measurement with its own residual, and return their number."""
    for r in range(len(own)):
        out.residual[r] = own[r, 0]
        out.information[r] = 1.0
        out.weight[r] = 1.0
        for c in range(own.shape[1] - 1):
            out.jacobian[r, step_size + c] = own[r, 1 + c]
    return len(own)
