"""Normal equations of a window: block-tridiagonal in the steps, with a border for the variables that all steps share.

They are eliminated step by step, oldest first. The numbers of two steps and of the shared variables form one small
system (WIDTH,): once the older step is eliminated, the rest is a Gaussian on the newer step and the shared variables,
which is all that the past says about what follows. The cost is proportional to the number of steps. Only the upper
triangles of matrices count.
"""

import math

from palpate.graph.compiled import Array, kernel
from palpate.graph.variables import STEP_SIZE, WIDTH


@kernel
def eliminate(first: int, stop: int, system: Array, gradient: Array, root: Array, y: Array) -> bool:
    """Eliminate numbers from `first` up to `stop`; False if they are indeterminate.

    Their rows of the upper Cholesky root, and of root^-T gradient, are written to root (stop - first, WIDTH) and y.
    """
    for p in range(first, stop):
        if not system[p, p] > 0.0:  # not for NaN either
            return False
        row, share = root[p - first], 1.0 / math.sqrt(system[p, p])
        for j in range(p, WIDTH):
            row[j] = share * system[p, j]
        y[p - first] = share * gradient[p]
        for i in range(p + 1, WIDTH):
            pull = row[i]
            gradient[i] -= pull * y[p - first]
            for j in range(i, WIDTH):
                system[i, j] -= pull * row[j]
    return True


@kernel
def substitute_back(first: int, root: Array, y: Array, change: Array) -> bool:
    """Write the change (WIDTH,) of the numbers from `first` on that were eliminated; False if it is not finite.

    All numbers after them have their change already.
    """
    for c in range(len(y) - 1, -1, -1):
        total = y[c]
        for j in range(first + c + 1, WIDTH):
            total -= root[c, j] * change[j]
        change[first + c] = total / root[c, first + c]
        if not math.isfinite(change[first + c]):
            return False
    return True


@kernel
def step_into_past(system: Array, gradient: Array) -> None:
    """Make the newer step of a system the older one of the next, whose newer step has no terms yet."""
    size = STEP_SIZE
    for i in range(size):
        gradient[i], gradient[size + i] = gradient[size + i], 0.0
        for j in range(i, size):
            system[i, j], system[size + i, size + j] = system[size + i, size + j], 0.0
        for j in range(size):
            system[i, size + j] = 0.0
        for j in range(2 * size, WIDTH):
            system[i, j], system[size + i, j] = system[size + i, j], 0.0


@kernel
def inflate(variance: Array, information: Array, gradient: Array, pulled: Array) -> None:
    """Let numbers of a Gaussian (N,) change at random, with these variances (N,); `pulled` (N,) is room."""
    for p in range(len(variance)):
        if variance[p] > 0.0:
            left, change = 1.0 / (information[p, p] + 1.0 / variance[p]), gradient[p]
            for i in range(len(variance)):
                pulled[i] = information[p, i]
            for i in range(len(variance)):
                gradient[i] -= change * left * pulled[i]
                for j in range(len(variance)):
                    information[i, j] -= left * pulled[i] * pulled[j]
