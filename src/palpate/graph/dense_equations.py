"""Normal equations of terms that tie any steps, as pairs of images do; and how a step is eliminated from them."""

from contextlib import AbstractContextManager
from functools import cache

import numpy as np
from threadpoolctl import ThreadpoolController

from palpate.graph.compiled import Array, Places, compiled
from palpate.graph.factors.factor import Columns, Rows
from palpate.graph.normal_equations import LAST_SIZE, Gaussian, Solution, cholesky_root, divide_by_root
from palpate.graph.variables import SHARED_SIZE, STEP_SIZE


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
        """Return the solution."""
        from scipy.linalg import LinAlgError, cho_factor, cho_solve

        covariance = np.empty((len(self._vector), LAST_SIZE, LAST_SIZE))
        change = np.zeros_like(self._vector)
        is_found = np.zeros(len(change), np.bool_)
        for b, (matrix, vector) in enumerate(zip(self._matrix, self._vector, strict=True)):
            try:
                # Transposed, the matrix is in LAPACK's order and need not be copied.
                root, _ = factor = cho_factor(matrix.T, overwrite_a=True, check_finite=False)
            except LinAlgError:
                continue
            solved = cho_solve(factor, vector, check_finite=False)
            if np.isfinite(solved).all():
                last = np.linalg.inv(np.triu(root[-LAST_SIZE:, -LAST_SIZE:]))
                change[b], covariance[b], is_found[b] = solved, last @ last.T, True
        return Solution(
            change[:, : self._size].reshape(len(change), -1, STEP_SIZE), change[:, self._size :], covariance, is_found
        )

    def without_oldest(self) -> Gaussian:
        """Return what remains on the other steps and what is shared when the oldest step is eliminated.

        It is NaN where that step is indeterminate, and no solution is found then.
        """
        smoothers, rest = len(self._vector), self._size + SHARED_SIZE - STEP_SIZE
        left, gradient = np.empty((smoothers, rest, rest)), np.empty((smoothers, rest))
        _eliminate_first(self._matrix, self._vector, left, gradient)
        return Gaussian(self._size // STEP_SIZE - 1, left, gradient)


@cache
def _threads() -> ThreadpoolController:
    return ThreadpoolController()


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
def _eliminate_first(matrix: Array, vector: Array, left: Array, gradient: Array) -> None:
    """Put what is left of the equations without the first step into left and gradient; NaN where it has no root."""
    size = STEP_SIZE
    for b in range(len(vector)):
        if not cholesky_root(matrix[b], size):
            left[b], gradient[b] = np.nan, np.nan
            continue
        root, y = matrix[b, :size, :size], vector[b]
        for i in range(size):
            for j in range(i):
                y[i] -= root[i, j] * y[j]
            y[i] /= root[i, i]
        rest = matrix[b, size:]
        divide_by_root(rest, root)
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
