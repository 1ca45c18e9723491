"""What a factor is, and what solvers take from it.

A factor is one kind of term in the sum of squares that solvers make small: it says on which unknowns its terms are,
makes a term of what arrives with a step, and linearises all of its terms at given values. Solvers loop over factors and
know none of them by name. Jacobians are with respect to right (body-frame) perturbations of poses, order x, y, theta.
"""

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.estimation.compiled import Array, Places
from palpate.estimation.unknowns import IN_SHARED, IN_STEP, Unknown
from palpate.estimation.values import Values
from palpate.recording.measurements import Measurement

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

    @property
    def moved(self) -> float:
        """How far the sensor moved since the step before [m]."""
        return 0.0 if self.before is None else float(np.hypot(*(self.sensor_pose - self.before)[:2]))

    def of(self, kind: type[M]) -> list[M]:
        """Return the measurements of a kind that carries a time, but for those of a time that is not at hand.

        These are named in a warning.
        """
        slack = _SLACK if len(self.times) < 2 else 0.5 * (self.times[-1] - self.times[0]) / (len(self.times) - 1)
        found = []
        for one in self.measurements:
            if not isinstance(one, kind):
                continue
            time = getattr(one, "time", None)
            if time is None or self.times[0] - slack <= time <= self.times[-1] + slack:
                found.append(one)
            else:
                logger.warning(
                    "frame at %.3f s: measurement %s is of %s s, which is not between %.3f s and now; it is left out",
                    self.times[-1],
                    kind.__name__,
                    time,
                    self.times[0],
                )
        return found

    def places_of(self, measurements: Sequence[Any]) -> Places:
        """Return the places (T, 1) of the steps nearest to the times of measurements; 0 is this step."""
        last = len(self.times) - 1
        places = [0 if one.time is None else _nearest(self.times, one.time) - last for one in measurements]
        return np.array(places, np.int64)[:, None]


_MOST = 1000  # terms of a factor that arrive with one step
NOW, NOW_AND_BEFORE = np.zeros((_MOST, 1), np.int64), np.tile(np.array([[-1, 0]]), (_MOST, 1))
"""Places of terms on a step, and on the one before and it."""


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

    @classmethod
    def empty(cls, smoothers: int, terms: int, rows: int, columns: int) -> "Rows":
        """Return rows to be filled in."""
        shape = (smoothers, terms, rows)
        return cls(np.empty(shape), np.zeros((*shape, columns)), np.empty(shape), np.empty(shape))


class Factor(ABC):
    """One kind of term. A factor says on what it is by class attributes and does the rest in two methods."""

    name: ClassVar[str]
    """As settings and messages call it."""
    steps: ClassVar[tuple[tuple[Unknown, ...], ...]]
    """The unknowns of each step that a term is tied to, earlier steps first."""
    shared: ClassVar[tuple[Unknown, ...]] = ()
    """The unknowns that all steps share."""
    rows: ClassVar[int]
    """Rows of a term."""
    tells_strain: ClassVar[bool] = False
    """Whether its error tells that touch and pushing contradict each other."""
    is_motion: ClassVar[bool] = False
    """Whether it says how object and sensor move and not what is measured of them: a filter draws it."""
    holds_at_rest: ClassVar[bool] = False
    """Whether its terms hold while nothing touches the object, too."""
    takes: ClassVar[type[Measurement] | None] = None
    """The kind of measurement that it makes terms of; None if it needs none."""

    @property
    def columns(self) -> "Columns":
        """Where the columns of its Jacobian stand."""
        return columns_of(self.steps, self.shared)

    @abstractmethod
    def terms(self, step: Step) -> Terms | None:
        """Return the terms that arrive with a step, places counted from it (0 is the step, -1 the one before)."""

    @abstractmethod
    def linearise(self, at: Values, terms: Terms) -> Rows:
        """Return the terms linearised at the values; places are those of the values' steps."""

    def first_guess(self, at: Values, terms: Terms) -> dict[Unknown, Array]:
        """Return better values (B, dimension) of unknowns that its first terms of a contact bring into being."""
        return {}


class Columns(NamedTuple):
    """Where the columns of a factor's Jacobian stand among the unknowns."""

    slot: Places
    """Which of a term's steps a column belongs to (C,); -1 for what is shared."""
    place: Places
    """Which number of that step or of what is shared it is (C,)."""


def columns_of(steps: Sequence[Sequence[Unknown]], shared: Sequence[Unknown]) -> Columns:
    """Return where columns stand that follow these unknowns in order."""
    found = [(slot, at) for slot, unknowns in enumerate(steps) for one in unknowns for at in _range(IN_STEP[one])]
    found += [(-1, at) for one in shared for at in _range(IN_SHARED[one])]
    slot, place = np.array(found, np.int64).T
    return Columns(np.ascontiguousarray(slot), np.ascontiguousarray(place))


def _range(place: slice) -> range:
    return range(place.start, place.stop)


def terms_now(rows: Sequence[tuple[object, ...]], kind: np.dtype) -> Terms | None:
    """Return one term for each row of data, tied to the step that arrives."""
    if not rows:
        return None
    data = np.empty(len(rows), kind)
    for index, row in enumerate(rows):
        data[index] = row
    return Terms(NOW[: len(rows)], data)


def _nearest(times: Sequence[float], time: float) -> int:
    return int(np.argmin(np.abs(np.asarray(times) - time)))


def kernel_scale(kernel: float | None) -> float:
    """Return the scale of a Cauchy kernel; infinity where there is none."""
    return math.inf if kernel is None else kernel
