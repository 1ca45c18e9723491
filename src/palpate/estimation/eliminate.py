"""Elimination of a block-tridiagonal system with a border, step by step, in compiled code.

The normal equations of a window of N steps and the variables that they share, S at the border:

    ┌ A1  B1              C1 ┐   A: a step with itself
    │ B1' A2  B2          C2 │   B: a step with the next one
    │     B2' A3  ...     C3 │   C: a step with the shared variables
    │         ... ...  .. .. │   D: the shared variables with themselves
    │              .. AN  CN │
    └ C1' C2' C3' ..  CN' D  ┘

No more than two neighbouring steps and the border are in memory, a *system* (width, width) with its gradient (width,):

            before now  shared
    before ┌  A     B     C  ┐
    now    │  B'    A     C  │
    shared └  C'    C'    D  ┘

Once the older step is eliminated, the rest is a Gaussian on the newer step and the shared variables, which is all that
the past says about what follows. Then the newer step takes the place of the older one. The cost is proportional to the
number of steps. Only upper triangles count. Sizes are those of the arrays, so that a step may have any size.
"""

import math

from palpate.arrays import Array
from palpate.compiled import kernel


@kernel
def eliminate(first: int, system: Array, gradient: Array, root: Array, y: Array) -> bool:
    """Eliminate as many numbers as `y` has, from `first` on; False if they are indeterminate.

    Their rows of the upper Cholesky root, and of root^-T gradient, are written to root (len(y), width) and y. Rows are
    computed in full, in loops of constant length, which is quicker than their upper triangle.
    """
    width = len(gradient)
    for p in range(len(y)):
        pivot = first + p
        row = root[p]
        if not system[pivot, pivot] > 0.0:  # not for NaN either
            return False
        share = 1.0 / math.sqrt(system[pivot, pivot])
        y[p] = share * gradient[pivot]
        for j in range(first, width):
            row[j] = share * system[pivot, j]
        for i in range(pivot + 1, first + len(y)):
            gradient[i] -= row[i] * y[p]
            for j in range(first, width):
                system[i, j] -= row[i] * row[j]
    return True


@kernel
def eliminate_step(system: Array, gradient: Array, root: Array, y: Array) -> bool:
    """Eliminate the older step, and subtract root^T root from the rest of the system, root^T y from its gradient."""
    if not eliminate(0, system, gradient, root, y):
        return False
    size = len(y)
    width = len(gradient)
    for i in range(size, width):
        left = gradient[i]
        for p in range(size):
            left -= root[p, i] * y[p]
        gradient[i] = left
        for j in range(size, width):
            left = system[i, j]
            for p in range(size):  # innermost, so that an element of the system is read and written once
                left -= root[p, i] * root[p, j]
            system[i, j] = left
    return True


@kernel
def substitute_back(first: int, root: Array, y: Array, change: Array) -> None:
    """Write the change (width,) of the numbers from `first` on that were eliminated; those after them have theirs."""
    for c in range(len(y) - 1, -1, -1):
        total = y[c]
        for j in range(first + c + 1, len(change)):
            total -= root[c, j] * change[j]
        change[first + c] = total / root[c, first + c]


@kernel
def substitute_forward(first: int, root: Array, row: Array) -> float:
    """Multiply a row (width,) by the inverse of a root of numbers from `first` on; return the variance they give it."""
    variance = 0.0
    for p in range(len(root)):
        share = row[first + p] / root[p, first + p]
        variance += share**2
        row[first + p] = share
        for j in range(first + p + 1, len(row)):
            row[j] -= share * root[p, j]
    return variance


@kernel
def step_into_past(size: int, system: Array, gradient: Array) -> None:
    """Make the newer step of a system the older one of the next, whose newer step has no terms yet."""
    for i in range(size):
        gradient[i] = gradient[size + i]
        gradient[size + i] = 0.0
        for j in range(size):
            system[i, j] = system[size + i, size + j]
            system[size + i, size + j] = 0.0
            system[i, size + j] = 0.0
        for j in range(2 * size, len(gradient)):
            system[i, j] = system[size + i, j]
            system[size + i, j] = 0.0


@kernel
def inflate(variance: Array, information: Array, gradient: Array, pulled: Array) -> None:
    """Let numbers of a Gaussian (N,) change at random, with these variances (N,); `pulled` (N,) is room."""
    count = len(variance)
    for p in range(count):
        if variance[p] > 0.0:
            left = 1.0 / (information[p, p] + 1.0 / variance[p])
            change = gradient[p]
            for i in range(count):
                pulled[i] = information[p, i]
            for i in range(count):
                gradient[i] -= change * left * pulled[i]
                for j in range(count):
                    information[i, j] -= left * pulled[i] * pulled[j]
