"""The normal equations of a window of steps, whichever way they are held: what comes out, and what is left of the past.

Unknowns are those of every step in order from the oldest, and last those that all steps share. Equations are summed
from the rows of factors and hold lower triangles only; all have a leading axis of smoothers, solved side by side.
`BandedEquations` are for terms that tie neighbours only, `DenseEquations` for any.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.config import Normal
from palpate.graph.compiled import Array, compiled
from palpate.graph.variables import SHARED_SIZE, STEP_SIZE

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
    is_found: NDArray[np.bool_]
    """Whether there is one (B,); nothing changes where there is none."""


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

    def believing(self, shared: int, value: Array, before: Normal, now: Normal) -> "Gaussian":
        """Return it with other prior knowledge of one number that steps share, which is (B,) where this Gaussian is.

        The new standard deviation must be the smaller one.
        """
        place = STEP_SIZE * self.steps + shared
        (mean_before, deviation_before), (mean, deviation) = before, now
        more = deviation**-2.0 - deviation_before**-2.0
        target = (mean * deviation**-2.0 - mean_before * deviation_before**-2.0) / more
        information, gradient = self.information.copy(), self.gradient.copy()
        information[:, place, place] += more
        gradient[:, place] += more * (target - value)
        return Gaussian(self.steps, information, gradient)

    def loosened(self, variance: Array) -> "Gaussian":
        """Return it where what is shared has changed since by what nobody measured, of variances (SHARED_SIZE,)."""
        changed = np.flatnonzero(variance)
        if not len(changed):
            return self
        places = STEP_SIZE * self.steps + changed
        known = self.information[:, places[:, None], places] + np.diag(1.0 / variance[changed])
        pulled = np.linalg.solve(known, self.information[:, places])
        gradient = self.gradient - (self.gradient[:, None, places] @ pulled)[:, 0]
        return Gaussian(self.steps, self.information - self.information[:, :, places] @ pulled, gradient)


@compiled
def _put_gradient(information: Array, gradient: Array, change: Array, out: Array) -> None:
    for b in range(len(gradient)):
        for i in range(gradient.shape[1]):
            total = gradient[b, i]
            for j in range(gradient.shape[1]):
                total -= information[b, i, j] * change[b, j]
            out[b, i] = total


@compiled
def cholesky_root(matrix: Array, size: int) -> bool:
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
def divide_by_root(rows: Array, root: Array) -> None:
    """Replace rows X (R, D) by X root^-T, with root (D, D) lower triangular."""
    for r in range(rows.shape[0]):
        for i in range(STEP_SIZE):
            total = rows[r, i]
            for k in range(i):
                total -= rows[r, k] * root[i, k]
            rows[r, i] = total / root[i, i]
