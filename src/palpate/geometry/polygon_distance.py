"""Distance from a polygon of any number of corners, in compiled code."""

import math

import numpy as np

from palpate.arrays import Array
from palpate.compiled import compiled, kernel


@compiled
def distances(points: Array, corners: Array) -> Array:
    """Return the distances (M,) [m] of points (M, 2) from the outline through corners (N, 2).

    Edges are taken in groups of about sqrt(N), each near the chord from its first corner to its last. Its edges are
    looked at only if the chord, less their largest distance from it, is nearer than the nearest edge so far. The group
    of the point before comes first.
    """
    count = len(corners)
    size = math.ceil(math.sqrt(count))
    firsts = np.arange(0, count + size, size)
    firsts[-1] = count
    bulges = np.zeros(len(firsts) - 1)
    for group in range(len(bulges)):
        for k in range(firsts[group], firsts[group + 1]):
            x, y = corners[k]
            off = math.sqrt(_square(x, y, corners, firsts[group], firsts[group + 1]))
            bulges[group] = max(bulges[group], off)
    found, likely = np.empty(len(points)), 0
    for i in range(len(points)):
        x, y = points[i]
        begin, least, reach = likely, np.inf, np.inf
        for turn in range(len(bulges)):
            group = begin if turn == 0 else 0 if turn == begin else turn
            to_chord = _square(x, y, corners, firsts[group], firsts[group + 1])
            if to_chord > (reach + bulges[group]) ** 2:
                continue
            for edge in range(firsts[group], firsts[group + 1]):
                square = _square(x, y, corners, edge, edge + 1)
                if square < least:
                    least, likely = square, group
            reach = math.sqrt(least) * (1.0 + 1e-9)
        found[i] = math.sqrt(least)
    return found


@kernel
def _square(x: float, y: float, corners: Array, first: int, last: int) -> float:
    """Return the square distance [m^2] of a point from the line between two corners."""
    (start_x, start_y), (end_x, end_y) = corners[first], corners[last % len(corners)]
    edge_x, edge_y = end_x - start_x, end_y - start_y
    along = ((x - start_x) * edge_x + (y - start_y) * edge_y) / (edge_x**2 + edge_y**2)
    along = min(max(along, 0.0), 1.0)
    return (x - start_x - along * edge_x) ** 2 + (y - start_y - along * edge_y) ** 2
