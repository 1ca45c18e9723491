"""Costs of the terms of a window, by which alarms are raised and hypotheses are compared."""

import math

from palpate.graph.compiled import Array, Integers, compiled
from palpate.graph.factors.factor import Linear

_FULL_WEIGHT = 1.0 - 1e-9  # share of the weight left by a kernel that counts as all


@compiled
def mean_squares(linear: Linear, step: Integers, first: int, out: Array) -> None:
    """Write the mean square of the terms from step `first` on to out (B,) [variances], without kernels; 0 if none."""
    for b in range(len(out)):
        total, count = 0.0, 0
        for t in range(len(step)):
            if step[t] >= first:
                count += 1
                for r in range(linear.residual.shape[2]):
                    total += linear.information[b, t, r] * linear.residual[b, t, r] ** 2
        out[b] = total / max(count, 1)


@compiled
def add_costs(linear: Linear, step: Integers, costs: Array) -> None:
    """Add half the square of each term, reduced by its kernel, to the cost of its step (B, N).

    A Cauchy kernel of scale k gives a square s the weight w = 1 / (1 + s / k^2) and the cost k^2 log(1 + s / k^2) / 2,
    which is -s w / (1 - w) log(w) / 2. The costs of several rows under one kernel add up to this.
    """
    rows, terms, size = linear.residual.shape
    for b in range(rows):
        for t in range(terms):
            for r in range(size):
                if linear.information[b, t, r] <= 0.0:
                    continue
                square = linear.information[b, t, r] * linear.residual[b, t, r] ** 2
                left = linear.weight[b, t, r] / linear.information[b, t, r]
                if left < _FULL_WEIGHT:
                    square *= -left / (1.0 - left) * math.log(left)
                costs[b, step[t]] += 0.5 * square
