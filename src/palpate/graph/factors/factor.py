"""What a factor is, and what solvers take from it.

A factor is one kind of term in the sum of squares that solvers make small: it says on which unknowns its terms are,
makes a term of what arrives with a step, and linearises all of its terms at given values. Solvers loop over factors and
know none of them by name. Jacobians are with respect to right (body-frame) perturbations of poses, order x, y, theta.
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

from palpate.graph.compiled import Array, Places
from palpate.graph.values import Values
from palpate.graph.variables import IN_SHARED, IN_STEP, Unknown
from palpate.types.measurements import Measurement

logger = logging.getLogger(__name__)
M = TypeVar("M", bound=Measurement)
_SLACK = 0.02  # [s] by which a measurement may be of another time than the only step there is


@dataclass(frozen=True, eq=False)
class Step:
    """What arrives with a step of a contact."""

    sensor_pose: Array
    """Measured world_T_sensor, (3,) [m, m, rad]."""
    before: Array | None
    """That of the step before, (3,); None at the first step of a contact."""
    measurements: Sequence[Measurement]
    """What touch and others say."""
    times: Sequence[float]
    """Times of the steps that are still at hand, this one last [s]."""
    at_rest: bool = False
    """Whether nothing touches the object: its pose is all there is."""

    @cached_property
    def moved(self) -> float:
        """How far the sensor moved since the step before [m]."""
        if self.before is None:
            return 0.0
        return math.hypot(self.sensor_pose[0] - self.before[0], self.sensor_pose[1] - self.before[1])

    def of(self, kind: type[M]) -> list[M]:
        """Return the measurements of a kind that carries a time, but for those of a time that is not at hand.

        These are named in a warning.
        """
        found = []
        for one in self.measurements:
            if not isinstance(one, kind):
                continue
            if self.is_at_hand(one):
                found.append(one)
            else:
                logger.warning(
                    "frame at %.3f s: measurement %s is of %s s, which is not between %.3f s and now; it is left out",
                    self.times[-1],
                    kind.__name__,
                    getattr(one, "time", None),
                    self.times[0],
                )
        return found

    def is_at_hand(self, measurement: Measurement) -> bool:
        """Whether a measurement that may carry a time is of one that is at hand."""
        time = getattr(measurement, "time", None)
        slack = (
            _SLACK
            if self.at_rest or len(self.times) < 2
            else 0.5 * (self.times[-1] - self.times[0]) / (len(self.times) - 1)
        )
        return time is None or self.times[0] - slack <= time <= self.times[-1] + slack

    def places_of(self, measurements: Sequence[Any]) -> Places:
        """Return the places (T, 1) of the steps nearest to the times of measurements; 0 is this step."""
        last = len(self.times) - 1
        places = [0 if one.time is None else _nearest(self.times, one.time) - last for one in measurements]
        return np.array(places, np.int64)[:, None]


NOTHING = np.dtype([("nothing", np.int64)])
"""What terms hold that are compared with nothing that arrives."""


class Terms(NamedTuple):
    """Terms of one factor."""

    places: Places
    """The steps that each term is tied to, (T, K): as places in the window, or 0 for now and -1 for the step before."""
    data: NDArray[np.void]
    """What each term compares the values with, (T,) of the factor's own structured type."""


class Rows(NamedTuple):
    """The T terms of a factor, of R rows each, linearised for B smoothers."""

    residual: Array
    """(B, T, R)"""
    jacobian: Array
    """(B, T, R, C), one column for each number of the unknowns that the factor is on; see `Factor.columns`."""
    information: Array
    """Inverse variances without the factor's kernel, (B, T, R)."""
    weight: Array
    """Inverse variances with the kernel, (B, T, R)."""


class Factor(ABC):
    """One kind of term: class attributes say what it is on, `terms` what it is made of, `kernel` what it is."""

    name: ClassVar[str]
    """As settings and messages call it."""
    steps: ClassVar[tuple[tuple[Unknown, ...], ...]]
    """The unknowns of each step that a term is tied to, earlier steps first."""
    shared: ClassVar[tuple[Unknown, ...]] = ()
    """The unknowns that all steps share."""
    rows: ClassVar[int]
    """Rows of a term."""
    data: ClassVar[np.dtype]
    """What a term compares the values with: a structured type."""
    kernel: ClassVar[Callable[..., None]]
    """Linearises terms: a compiled function that takes `Values.state`, Terms, `given` and fills in Rows, as far as they
    are not 0. It reads like the formula, term by term."""
    given: tuple[Any, ...]
    """Settings that the kernel takes."""
    tells_strain: ClassVar[bool] = False
    """Whether its error tells that touch and pushing contradict each other."""
    reads_outline: ClassVar[bool] = True
    """Whether its kernel takes how the sensor touches the outline and the angle of the force."""
    is_motion: ClassVar[bool] = False
    """Whether it says how object and sensor move and not what is measured of them: a filter draws it."""
    is_of_pushing: ClassVar[bool] = False
    """Whether it holds only where nothing but the sensor moves the object; see `Knock`."""
    holds_at_rest: ClassVar[bool] = False
    """Whether its terms hold while nothing touches the object, too."""

    @cached_property
    def columns(self) -> "Columns":
        """Where the columns of its Jacobian stand."""
        return columns_of(self.steps, self.shared)

    @cached_property
    def _width(self) -> int:
        return int(self.columns.size.sum())

    @abstractmethod
    def terms(self, step: Step) -> Terms | None:
        """Return the terms that arrive with a step, places counted from it (0 is the step, -1 the one before)."""

    def linearise(self, at: Values, terms: Terms) -> Rows:
        """Return the terms linearised at the values; places are those of the values' steps."""
        rows = self.empty_rows(at.smoothers, len(terms.data))
        self.linearise_into(rows, at, terms)
        return rows

    def linearise_into(self, rows: Rows, at: Values, terms: Terms) -> None:
        """Linearise into rows that were made for as many terms."""
        type(self).kernel(at.state if self.reads_outline else at.poses, *terms, self.given, *rows)

    def empty_rows(self, smoothers: int, terms: int) -> Rows:
        """Return rows for so many smoothers and terms, to be filled in; Jacobians are 0."""
        shape = (smoothers, terms, self.rows)
        return Rows(np.empty(shape), np.zeros((*shape, self._width)), np.empty(shape), np.empty(shape))

    def first_guess(self, at: Values, terms: Terms) -> dict[Unknown, Array]:
        """Return better values (dimension, B) of the unknowns that its first term in a contact brings into being."""
        return {}


class Columns(NamedTuple):
    """Where the columns of a factor's Jacobian stand: for each of its steps in order, and last for what is shared."""

    first: Places
    """The first number of a step, or of what is shared, that it is on (K + 1,)."""
    size: Places
    """How many it is on from there (K + 1,)."""

    @property
    def slot(self) -> Places:
        """Which of a term's steps each column belongs to (C,); -1 for what is shared."""
        return np.repeat([*range(len(self.size) - 1), -1], self.size)

    @property
    def place(self) -> Places:
        """Which number of that step, or of what is shared, each column is (C,)."""
        return np.concatenate([first + np.arange(size) for first, size in zip(*self, strict=True)])


def columns_of(steps: Sequence[Sequence[Unknown]], shared: Sequence[Unknown]) -> Columns:
    """Return where columns stand that follow these unknowns in order, which is that of `unknowns`."""
    spans = [_span([IN_STEP[one] for one in unknowns]) for unknowns in steps]
    first, size = np.array([*spans, _span([IN_SHARED[one] for one in shared])], np.int64).T
    return Columns(np.ascontiguousarray(first), np.ascontiguousarray(size))


def _span(places: Sequence[slice]) -> tuple[int, int]:
    """First number and count of places that follow one another without a gap."""
    if any(before.stop != after.start for before, after in pairwise(places)):
        raise ValueError(
            f"places {places} of a factor's unknowns have gaps, or are in another order than unknowns.py has"
        )
    return (places[0].start, places[-1].stop - places[0].start) if places else (0, 0)


def term_now() -> Terms:
    """Return one term, tied to the step that arrives, which is compared with nothing."""
    return Terms(np.zeros((1, 1), np.int64), np.zeros(1, NOTHING))


def terms_now(rows: Sequence[tuple[object, ...]], kind: np.dtype) -> Terms | None:
    """Return one term for each row of data, tied to the step that arrives."""
    if not rows:
        return None
    data = np.empty(len(rows), kind)
    for index, row in enumerate(rows):
        data[index] = row
    return Terms(np.zeros((len(rows), 1), np.int64), data)


def _nearest(times: Sequence[float], time: float) -> int:
    return int(np.argmin(np.abs(np.asarray(times) - time)))


def kernel_scale(kernel: float | None) -> float:
    """Return the scale of a Cauchy kernel; infinity where there is none."""
    return math.inf if kernel is None else kernel
