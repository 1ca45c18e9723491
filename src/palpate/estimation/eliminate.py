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
number of steps. Only upper triangles count.

A step may have any size. Sizes are constants of the compiled functions, so that the compiler unrolls their loops.
"""

import math
from functools import partial
from typing import Any, NamedTuple

from palpate.arrays import Array
from palpate.compiled import kernel


class Elimination(NamedTuple):
    """Compiled functions for steps and shared variables of some size."""

    eliminate_step: Any
    """Eliminate the older step of a system, and take it from the rest."""
    eliminate_last: Any
    """Eliminate the last step and the shared variables."""
    move_into_past: Any
    """Make the newer step the older one."""
    back_from_step: Any
    """Substitute back for an older step."""
    back_from_last: Any
    """Substitute back for the last step and the shared variables."""
    forward_step: Any
    """Substitute forward through an older step."""
    forward_last: Any
    """Substitute forward through the last step and the shared variables."""


def elimination(step_size: int, shared_size: int) -> Elimination:
    """Return the compiled functions for steps of this size with so many shared variables."""
    width = 2 * step_size + shared_size
    last_size = step_size + shared_size
    return Elimination(
        eliminate_step=make_eliminate_step(step_size, width),
        eliminate_last=make_eliminate(step_size, last_size, width),
        move_into_past=make_move_into_past(step_size, width),
        back_from_step=make_substitute_back(0, step_size, width),
        back_from_last=make_substitute_back(step_size, last_size, width),
        forward_step=make_substitute_forward(0, step_size, width),
        forward_last=make_substitute_forward(step_size, last_size, width),
    )


def make_eliminate(first: int, count: int, width: int) -> Any:
    """Return the compiled function that eliminates so many numbers of a system, from `first` on."""

    @partial(kernel, are_disjoint=True)
    def eliminate(system: Array, gradient: Array, root: Array, y: Array) -> bool:
        """Eliminate numbers; False if they are indeterminate.

        Their rows of the upper Cholesky root, and of root^-T gradient, are written to root (count, width) and y
        (count,). Rows are computed in full, which is quicker than their upper triangle.
        """
        for p in range(count):
            pivot = first + p
            row = root[p]
            if not system[pivot, pivot] > 0.0:  # not for NaN either
                return False
            share = 1.0 / math.sqrt(system[pivot, pivot])
            y[p] = share * gradient[pivot]
            for j in range(first, width):
                row[j] = share * system[pivot, j]
            for i in range(pivot + 1, first + count):
                gradient[i] -= row[i] * y[p]
                for j in range(first, width):
                    system[i, j] -= row[i] * row[j]
        return True

    return eliminate


def make_eliminate_step(size: int, width: int) -> Any:
    """Return the compiled function that eliminates the older step of a system."""
    eliminate = make_eliminate(0, size, width)

    @partial(kernel, are_disjoint=True)
    def eliminate_step(system: Array, gradient: Array, root: Array, y: Array) -> bool:
        """Eliminate the older step; subtract root^T root from the rest of the system, root^T y from its gradient."""
        if not eliminate(system, gradient, root, y):
            return False
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

    return eliminate_step


def make_move_into_past(size: int, width: int) -> Any:
    """Return the compiled function that makes the newer step of a system the older one of the next."""

    @kernel
    def move_into_past(system: Array, gradient: Array) -> None:
        """Move the newer step to the place of the older one; the newer one of the next system has no terms yet."""
        for i in range(size):
            gradient[i] = gradient[size + i]
            gradient[size + i] = 0.0
            for j in range(size):
                system[i, j] = system[size + i, size + j]
                system[size + i, size + j] = 0.0
                system[i, size + j] = 0.0
            for j in range(2 * size, width):
                system[i, j] = system[size + i, j]
                system[size + i, j] = 0.0

    return move_into_past


def make_substitute_back(first: int, count: int, width: int) -> Any:
    """Return the compiled function that solves for so many eliminated numbers, from `first` on."""

    @kernel
    def substitute_back(root: Array, y: Array, change: Array) -> None:
        """Write the change (width,) of the numbers that were eliminated; those after them have theirs."""
        for c in range(count - 1, -1, -1):
            total = y[c]
            for j in range(width - 1, first + c, -1):  # what was written last comes last, so that less waits for it
                total -= root[c, j] * change[j]
            change[first + c] = total / root[c, first + c]

    return substitute_back


def make_substitute_forward(first: int, count: int, width: int) -> Any:
    """Return the compiled function that multiplies a row by the inverse of a root of numbers from `first` on."""

    @kernel
    def substitute_forward(root: Array, row: Array) -> float:
        """Multiply a row (width,) by the inverse root; return the variance that these numbers give it."""
        variance = 0.0
        for p in range(count):
            share = row[first + p] / root[p, first + p]
            variance += share**2
            row[first + p] = share
            for j in range(first + p + 1, width):
                row[j] -= share * root[p, j]
        return variance

    return substitute_forward


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
