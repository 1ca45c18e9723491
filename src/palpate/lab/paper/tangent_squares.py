"""Squares of factors' rows by how far the unknowns moved from a first guess, in the tangent space there."""

import numpy as np

from palpate.graph.compiled import Array, Places, compiled
from palpate.graph.se2_kernels import log_by_pose
from palpate.graph.variables import IN_STEP, OF_STEP, STEP_SIZE


def by_moved(moved: Array) -> Array:
    """Return how the steps' tangent vectors at the estimate change with how far it moved, (N, STEP_SIZE, STEP_SIZE)."""
    out = np.zeros((len(moved), STEP_SIZE, STEP_SIZE))
    for one in OF_STEP:
        _put_by_moved(moved, IN_STEP[one].start, out)
    return out


@compiled
def _put_by_moved(moved: Array, first: int, out: Array) -> None:
    by_tangent = np.empty((3, 3))
    for k in range(len(moved)):
        for c in range(first, first + 3):
            out[k, c, c] = 1.0
        # The inverse of ((c, -h, x), (h, c, y), (0, 0, 1)).
        log_by_pose(moved[k, first : first + 3], by_tangent)
        square = by_tangent[0, 0] ** 2 + by_tangent[1, 0] ** 2
        c, h = by_tangent[0, 0] / square, by_tangent[1, 0] / square
        x, y = by_tangent[0, 2], by_tangent[1, 2]
        out[k, first, first], out[k, first, first + 1], out[k, first, first + 2] = c, h, -c * x - h * y
        out[k, first + 1, first], out[k, first + 1, first + 1], out[k, first + 1, first + 2] = -h, c, h * x - c * y


@compiled
def add_squares(
    residual: Array,
    jacobian: Array,
    weight: Array,
    places: Places,
    first: Places,
    count: Places,
    turns: Array,
    unit: Array,
    index: Places,
    matrix: Array,
    vector: Array,
) -> None:
    """Add the squares of a factor's rows, with derivatives by how far the unknowns moved from the first guess.

    turns (N, STEP_SIZE, STEP_SIZE) are of `by_moved`, unit (SHARED_SIZE,) is what changes of what is shared are counted
    in, and index (N, STEP_SIZE) is where the numbers of steps stand in the matrix; what is shared stands last.
    """
    _, terms, rows, columns = jacobian.shape
    slots, shared = len(first) - 1, len(vector) - len(unit)
    at, jac = np.empty(columns, np.int64), np.empty((rows, columns))
    for t in range(terms):
        start = 0
        for slot in range(slots + 1):
            begin, size = first[slot], count[slot]
            for c in range(size):
                if slot == slots:
                    at[start + c] = shared + begin + c
                    for r in range(rows):
                        jac[r, start + c] = jacobian[0, t, r, start + c] * unit[begin + c]
                else:
                    turn = turns[places[t, slot]]
                    at[start + c] = index[places[t, slot], begin + c]
                    for r in range(rows):
                        total = 0.0
                        for j in range(size):
                            total += jacobian[0, t, r, start + j] * turn[begin + j, begin + c]
                        jac[r, start + c] = total
            start += size
        for r in range(rows):
            for i in range(columns):
                pull = weight[0, t, r] * jac[r, i]
                if pull != 0.0:
                    vector[at[i]] -= pull * residual[0, t, r]
                    for j in range(columns):
                        matrix[at[i], at[j]] += pull * jac[r, j]
