"""Distance from a polygon of any number of corners, in compiled code."""

import math

import numpy as np

from palpate.arrays import Array, Integers
from palpate.compiled import compiled, kernel


def distances(points: Array, corners: Array) -> Array:
    """Return the distances (M,) [m] of points (M, 2) from the outline through corners (N, 2)."""
    count = len(corners)
    outline = np.concatenate((corners, corners[:1]))
    size = math.ceil(0.5 * math.sqrt(count))
    firsts = np.arange(0, count + size, size)
    firsts[-1] = count
    groups = len(firsts) - 1
    nearest = np.empty(len(points))
    _write_distances(np.ascontiguousarray(points), outline, firsts, np.zeros(groups), np.zeros(groups), nearest)
    return nearest


@compiled(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1, np.int64), np.zeros(1), np.zeros(1), np.zeros(1))
def _write_distances(
    points: Array, outline: Array, firsts: Integers, bulges: Array, bounds: Array, nearest: Array
) -> None:
    """Write the distances of points; bulges and bounds (groups,) are room, and the bounds begin with 0.

    Consecutive edges form groups, each near the chord from its first corner to its last. A group is no nearer to a
    point than its chord, less the largest distance of its corners from the chord, its bulge. Its edges are looked at
    only if that bound is below the nearest edge so far, and the group that was nearest to the point before comes first.
    A point is no nearer to a group than the point before was, less the distance between the points: this second bound
    often decides without the chord.
    """
    groups = len(firsts) - 1
    _put_bulges(outline, firsts, bulges)
    nearest_group = 0
    last_x = 0.0
    last_y = 0.0
    for i in range(len(points)):
        x, y = points[i]
        moved = math.hypot(x - last_x, y - last_y) * (1.0 + 1e-9)
        for k in range(groups):  # every edge of a group is at least so far from the point
            bounds[k] -= moved
        last_x = x
        last_y = y
        first_group = nearest_group
        least_square = np.inf
        limit = np.inf  # [m] the distance of the nearest edge so far
        for k in range(groups):
            group = _kth_group(k, first_group)
            if bounds[group] <= limit:
                to_chord = _square_distance(x, y, outline, firsts[group], firsts[group + 1])
                bounds[group] = math.sqrt(to_chord) - bulges[group]
            if bounds[group] > limit:
                continue
            for edge in range(firsts[group], firsts[group + 1]):
                square = _square_distance(x, y, outline, edge, edge + 1)
                if square < least_square:
                    least_square = square
                    nearest_group = group
            limit = math.sqrt(least_square) * (1.0 + 1e-9)
        nearest[i] = math.sqrt(least_square)


@kernel
def _put_bulges(outline: Array, firsts: Integers, bulges: Array) -> None:
    """Write the largest distance [m] of the corners of each group from the chord of the group, to zeros."""
    for group in range(len(bulges)):
        for k in range(firsts[group], firsts[group + 1]):
            x, y = outline[k]
            square = _square_distance(x, y, outline, firsts[group], firsts[group + 1])
            bulges[group] = max(bulges[group], math.sqrt(square))


@kernel
def _kth_group(k: int, first: int) -> int:
    """Return the group that comes k-th: one is taken first, in exchange for group 0, the others in their order."""
    if k == 0:
        return first
    if k == first:
        return 0
    return k


@kernel
def _square_distance(x: float, y: float, outline: Array, first: int, last: int) -> float:
    """Return the square distance [m^2] of a point from the line between two corners."""
    start_x, start_y = outline[first]
    end_x, end_y = outline[last]
    edge_x = end_x - start_x
    edge_y = end_y - start_y
    along = ((x - start_x) * edge_x + (y - start_y) * edge_y) / (edge_x**2 + edge_y**2)
    along = min(max(along, 0.0), 1.0)
    return (x - start_x - along * edge_x) ** 2 + (y - start_y - along * edge_y) ** 2
