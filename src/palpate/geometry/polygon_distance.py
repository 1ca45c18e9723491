"""Distance from a polygon of any number of corners, in compiled code."""

import math

import numpy as np

from palpate.arrays import Array
from palpate.compiled import compiled, kernel


@compiled
def distances(points: Array, corners: Array) -> Array:
    """Return the distances (M,) [m] of points (M, 2) from the outline through corners (N, 2).

    Edges are taken in groups, each near the chord from its first corner to its last. Its edges are looked at only if
    the chord, less their largest distance from it, is nearer than the nearest edge so far; the group of the point
    before comes first. What is known of a group's distance from the point before often tells without the chord.
    """
    count, outline = len(corners), np.concatenate((corners, corners[:1]))
    size = math.ceil(0.5 * math.sqrt(count))
    firsts = np.arange(0, count + size, size)
    firsts[-1] = count
    bulges, farther = np.zeros(len(firsts) - 1), np.zeros(len(firsts) - 1)
    for group in range(len(bulges)):
        for k in range(firsts[group], firsts[group + 1]):
            x, y = outline[k]
            off = math.sqrt(_square(x, y, outline, firsts[group], firsts[group + 1]))
            bulges[group] = max(bulges[group], off)
    found, likely = np.empty(len(points)), 0
    last_x, last_y = 0.0, 0.0
    for i in range(len(points)):
        x, y = points[i]
        farther -= math.hypot(x - last_x, y - last_y) * (1.0 + 1e-9)  # all edges of a group are at least so far
        last_x, last_y, begin, least, reach = x, y, likely, np.inf, np.inf
        for turn in range(len(bulges)):
            group = begin if turn == 0 else 0 if turn == begin else turn
            if farther[group] <= reach:
                to_chord = _square(x, y, outline, firsts[group], firsts[group + 1])
                farther[group] = math.sqrt(to_chord) - bulges[group]
            if farther[group] > reach:
                continue
            for edge in range(firsts[group], firsts[group + 1]):
                square = _square(x, y, outline, edge, edge + 1)
                if square < least:
                    least, likely = square, group
            reach = math.sqrt(least) * (1.0 + 1e-9)
        found[i] = math.sqrt(least)
    return found


@kernel
def _square(x: float, y: float, outline: Array, first: int, last: int) -> float:
    """Return the square distance [m^2] of a point from the line between two corners."""
    (start_x, start_y), (end_x, end_y) = outline[first], outline[last]
    edge_x, edge_y = end_x - start_x, end_y - start_y
    along = ((x - start_x) * edge_x + (y - start_y) * edge_y) / (edge_x**2 + edge_y**2)
    along = min(max(along, 0.0), 1.0)
    return (x - start_x - along * edge_x) ** 2 + (y - start_y - along * edge_y) ** 2
