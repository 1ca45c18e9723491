"""How badly the terms of a graph fit: what alarms are raised by, and what hypotheses are judged by."""

import math

from palpate.compiled import Array, Places, compiled

_UNTOUCHED = 1.0 - 1e-9  # share of a square that a kernel leaves, from which there might as well be none


@compiled
def mean_square(residual: Array, information: Array, places: Places, first: int) -> float:
    """Return the mean square of the terms (T, R) whose last step is at place `first` or later [variances].

    Kernels are left out; 0 where there are none.
    """
    total, count = 0.0, 0
    for t in range(len(places)):
        if places[t, -1] >= first:
            count += 1
            for r in range(residual.shape[1]):
                total += information[t, r] * residual[t, r] ** 2
    return total / max(count, 1)


@compiled
def add_costs(residual: Array, information: Array, weight: Array, places: Places, costs: Array) -> None:
    """Add what each term costs, half its square as far as its kernel lets it count, to its last step's costs (B, N).

    A Cauchy kernel of scale k weighs a square s by w = 1 / (1 + s / k^2) and lets it count as k^2 log(1 + s / k^2),
    which is -s w / (1 - w) log w; with several rows under one kernel, their shares sum up to it.
    """
    smoothers, terms, rows = residual.shape
    for b in range(smoothers):
        for t in range(terms):
            for r in range(rows):
                if information[b, t, r] <= 0.0:
                    continue
                square = information[b, t, r] * residual[b, t, r] ** 2
                left = weight[b, t, r] / information[b, t, r]
                if left < _UNTOUCHED:
                    square *= -left / (1.0 - left) * math.log(left)
                costs[b, places[t, -1]] += 0.5 * square
