"""How badly the terms of a graph fit: what alarms are raised by, and what hypotheses are judged by."""

import math

from palpate.compiled import Array, Places, compiled

_UNTOUCHED = 1.0 - 1e-9  # share of a square that a kernel leaves, from which there might as well be none


@compiled
def mean_square(residual: Array, information: Array, places: Places, first: int) -> float:
    """Return the mean square of the terms (T, R) whose last step is at place `first` or later [variances].

    It is that of the first smoother, kernels left out; 0 where there are none.
    """
    total, count = 0.0, 0
    for t in range(len(places)):
        if places[t, -1] >= first:
            count += 1
            for r in range(residual.shape[2]):
                total += information[0, t, r] * residual[0, t, r] ** 2
    return total / max(count, 1)


@compiled
def add_costs(residual: Array, information: Array, weight: Array, places: Places, costs: Array) -> None:
    """Add what each term costs, half its square as far as its kernel lets it count, to its last step's costs (N,).

    A Cauchy kernel of scale k weighs a square s by w = 1 / (1 + s / k^2) and lets it count as k^2 log(1 + s / k^2),
    which is -s w / (1 - w) log w; with several rows under one kernel, their shares sum up to it.
    """
    for t in range(len(places)):
        for r in range(residual.shape[2]):
            if information[0, t, r] <= 0.0:
                continue
            square = information[0, t, r] * residual[0, t, r] ** 2
            left = weight[0, t, r] / information[0, t, r]
            if left < _UNTOUCHED:
                square *= -left / (1.0 - left) * math.log(left)
            costs[places[t, -1]] += 0.5 * square
