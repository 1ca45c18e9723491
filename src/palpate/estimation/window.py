"""Smoother over the last steps of a contact: Gauss-Newton on a sliding window, older steps are marginalised.

All B hypotheses of a contact are rows of one window: every array has an axis B, which is the first but for that of
the steps (N, B), so that a step joins and leaves without a copy. To branch, prune and reorder hypotheses is to take
rows. The terms are shared by all rows; the rows differ in their values and their past.

Every frame relinearises the whole window once and its last steps several times, so that its cost does not grow with the
length of the contact. A step that leaves the window leaves a Gaussian on the next step and the shared variables (Schur
complement), linearised where that step was before the last Gauss-Newton step. With an unlimited lag this is the batch
solution.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array, Integers
from palpate.errors import EstimationError
from palpate.estimation.compiled_model import CompiledModel, Given
from palpate.estimation.model import Model
from palpate.types.measurements import OwnMeasurement

LAG = 40
"""Steps in a sliding window. With 20 or 30 the estimates are slightly less accurate."""
ITERATIONS = 4
"""Largest number of Gauss-Newton steps in a frame. With fewer, innovations of two standard deviations take two frames
to be fused."""
REMEMBERED = 1000
"""Steps that left the window whose costs still count, half a minute: older ones are forgotten."""


_NO_STEPS = np.empty(0, np.int64)


class OwnMeasurements(Protocol):
    """Measurements that bring their own residual."""

    given: list[tuple[int, OwnMeasurement]]
    """Measurements with their steps."""
    time: float
    """Time of the last frame [s]."""

    def evaluated(self, first: int, steps: NDArray[np.void], shared: Array) -> Array:
        """Return residuals and Jacobians (B, M, R, 1 + last size) at steps (N, B), of which `first` is the first."""
        ...


class Window:
    """The graph of one contact over its last steps, in B rows."""

    def __init__(
        self,
        compiled: CompiledModel,
        given: Given,
        steps: NDArray[np.void],
        rows: NDArray[np.void],
        lag: int,
        own: OwnMeasurements,
    ) -> None:
        """Take the first step (1, B) and the rows (B,), and the model with what its factors read."""
        self._compiled = compiled
        self._given = given
        self._lag = lag
        self._room = steps  # for steps of the window, which are those from `_first` on
        self._first = 0
        self._count = 1
        self.rows: NDArray[np.void] = rows
        """State of each row, `estimation.records.row_type` (B,)."""
        self.has_lost_rows = False
        """True if a row has no solution since its last Gauss-Newton steps."""
        self._left = 0  # number of steps that have left the window
        self._left_costs = np.empty((len(rows), 0, 3))  # of steps that left the window
        self._terms = np.empty((0, compiled.term_size))
        self._own = own
        self._own.given = []

    @property
    def model(self) -> Model:
        """Variables and factors."""
        return self._compiled.model

    @property
    def _steps(self) -> NDArray[np.void]:
        """The steps of the window in all rows, (N, B); see `estimation.records.step_type`."""
        return self._room[self._first : self._first + self._count]

    def take(self, rows: Integers | list[int]) -> None:
        """Keep these rows, in this order; a row may be taken several times."""
        self._make_room(rows)
        self.rows = _raw(self.rows)[rows].view(self._compiled.records.row)
        self._left_costs = self._left_costs[rows]

    def last(self, row: int) -> np.void:
        """Return the last step of a row; see `estimation.records.step_type`."""
        return self._steps[-1, row]

    def costs(self) -> Array:
        """Return the cost of each of the last steps (B, N, 3): minus its log likelihood, except for a constant.

        The first column is that of the measurements, the second that of the process, which holds only while nothing but
        the sensor moves the object, and the third is 1 where the second does not count. At most a thousand steps that
        left the window are included.
        """
        return np.concatenate([self._left_costs, self._steps["cost"].swapaxes(0, 1)], axis=1)

    def cost_of_belief(self) -> Array:
        """Return the cost (B,) of leaving the beliefs that the contact began with, while its first step is kept."""
        return self._steps["cost_of_belief"][0].copy()

    def count_all_costs(self) -> None:
        """Count the costs of the process in all steps so far."""
        self._left_costs[..., 2] = 0.0
        self._steps["cost"][..., 2] = 0.0

    def _next_step(self) -> NDArray[np.void]:
        """Add the next step and return it, (B,), all of it zero; the oldest one leaves a full window."""
        if self._count == self._lag:
            self._marginalise()
        if self._first + self._count == len(self._room):
            self._make_room(np.arange(len(self.rows)))
        self._count += 1
        step = self._steps[-1]
        step.view(np.uint8).fill(0)
        return step

    def _join(self, arrived: Array, own: list[tuple[int, OwnMeasurement]], time: float) -> None:
        """Take the terms that arrive with the last step, at a time [s]."""
        self._own.time = time
        self._own.given = [(step, measurement) for step, measurement in (*self._own.given, *own) if step >= self._left]
        self._terms = np.concatenate([self._terms, arrived])
        is_late = len(arrived) > 0 and arrived[0, 0] < self._left + self._count - 1
        if is_late:
            terms = self._terms[self._terms[:, 0] >= self._left]  # the step of a late one may have left the window
            self._terms = terms[np.lexsort((terms[:, 1], terms[:, 0]))]

    def _make_room(self, rows: Integers | list[int]) -> None:
        """Keep the steps of these rows, with room for as many again."""
        room = np.empty((2 * self._count, len(rows)), self._compiled.records.step)
        np.take(_raw(self._steps), rows, axis=1, out=_raw(room[: self._count]), mode="clip")
        self._room = room
        self._first = 0

    def _solve(self, recent: Integers) -> None:
        """Take Gauss-Newton steps, in which so many `recent` steps of each row (B,) are linearised every time.

        A row with 0 of them keeps its solution. Raises EstimationError where no row has a solution.
        """
        terms = self._terms.view(self._compiled.records.term)[:, 0]
        steps_of_own = _NO_STEPS
        linear = np.empty((len(self.rows), 0, 0, 0))
        # Own measurements are evaluated in Python, once for each Gauss-Newton step.
        calls = ITERATIONS if self._own.given else 1
        lost = 0
        for _ in range(calls):
            if self._own.given:
                linear = self._own.evaluated(self._left, self._steps, self.rows["shared"])
                steps_of_own = np.array([step for step, _ in self._own.given], np.int64)
            lost = self._compiled.improve(
                self._steps,
                self._left,
                self.rows,
                terms,
                (steps_of_own, linear),
                self._given,
                recent,
                ITERATIONS // calls,
            )
            if calls > 1 and not np.count_nonzero(recent):
                break
        self.has_lost_rows = lost > 0
        if lost == len(self.rows):
            raise EstimationError("the linear system of the window is indeterminate")

    def _marginalise(self) -> None:
        """Replace the oldest step by a Gaussian on the next one and the shared variables."""
        costs = np.concatenate([self._left_costs, self._steps["cost"][0][:, None]], axis=1)
        self._left_costs = costs[:, -REMEMBERED:]
        self.rows["past"] = self.rows["next_past"]
        self._first += 1
        self._count -= 1
        self._left += 1
        leaving = 0  # they are few
        while leaving < len(self._terms) and self._terms[leaving, 0] < self._left:
            leaving += 1
        self._terms = self._terms[leaving:]


def _raw(records: NDArray[np.void]) -> NDArray[np.void]:
    """Return the same records without their fields, since NumPy copies arrays of fields one by one."""
    return records.view(np.dtype((np.void, records.itemsize)))
