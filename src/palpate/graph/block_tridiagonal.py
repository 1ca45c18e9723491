"""Normal equations of terms that tie no more than a step and the next one: block-tridiagonal, with a border.

The border is what all steps share. A solution costs a time in proportion to the steps.
"""

import math
from contextlib import AbstractContextManager, nullcontext

import numpy as np
from numpy.typing import NDArray

from palpate.graph.compiled import Array, Places, compiled
from palpate.graph.factors.factor import Columns, Rows
from palpate.graph.normal_equations import LAST_SIZE, Gaussian, Solution, cholesky_root, divide_by_root
from palpate.graph.variables import SHARED_SIZE, STEP_SIZE


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
        """Return the solution."""
        covariance = np.empty((len(self._edge), LAST_SIZE, LAST_SIZE))
        is_found = np.empty(len(self._edge), np.bool_)
        parts = self._own, self._next, self._border, self._corner, self._gradient, self._edge
        _solve_banded(*parts, covariance, is_found)
        return Solution(self._gradient, self._edge, covariance, is_found)


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
def _solve_banded(
    own: Array,
    nearby: Array,
    border: Array,
    corner: Array,
    gradient: Array,
    edge: Array,
    covariance: Array,
    is_found: NDArray[np.bool_],
) -> None:
    """Solve in place for each smoother: gradient and edge become the changes, 0 where there is no solution."""
    for b in range(len(is_found)):
        is_found[b] = _solve_one(own[b], nearby[b], border[b], corner[b], gradient[b], edge[b], covariance[b])
        if not is_found[b]:
            gradient[b], edge[b] = 0.0, 0.0


@compiled
def _solve_one(
    own: Array, nearby: Array, border: Array, corner: Array, gradient: Array, edge: Array, covariance: Array
) -> bool:
    """Solve in place: gradient and edge become the changes, covariance that of the last step and what is shared.

    False where there is no solution.
    """
    if not _factorise(own, nearby, border, corner, gradient, edge):
        return False
    _last_covariance(own[-1], border[-1], corner, covariance)
    return _substitute_back(own, nearby, border, corner, gradient, edge)


@compiled
def _factorise(own: Array, nearby: Array, border: Array, corner: Array, gradient: Array, edge: Array) -> bool:
    """Put a block Cholesky root L in place of the matrix, from the oldest step to the newest, what is shared last.

    Gradient becomes L^-1 gradient, and edge what the steps leave of it. False where there is no root.
    """
    steps = len(gradient)
    for k in range(steps):
        root, y = own[k], gradient[k]
        if not cholesky_root(root, STEP_SIZE):
            return False
        for i in range(STEP_SIZE):
            for j in range(i):
                y[i] -= root[i, j] * y[j]
            y[i] /= root[i, i]
        divide_by_root(border[k], root)
        for i in range(SHARED_SIZE):
            for c in range(STEP_SIZE):
                edge[i] -= border[k, i, c] * y[c]
            for j in range(i + 1):
                for c in range(STEP_SIZE):
                    corner[i, j] -= border[k, i, c] * border[k, j, c]
        if k + 1 < steps:
            ahead = nearby[k]
            divide_by_root(ahead, root)
            for i in range(STEP_SIZE):
                for c in range(STEP_SIZE):
                    gradient[k + 1, i] -= ahead[i, c] * y[c]
                for j in range(i + 1):
                    for c in range(STEP_SIZE):
                        own[k + 1, i, j] -= ahead[i, c] * ahead[j, c]
            for i in range(SHARED_SIZE):
                for j in range(STEP_SIZE):
                    for c in range(STEP_SIZE):
                        border[k + 1, i, j] -= border[k, i, c] * ahead[j, c]
    return cholesky_root(corner, SHARED_SIZE)


@compiled
def _last_covariance(own: Array, border: Array, corner: Array, covariance: Array) -> None:
    """Put the covariance of the last step and what is shared into `covariance`, from their rows of the root L."""
    last = np.zeros((LAST_SIZE, LAST_SIZE))
    inverse = np.zeros((LAST_SIZE, LAST_SIZE))
    for i in range(LAST_SIZE):
        for j in range(i + 1):
            if i < STEP_SIZE:
                last[i, j] = own[i, j]
            elif j < STEP_SIZE:
                last[i, j] = border[i - STEP_SIZE, j]
            else:
                last[i, j] = corner[i - STEP_SIZE, j - STEP_SIZE]
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
            covariance[i, j] = total


@compiled
def _substitute_back(own: Array, nearby: Array, border: Array, corner: Array, gradient: Array, edge: Array) -> bool:
    """Solve for what is shared, then for the steps from the newest to the oldest. False where that is not finite."""
    steps = len(gradient)
    for i in range(SHARED_SIZE):
        for j in range(i):
            edge[i] -= corner[i, j] * edge[j]
        edge[i] /= corner[i, i]
    for i in range(SHARED_SIZE - 1, -1, -1):
        for j in range(i + 1, SHARED_SIZE):
            edge[i] -= corner[j, i] * edge[j]
        edge[i] /= corner[i, i]
    for k in range(steps - 1, -1, -1):
        root, y = own[k], gradient[k]
        for c in range(STEP_SIZE):
            for i in range(SHARED_SIZE):
                y[c] -= border[k, i, c] * edge[i]
            if k + 1 < steps:
                for i in range(STEP_SIZE):
                    y[c] -= nearby[k, i, c] * gradient[k + 1, i]
        for i in range(STEP_SIZE - 1, -1, -1):
            for j in range(i + 1, STEP_SIZE):
                y[i] -= root[j, i] * y[j]
            y[i] /= root[i, i]
            if not math.isfinite(y[i]):
                return False
    return True
