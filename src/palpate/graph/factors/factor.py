"""Interface between factors and the window.

A factor is one kind of term of the objective. It names the variables its terms depend on, creates terms from what
arrives with a step, and linearises all its terms at given values. Each term belongs to one step, and depends on that
step or on that step and the one before. Jacobians are with respect to right (body-frame) perturbations of poses, in the
order x, y, theta.
"""

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.graph.compiled import Array, Integers
from palpate.graph.values import Values
from palpate.graph.variables import IN_SHARED, IN_STEP, Variable
from palpate.types.measurements import Measurement

logger = logging.getLogger(__name__)
M = TypeVar("M", bound=Measurement)
_SLACK = 0.02  # [s] tolerance on a measurement's time if there is only one step


@dataclass(frozen=True, eq=False)
class Step:
    """Input of one step of a contact."""

    sensor_pose: Array
    """Measured world_T_sensor, (3,) [m, m, rad]."""
    before: Array | None
    """Sensor pose of the step before, (3,); None at the first step of a contact."""
    measurements: Sequence[Measurement]
    """Measurements from touch and other sources."""
    times: Sequence[float]
    """Times of the steps in the window, this one last [s]."""
    at_rest: bool = False
    """True if nothing touches the object; its pose is then the only variable of a step."""
    from_touch: int = 0
    """Number of leading measurements that were read from touch images, which may be mirrored."""

    @cached_property
    def moved(self) -> float:
        """Distance of the sensor from the step before [m]."""
        if self.before is None:
            return 0.0
        return math.hypot(self.sensor_pose[0] - self.before[0], self.sensor_pose[1] - self.before[1])

    def timed(self, kind: type[M]) -> list[M]:
        """Return the measurements of a kind that carries a time; warns of those outside the window and omits them."""
        found = []
        for one in self.measurements:
            if not isinstance(one, kind):
                continue
            if self.is_in_window(one):
                found.append(one)
            else:
                logger.warning(
                    "frame at %.3f s: measurement %s has time %s s, which is not between %.3f s and now; it is left "
                    "out",
                    self.times[-1],
                    kind.__name__,
                    getattr(one, "time", None),
                    self.times[0],
                )
        return found

    def is_in_window(self, measurement: Measurement) -> bool:
        """Return True if the time of a measurement, if it has one, is within the window."""
        time, times = getattr(measurement, "time", None), self.times
        single = self.at_rest or len(times) < 2
        slack = _SLACK if single else 0.5 * (times[-1] - times[0]) / (len(times) - 1)
        return time is None or times[0] - slack <= time <= times[-1] + slack

    def nearest(self, measurements: Sequence[Any]) -> Integers:
        """Return the steps (T,) nearest to the times of measurements; 0 is this step, -1 the one before."""
        last = len(self.times) - 1
        times = np.asarray(self.times)
        steps = [0 if one.time is None else int(np.argmin(np.abs(times - one.time))) - last for one in measurements]
        return np.array(steps, np.int64)


NOTHING = np.dtype([("nothing", np.int64)])
"""Data of terms without any."""


class Terms(NamedTuple):
    """Terms of one factor."""

    step: Integers
    """Step of each term (T,): its place in the window or, in a term that arrives, relative to the new step."""
    data: NDArray[np.void]
    """Measured values and weights of each term, (T,) of the factor's structured type."""


class Linear(NamedTuple):
    """T terms of R residual rows, linearised for B hypotheses."""

    residual: Array
    """(B, T, R)"""
    jacobian: Array
    """(B, T, R, C); columns as `Factor.columns` has them."""
    information: Array
    """Inverse variances without the robust kernel, (B, T, R)."""
    weight: Array
    """Inverse variances times the weight of the robust kernel, (B, T, R)."""


class Columns(NamedTuple):
    """Columns of a factor's Jacobian: those of each of its steps in order, and last those of shared variables."""

    first: Integers
    """First number in the vector of a step, or of the shared variables (S + 1,)."""
    size: Integers
    """Count of numbers from there (S + 1,)."""


class Factor(ABC):
    """One kind of term."""

    name: ClassVar[str]
    """Name in settings and messages."""
    on: ClassVar[tuple[Variable, ...]]
    """Variables of each step that a term depends on, adjacent in the step's vector."""
    spans: ClassVar[int] = 1
    """Number of steps that a term depends on: 1, or 2 for a step and the one before."""
    shared: ClassVar[tuple[Variable, ...]] = ()
    """Shared variables that a term depends on, adjacent in their vector."""
    rows: ClassVar[int]
    """Residual rows of a term."""
    data: ClassVar[np.dtype] = NOTHING
    """Structured type of a term's data."""
    kernel: ClassVar[Callable[..., None]]
    """Compiled function that linearises all terms: kernel(state, step, data, given, out)."""
    given: tuple[Any, ...] = ()
    """Settings for the kernel."""
    is_of_pushing: ClassVar[bool] = False
    """True if the factor holds only while nothing but the sensor moves the object."""
    is_consistency_test: ClassVar[bool] = False
    """True if large residuals show that touch and pushing contradict each other."""
    holds_at_rest: ClassVar[bool] = False
    """True if the factor also holds while nothing touches the object."""

    @cached_property
    def columns(self) -> Columns:
        """Columns of the Jacobian."""
        spans = [_span([IN_STEP[one] for one in self.on])] * self.spans
        first, size = np.array([*spans, _span([IN_SHARED[one] for one in self.shared])], np.int64).T
        return Columns(np.ascontiguousarray(first), np.ascontiguousarray(size))

    @abstractmethod
    def terms(self, step: Step) -> Terms | None:
        """Return the terms that arrive with a step; their step is relative to it."""

    def room(self, rows: int, terms: int) -> Linear:
        """Return arrays for B hypotheses and T terms; Jacobians are 0."""
        shape = (rows, terms, self.rows)
        jacobian = np.zeros((*shape, int(self.columns.size.sum())))
        return Linear(np.empty(shape), jacobian, np.empty(shape), np.empty(shape))

    def linearise(self, at: Values, terms: Terms, out: Linear | None = None) -> Linear:
        """Return the terms linearised at values, written to `out` if given."""
        out = self.room(at.rows, len(terms.step)) if out is None else out
        type(self).kernel(at.state, terms.step, terms.data, self.given, out)
        return out

    def first_guess(self, at: Values, terms: Terms) -> dict[Variable, Array]:
        """Return better values (B, dimension) of the shared variables that its first term of a contact determines."""
        return {}


def _span(places: Sequence[slice]) -> tuple[int, int]:
    """Return the first number and the count of adjacent places."""
    if any(before.stop != after.start for before, after in pairwise(places)):
        raise ValueError(f"places {places} of a factor's variables are not adjacent, in the order of variables.py")
    return (places[0].start, places[-1].stop - places[0].start) if places else (0, 0)


def term_now() -> Terms:
    """Return one term without data, at the new step."""
    return Terms(np.zeros(1, np.int64), np.zeros(1, NOTHING))


def kernel_scale(kernel: float | None) -> float:
    """Return the scale of a Cauchy kernel; infinite if there is none."""
    return math.inf if kernel is None else kernel
