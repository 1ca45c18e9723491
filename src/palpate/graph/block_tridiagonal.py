"""Normal equations of a window: block-tridiagonal in the steps, with a border for the variables that all steps share.

Only lower triangles are stored. All arrays have a leading axis of hypotheses. The cost of a solution is proportional to
the number of steps.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.graph.belief import RowArrays
from palpate.graph.compiled import Array, Integers, compiled
from palpate.graph.factors.factor import Columns, Linear
from palpate.graph.variables import SHARED_SIZE, STEP_SIZE

LAST_SIZE = STEP_SIZE + SHARED_SIZE
"""Numbers of one step and the shared variables."""


class Solution(NamedTuple):
    """A Gauss-Newton step."""

    by_step: Array
    """Change of the steps, (B, N, STEP_SIZE)."""
    by_shared: Array
    """Change of the shared variables, (B, SHARED_SIZE)."""
    covariance: Array
    """Joint covariance of the last step and the shared variables, (B, LAST_SIZE, LAST_SIZE)."""
    is_found: NDArray[np.bool_]
    """False where there is no solution (B,); the changes are 0 there."""


@dataclass(frozen=True, eq=False)
class Gaussian(RowArrays):
    """Gaussian on the oldest step and the shared variables, at some values of them."""

    information: Array
    """(B, LAST_SIZE, LAST_SIZE)"""
    gradient: Array
    """Negative gradient, (B, LAST_SIZE)."""

    def moved(self, change: Array) -> "Gaussian":
        """Return the Gaussian at values that differ by `change` (B, LAST_SIZE)."""
        gradient = np.empty_like(self.gradient)
        _move_gradient(self.information, self.gradient, change, gradient)
        return Gaussian(self.information, gradient)

    def inflated(self, variance: Array) -> "Gaussian":
        """Return the Gaussian after the shared variables changed at random, with variances (SHARED_SIZE,)."""
        changed = np.flatnonzero(variance)
        if not len(changed):
            return self
        places = STEP_SIZE + changed
        known = self.information[:, places[:, None], places] + np.diag(1.0 / variance[changed])
        pulled = np.linalg.solve(known, self.information[:, places])
        gradient = self.gradient - (self.gradient[:, None, places] @ pulled)[:, 0]
        return Gaussian(self.information - self.information[:, :, places] @ pulled, gradient)


class Equations:
    """Normal equations of B hypotheses with N steps."""

    def __init__(self, rows: int, steps: int) -> None:
        size, shared = STEP_SIZE, SHARED_SIZE
        self._own = np.zeros((rows, steps, size, size))
        self._next = np.zeros((rows, max(steps - 1, 0), size, size))
        self._border = np.zeros((rows, steps, shared, size))
        self._corner = np.zeros((rows, shared, shared))
        self._gradient = np.zeros((rows, steps, size))
        self._edge = np.zeros((rows, shared))

    @property
    def _parts(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        return self._own, self._next, self._border, self._corner, self._gradient, self._edge

    def add(self, linear: Linear, step: Integers, columns: Columns, of_oldest: bool = False) -> None:
        """Add the terms of a factor, or only those that depend on the oldest step."""
        _add(linear, step, *columns, of_oldest, *self._parts)

    def add_gaussian(self, gaussian: Gaussian) -> None:
        """Add a Gaussian on the oldest step and the shared variables."""
        information, gradient = gaussian.information, gaussian.gradient
        self._own[:, 0] += information[:, :STEP_SIZE, :STEP_SIZE]
        self._border[:, 0] += information[:, STEP_SIZE:, :STEP_SIZE]
        self._gradient[:, 0] += gradient[:, :STEP_SIZE]
        self._corner += information[:, STEP_SIZE:, STEP_SIZE:]
        self._edge += gradient[:, STEP_SIZE:]

    def solve(self) -> Solution:
        """Return the solution; the equations are used up."""
        rows = len(self._edge)
        covariance, is_found = np.empty((rows, LAST_SIZE, LAST_SIZE)), np.empty(rows, np.bool_)
        _solve(*self._parts, covariance, is_found)
        return Solution(self._gradient, self._edge, covariance, is_found)

    def without_oldest(self) -> Gaussian:
        """Return the Gaussian on the second step and the shared variables once the oldest step is eliminated.

        It is NaN where the oldest step is indeterminate; no solution is found there from then on.
        """
        rows = len(self._edge)
        information, gradient = np.empty((rows, LAST_SIZE, LAST_SIZE)), np.empty((rows, LAST_SIZE))
        _marginalise(*self._parts, information, gradient)
        return Gaussian(information, gradient)


@compiled
def _move_gradient(information: Array, gradient: Array, change: Array, out: Array) -> None:
    for b in range(len(gradient)):
        for i in range(gradient.shape[1]):
            total = gradient[b, i]
            for j in range(gradient.shape[1]):
                total -= information[b, i, j] * change[b, j]
            out[b, i] = total


@compiled
def _add(
    linear: Linear,
    step: Integers,
    first: Integers,
    count: Integers,
    of_oldest: bool,
    own: Array,
    nearby: Array,
    border: Array,
    corner: Array,
    gradient: Array,
    edge: Array,
) -> None:
    slots = len(first) - 1  # steps of a term
    for b in range(len(edge)):
        for t in range(len(step)):
            oldest = step[t] - slots + 1
            if of_oldest and oldest > 0:
                continue
            for r in range(linear.residual.shape[2]):
                row, w, off = linear.jacobian[b, t, r], linear.weight[b, t, r], linear.residual[b, t, r]
                start = 0
                for slot in range(slots):
                    k, at, size = oldest + slot, first[slot], count[slot]
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
                            border[b, oldest + slot, at + i, first[slot] + j] += pull * row[before + j]
                        before += count[slot]


@compiled
def _solve(
    own: Array,
    nearby: Array,
    border: Array,
    corner: Array,
    gradient: Array,
    edge: Array,
    covariance: Array,
    is_found: NDArray[np.bool_],
) -> None:
    """Solve in place: gradient and edge become the changes, 0 where there is no solution."""
    for b in range(len(is_found)):
        is_found[b] = _factorise(own[b], nearby[b], border[b], corner[b], gradient[b], edge[b])
        if is_found[b]:
            _last_covariance(own[b, -1], border[b, -1], corner[b], covariance[b])
            is_found[b] = _substitute_back(own[b], nearby[b], border[b], corner[b], gradient[b], edge[b])
        if not is_found[b]:
            gradient[b], edge[b] = 0.0, 0.0


@compiled
def _marginalise(
    own: Array,
    nearby: Array,
    border: Array,
    corner: Array,
    gradient: Array,
    edge: Array,
    information: Array,
    left: Array,
) -> None:
    """Write the Gaussian on the second step and the shared variables to information and left."""
    for b in range(len(edge)):
        if not _eliminate(0, own[b], nearby[b], border[b], corner[b], gradient[b], edge[b]):
            information[b], left[b] = np.nan, np.nan
            continue
        left[b, :STEP_SIZE], left[b, STEP_SIZE:] = gradient[b, 1], edge[b]
        for i in range(LAST_SIZE):
            for j in range(i + 1):
                if i < STEP_SIZE:
                    value = own[b, 1, i, j]
                elif j < STEP_SIZE:
                    value = border[b, 1, i - STEP_SIZE, j]
                else:
                    value = corner[b, i - STEP_SIZE, j - STEP_SIZE]
                information[b, i, j] = information[b, j, i] = value


@compiled
def _factorise(own: Array, nearby: Array, border: Array, corner: Array, gradient: Array, edge: Array) -> bool:
    """Replace the matrix by its block Cholesky root L, oldest step first and shared variables last.

    Gradient and edge become L^-1 gradient and what the steps leave of the edge. False if there is no root.
    """
    for k in range(len(gradient)):
        if not _eliminate(k, own, nearby, border, corner, gradient, edge):
            return False
    return cholesky_root(corner, SHARED_SIZE)


@compiled
def _eliminate(k: int, own: Array, nearby: Array, border: Array, corner: Array, gradient: Array, edge: Array) -> bool:
    """Eliminate step k, the oldest one left; False if it is indeterminate."""
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
    if k + 1 < len(gradient):
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
    return True


@compiled
def cholesky_root(matrix: Array, size: int) -> bool:
    """Replace the lower triangle of a leading block by its Cholesky root; False if it has none."""
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
def divide_by_root(rows: Array, root: Array) -> None:
    """Replace rows X (R, D) by X root^-T, with root (D, D) lower triangular."""
    for r in range(rows.shape[0]):
        for i in range(STEP_SIZE):
            total = rows[r, i]
            for k in range(i):
                total -= rows[r, k] * root[i, k]
            rows[r, i] = total / root[i, i]


@compiled
def _last_covariance(own: Array, border: Array, corner: Array, covariance: Array) -> None:
    """Write the covariance of the last step and the shared variables, from their rows of the root L."""
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
    """Solve for the shared variables, then for the steps from the newest to the oldest. False if not finite."""
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
