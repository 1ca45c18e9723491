"""Signed distance from a polygon of any number of corners, in compiled code."""

import math

import numpy as np

from palpate.compiled import Array, compiled, kernel


@compiled
def signed_distances(points: Array, corners: Array) -> Array:
    """Return the distances (M,) [m] of points (M, 2) from the outline through corners (N, 2), negative inside.

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
            off = math.sqrt(_to_segment(x, y, corners, firsts[group], firsts[group + 1])[0])
            bulges[group] = max(bulges[group], off)
    found, likely = np.empty(len(points)), 0
    for i in range(len(points)):
        x, y = points[i]
        begin, least, reach, nearest = likely, np.inf, np.inf, 0
        for turn in range(len(bulges)):
            group = begin if turn == 0 else 0 if turn == begin else turn
            to_chord = _to_segment(x, y, corners, firsts[group], firsts[group + 1])[0]
            if to_chord > (reach + bulges[group]) ** 2:
                continue
            for edge in range(firsts[group], firsts[group + 1]):
                square = _to_segment(x, y, corners, edge, edge + 1)[0]
                if square < least:
                    least, nearest, likely = square, edge, group
            reach = math.sqrt(least) * (1.0 + 1e-9)
        found[i] = math.sqrt(least) * (-1.0 if _is_inside(x, y, corners, nearest) else 1.0)
    return found


@kernel
def _to_segment(x: float, y: float, corners: Array, first: int, last: int) -> tuple[float, float, float, float]:
    """Return the square distance [m^2] from the line between two corners, the nearest place as a share of it, and the
    way from there [m].
    """
    (start_x, start_y), (end_x, end_y) = corners[first], corners[last % len(corners)]
    edge_x, edge_y = end_x - start_x, end_y - start_y
    along = ((x - start_x) * edge_x + (y - start_y) * edge_y) / (edge_x**2 + edge_y**2)
    along = min(max(along, 0.0), 1.0)
    off_x, off_y = x - start_x - along * edge_x, y - start_y - along * edge_y
    return off_x**2 + off_y**2, along, off_x, off_y


@kernel
def _is_inside(x: float, y: float, corners: Array, edge: int) -> bool:
    """Return True for a point inside, by the outward normal of its nearest edge, or of both where they meet."""
    _, along, off_x, off_y = _to_segment(x, y, corners, edge, edge + 1)
    normal_x = normal_y = 0.0
    for each in range(edge - (along == 0.0), edge + 1 + (along == 1.0)):
        (start_x, start_y), (end_x, end_y) = corners[each % len(corners)], corners[(each + 1) % len(corners)]
        length = math.hypot(end_x - start_x, end_y - start_y)
        normal_x, normal_y = normal_x + (end_y - start_y) / length, normal_y - (end_x - start_x) / length
    return off_x * normal_x + off_y * normal_y < 0.0
