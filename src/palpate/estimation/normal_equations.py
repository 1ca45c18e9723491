"""The normal equations of a window of steps: summed from the rows of factors, and solved.

Unknowns are those of every step in order from the oldest, and last those that all steps share. Where terms tie only
neighbours, the matrix is block-tridiagonal with a border of what is shared (`BandedEquations`), and a solution costs a
time in proportion to the steps; where pairs tie all, it is dense (`DenseEquations`). Both hold lower triangles only,
and both have a leading axis of smoothers that are solved side by side.
"""

import math
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from threadpoolctl import ThreadpoolController

from palpate.compiled import Array, Places, compiled
from palpate.errors import EstimationError
from palpate.estimation.factors.factor import Columns, Rows
from palpate.estimation.unknowns import SHARED_SIZE, STEP_SIZE

LAST_SIZE = STEP_SIZE + SHARED_SIZE
"""Numbers of the last step and of what is shared."""


class Solution(NamedTuple):
    """The Gauss-Newton step of B smoothers."""

    by_step: Array
    """Change of the steps, (B, N, STEP_SIZE)."""
    by_shared: Array
    """Change of what they share, (B, SHARED_SIZE)."""
    covariance: Array
    """Joint covariance of the last step and what is shared, (B, LAST_SIZE, LAST_SIZE)."""


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A Gaussian on the oldest steps and what is shared, as it is at some values."""

    steps: int
    """How many of the oldest steps it is on: N."""
    information: Array
    """(B, N STEP_SIZE + SHARED_SIZE, the same)"""
    gradient: Array
    """Negative gradient, (B, N STEP_SIZE + SHARED_SIZE)."""

    def moved(self, change: Array) -> "Gaussian":
        """Return it as it is where the unknowns have changed by so much, (B, N STEP_SIZE + SHARED_SIZE)."""
        gradient = np.empty_like(self.gradient)
        _put_gradient(self.information, self.gradient, change, gradient)
        return Gaussian(self.steps, self.information, gradient)


class BandedEquations:
    """Equations of terms that tie no more than a step and the next one."""

    @staticmethod
    def threads() -> AbstractContextManager[object]:
        """Return the context in which to solve."""
        return nullcontext()

    def __init__(self, smoothers: int, steps: int) -> None:
        size, shared = STEP_SIZE, SHARED_SIZE
        self._own = np.zeros((smoothers, steps, size, size))
        self._next = np.zeros((smoothers, max(steps - 1, 0), size, size))
        self._border = np.zeros((smoothers, steps, shared, size))
        self._corner = np.zeros((smoothers, shared, shared))
        self._gradient = np.zeros((smoothers, steps, size))
        self._edge = np.zeros((smoothers, shared))

    def add(self, rows: Rows, places: Places, columns: Columns) -> None:
        """Add the squares of a factor's rows."""
        parts = self._own, self._next, self._border, self._corner, self._gradient, self._edge
        _add_banded(rows.residual, rows.jacobian, rows.weight, places, *columns, *parts)

    def add_gaussian(self, gaussian: Gaussian) -> None:
        """Add a Gaussian on one step at most."""
        end = STEP_SIZE * gaussian.steps
        information, gradient = gaussian.information, gaussian.gradient
        if end:
            self._own[:, 0] += information[:, :end, :end]
            self._border[:, 0] += information[:, end:, :end]
            self._gradient[:, 0] += gradient[:, :end]
        self._corner += information[:, end:, end:]
        self._edge += gradient[:, end:]

    def solve(self) -> Solution:
        """Return the solution; raises EstimationError where there is none."""
        covariance = np.empty((len(self._edge), LAST_SIZE, LAST_SIZE))
        parts = self._own, self._next, self._border, self._corner, self._gradient, self._edge
        if not _solve_banded(*parts, covariance):
            raise EstimationError("the linear system of the window is indeterminate")
        return Solution(self._gradient, self._edge, covariance)


class DenseEquations:
    """Equations of terms that tie any steps."""

    @staticmethod
    def threads() -> AbstractContextManager[object]:
        """Return the context in which to solve: BLAS on one thread.

        Matrices this small gain nothing from its threads, and wait for them for half a second whenever another process
        holds a core.
        """
        return _threads().limit(limits=1, user_api="blas")

    def __init__(self, smoothers: int, steps: int) -> None:
        self._size = STEP_SIZE * steps
        self._matrix = np.zeros((smoothers, self._size + SHARED_SIZE, self._size + SHARED_SIZE))
        self._vector = np.zeros((smoothers, self._size + SHARED_SIZE))

    def add(self, rows: Rows, places: Places, columns: Columns, of_oldest: bool = False) -> None:
        """Add the squares of a factor's rows, or of those among them that are tied to the oldest step."""
        matrix, vector = self._matrix, self._vector
        _add_dense(rows.residual, rows.jacobian, rows.weight, places, *columns, of_oldest, matrix, vector)

    def add_gaussian(self, gaussian: Gaussian) -> None:
        """Add a Gaussian."""
        _add_gaussian(gaussian.information, gaussian.gradient, STEP_SIZE * gaussian.steps, self._matrix, self._vector)

    def solve(self) -> Solution:
        """Return the solution; raises EstimationError where there is none."""
        from scipy.linalg import LinAlgError, cho_factor, cho_solve

        covariance = np.empty((len(self._vector), LAST_SIZE, LAST_SIZE))
        change = np.empty_like(self._vector)
        for matrix, vector, end, solved in zip(self._matrix, self._vector, covariance, change, strict=True):
            try:
                # Transposed, the matrix is in LAPACK's order and need not be copied.
                root, _ = factor = cho_factor(matrix.T, overwrite_a=True, check_finite=False)
            except LinAlgError:
                raise EstimationError("the linear system of the window is indeterminate") from None
            solved[:] = cho_solve(factor, vector, check_finite=False)
            last = np.linalg.inv(np.triu(root[-LAST_SIZE:, -LAST_SIZE:]))
            end[:] = last @ last.T
        if not np.isfinite(change).all():
            raise EstimationError("the solution of the window is not finite")
        return Solution(
            change[:, : self._size].reshape(len(change), -1, STEP_SIZE), change[:, self._size :], covariance
        )

    def without_oldest(self) -> Gaussian:
        """Return what remains on the other steps and what is shared when the oldest step is eliminated."""
        smoothers, rest = len(self._vector), self._size + SHARED_SIZE - STEP_SIZE
        left, gradient = np.empty((smoothers, rest, rest)), np.empty((smoothers, rest))
        if not _eliminate_first(self._matrix, self._vector, left, gradient):
            raise EstimationError("the step that leaves the window is indeterminate")
        return Gaussian(self._size // STEP_SIZE - 1, left, gradient)


@cache
def _threads() -> ThreadpoolController:
    return ThreadpoolController()


@compiled
def _put_gradient(information: Array, gradient: Array, change: Array, out: Array) -> None:
    for b in range(len(gradient)):
        for i in range(gradient.shape[1]):
            total = gradient[b, i]
            for j in range(gradient.shape[1]):
                total -= information[b, i, j] * change[b, j]
            out[b, i] = total


@compiled
def _add_banded(
    residual: Array,
    jacobian: Array,
    weight: Array,
    places: Places,
    first: Places,
    count: Places,
    own: Array,
    nearby: Array,
    border: Array,
    corner: Array,
    gradient: Array,
    edge: Array,
) -> None:
    smoothers, terms, rows = residual.shape
    slots = len(first) - 1
    for b in range(smoothers):
        for t in range(terms):
            for r in range(rows):
                row, w, off = jacobian[b, t, r], weight[b, t, r], residual[b, t, r]
                start = 0
                for slot in range(slots):
                    k, at, size = places[t, slot], first[slot], count[slot]
                    for i in range(size):
                        pull = w * row[start + i]
                        gradient[b, k, at + i] -= pull * off
                        for j in range(i + 1):
                            own[b, k, at + i, at + j] += pull * row[start + j]
                        if slot > 0:
                            for j in range(count[slot - 1]):
                                nearby[b, k - 1, at + i, first[slot - 1] + j] += pull * row[j]
                    start += size
                at, size = first[slots], count[slots]
                for i in range(size):
                    pull = w * row[start + i]
                    edge[b, at + i] -= pull * off
                    for j in range(i + 1):
                        corner[b, at + i, at + j] += pull * row[start + j]
                    before = 0
                    for slot in range(slots):
                        for j in range(count[slot]):
                            border[b, places[t, slot], at + i, first[slot] + j] += pull * row[before + j]
                        before += count[slot]


@compiled
def _add_dense(
    residual: Array,
    jacobian: Array,
    weight: Array,
    places: Places,
    first: Places,
    count: Places,
    of_oldest: bool,
    matrix: Array,
    vector: Array,
) -> None:
    smoothers, terms, rows, columns = jacobian.shape
    slots, shared = len(first) - 1, matrix.shape[1] - SHARED_SIZE
    index = np.empty(columns, np.int64)
    for b in range(smoothers):
        for t in range(terms):
            if of_oldest and places[t, 0] > 0:
                continue
            column = 0
            for slot in range(slots + 1):
                start = first[slot] + (STEP_SIZE * places[t, slot] if slot < slots else shared)
                for c in range(count[slot]):
                    index[column] = start + c
                    column += 1
            for r in range(rows):
                row, w = jacobian[b, t, r], weight[b, t, r]
                for i in range(columns):
                    pull = w * row[i]
                    if pull == 0.0:
                        continue
                    vector[b, index[i]] -= pull * residual[b, t, r]
                    for j in range(i + 1):
                        matrix[b, index[i], index[j]] += pull * row[j]


@compiled
def _add_gaussian(information: Array, gradient: Array, steps_end: int, matrix: Array, vector: Array) -> None:
    size = gradient.shape[1]
    beyond = vector.shape[1] - size  # what is shared stands after all steps
    for b in range(len(gradient)):
        for i in range(size):
            row = i if i < steps_end else i + beyond
            vector[b, row] += gradient[b, i]
            for j in range(min(i + 1, steps_end)):
                matrix[b, row, j] += information[b, i, j]
            for j in range(steps_end, i + 1):
                matrix[b, row, j + beyond] += information[b, i, j]


@compiled
def _root(matrix: Array, size: int) -> bool:
    """Replace the lower triangle of a leading block by its Cholesky root; False where it has none."""
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i > j:
                matrix[i, j] = total / matrix[j, j]
            elif total > 0.0:  # False for NaN as well
                matrix[i, i] = math.sqrt(total)
            else:
                return False
    return True


@compiled
def _over_root(rows: Array, root: Array) -> None:
    """Replace rows X (R, D) by X root^-T, with root (D, D) lower triangular."""
    for r in range(rows.shape[0]):
        for i in range(STEP_SIZE):
            total = rows[r, i]
            for k in range(i):
                total -= rows[r, k] * root[i, k]
            rows[r, i] = total / root[i, i]


@compiled
def _solve_banded(
    own: Array, nearby: Array, border: Array, corner: Array, gradient: Array, edge: Array, covariance: Array
) -> bool:
    """Solve in place: gradient and edge become the changes, covariance that of the last step and what is shared.

    A block Cholesky factorisation from the oldest step to the newest, what is shared last. False where there is none.
    """
    smoothers, steps = gradient.shape[:2]
    last = np.zeros((LAST_SIZE, LAST_SIZE))
    inverse = np.zeros((LAST_SIZE, LAST_SIZE))
    for b in range(smoothers):
        for k in range(steps):
            root, y = own[b, k], gradient[b, k]
            if not _root(root, STEP_SIZE):
                return False
            for i in range(STEP_SIZE):
                for j in range(i):
                    y[i] -= root[i, j] * y[j]
                y[i] /= root[i, i]
            _over_root(border[b, k], root)
            for i in range(SHARED_SIZE):
                for c in range(STEP_SIZE):
                    edge[b, i] -= border[b, k, i, c] * y[c]
                for j in range(i + 1):
                    for c in range(STEP_SIZE):
                        corner[b, i, j] -= border[b, k, i, c] * border[b, k, j, c]
            if k + 1 < steps:
                ahead = nearby[b, k]
                _over_root(ahead, root)
                for i in range(STEP_SIZE):
                    for c in range(STEP_SIZE):
                        gradient[b, k + 1, i] -= ahead[i, c] * y[c]
                    for j in range(i + 1):
                        for c in range(STEP_SIZE):
                            own[b, k + 1, i, j] -= ahead[i, c] * ahead[j, c]
                for i in range(SHARED_SIZE):
                    for j in range(STEP_SIZE):
                        for c in range(STEP_SIZE):
                            border[b, k + 1, i, j] -= border[b, k, i, c] * ahead[j, c]
        if not _root(corner[b], SHARED_SIZE):
            return False
        for i in range(LAST_SIZE):
            for j in range(i + 1):
                if i < STEP_SIZE:
                    last[i, j] = own[b, steps - 1, i, j]
                elif j < STEP_SIZE:
                    last[i, j] = border[b, steps - 1, i - STEP_SIZE, j]
                else:
                    last[i, j] = corner[b, i - STEP_SIZE, j - STEP_SIZE]
        for j in range(LAST_SIZE):
            for i in range(j, LAST_SIZE):
                total = 1.0 if i == j else 0.0
                for k in range(j, i):
                    total -= last[i, k] * inverse[k, j]
                inverse[i, j] = total / last[i, i]
        for i in range(LAST_SIZE):
            for j in range(LAST_SIZE):
                total = 0.0
                for k in range(max(i, j), LAST_SIZE):
                    total += inverse[k, i] * inverse[k, j]
                covariance[b, i, j] = total
        for i in range(SHARED_SIZE):
            for j in range(i):
                edge[b, i] -= corner[b, i, j] * edge[b, j]
            edge[b, i] /= corner[b, i, i]
        for i in range(SHARED_SIZE - 1, -1, -1):
            for j in range(i + 1, SHARED_SIZE):
                edge[b, i] -= corner[b, j, i] * edge[b, j]
            edge[b, i] /= corner[b, i, i]
        for k in range(steps - 1, -1, -1):
            root, y = own[b, k], gradient[b, k]
            for c in range(STEP_SIZE):
                for i in range(SHARED_SIZE):
                    y[c] -= border[b, k, i, c] * edge[b, i]
                if k + 1 < steps:
                    for i in range(STEP_SIZE):
                        y[c] -= nearby[b, k, i, c] * gradient[b, k + 1, i]
            for i in range(STEP_SIZE - 1, -1, -1):
                for j in range(i + 1, STEP_SIZE):
                    y[i] -= root[j, i] * y[j]
                y[i] /= root[i, i]
                if not math.isfinite(y[i]):
                    return False
    return True


@compiled
def _eliminate_first(matrix: Array, vector: Array, left: Array, gradient: Array) -> bool:
    """Put what is left of the equations without the first step into left and gradient; False where it has no root."""
    size = STEP_SIZE
    for b in range(len(vector)):
        if not _root(matrix[b], size):
            return False
        root, y = matrix[b, :size, :size], vector[b]
        for i in range(size):
            for j in range(i):
                y[i] -= root[i, j] * y[j]
            y[i] /= root[i, i]
        rest = matrix[b, size:]
        _over_root(rest, root)
        for i in range(len(rest)):
            total = vector[b, size + i]
            for c in range(size):
                total -= rest[i, c] * y[c]
            gradient[b, i] = total
            for j in range(i + 1):
                total = rest[i, size + j]
                for c in range(size):
                    total -= rest[i, c] * rest[j, c]
                left[b, i, j] = left[b, j, i] = total
    return True
