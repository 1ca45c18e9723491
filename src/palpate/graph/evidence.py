"""How badly the terms of a graph fit: what alarms are raised by, and what hypotheses are judged by."""

import math

from palpate.graph.compiled import Array, Places, Records, compiled
from palpate.graph.se2_kernels import dot, position, rotation

_UNTOUCHED = 1.0 - 1e-9  # share of a square that a kernel leaves, from which there might as well be none
_SHORT = 5e-4  # [m] way of the sensor of which half counts, for noise gives a sensor that stands still any direction
_SOFT = 0.1  # cosine about which ways past the object begin to be all alike, for noise turns them a little


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


@compiled
def add_headings(g: Array, e: Array, touching: Records, reach: int, costs: Array) -> None:
    """Add what it costs that the sensor goes past the object and not into it to each step's costs (B, N).

    A sensor that may go anywhere alike stays in touch with a side only on its way into it, the more easily the
    straighter: as the cosine of the angle between its way and the side's inward normal. Nothing else speaks against a
    hypothesis in which it glides along an object at rest, for nothing that does not move is off balance.
    The way is that of the sensor's point that touches, over the `reach` steps nearby. g and e are (B, N, 3), touching
    (B, N) is how they touch.
    """
    smoothers, steps = costs.shape
    for b in range(smoothers):
        for k in range(1, steps):
            first, last = e[b, max(k - reach, 0)], e[b, min(k + reach - 1, steps - 1)]
            touch = touching[b, k]
            way = position(last) - position(first) + (rotation(last[2]) - rotation(first[2])) * touch.material
            length = abs(way)
            if length > 0.0:
                inward = -touch.normal * rotation(e[b, k, 2] - g[b, k, 2])
                cosine = dot(inward, way) / length
                into = 0.5 * (cosine + math.sqrt(cosine * cosine + _SOFT * _SOFT))
                costs[b, k] -= math.log(min(into, 1.0)) / (1.0 + (_SHORT / length) ** 2)
