"""Signed distance from an outline on a grid, with a smooth interpolant between the nodes.

The interpolant is the natural cubic B-spline through the node values. Its second derivatives are continuous, and
gradient and Hessian are the exact derivatives of the value, as the smoother needs. `models.pushing.contact_geometry`
evaluates it.
"""

import math
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array
from palpate.geometry.shapes import Shape


class DistanceField(NamedTuple):
    """Spline of the signed distance on a square grid in the object frame, negative inside."""

    origin: Array
    """Position of the first node (2,) [m]."""
    cell: float
    """Distance between nodes [m]."""
    coefficients: Array
    """(rows + 3, columns + 3) for nodes in rows along y and columns along x; a cell of the grid has the four by four
    coefficients that begin at its row and column."""

    @classmethod
    def of(cls, shape: Shape, margin: float = 0.04) -> "DistanceField":
        """Sample a shape, with a margin [m] around it that should exceed the sensor's radius of curvature.

        The longer side of the grid has 512 nodes: a few megabytes for any object. The spline is exact to micrometres
        where the distance is smooth. At its kinks, the corners and the medial axis, it is off by a fifth of a cell and
        recovers within three.
        """
        outline = shape.outline(400)
        low = outline.min(axis=0) - margin
        high = outline.max(axis=0) + margin
        cell = float((high - low).max()) / (512 - 1)
        columns, rows = np.ceil((high - low) / cell - 1e-9).astype(int) + 1
        x = low[0] + cell * np.arange(columns)
        y = low[1] + cell * np.arange(rows)
        nodes = np.stack(np.meshgrid(x, y), axis=-1)
        return cls.through(low, cell, shape.signed_distance(nodes))

    @classmethod
    def through(cls, origin: Array, cell: float, values: Array) -> "DistanceField":
        """Return the spline through values at the nodes (rows, columns) [m]."""
        pad = 12  # nodes; the effect of the far end has then died out to 0.27^12, 1e-7
        coefficients = np.pad(values, pad, mode="reflect", reflect_type="odd")
        _filter_columns(coefficients)
        _filter_columns(coefficients.T)
        rows, columns = values.shape
        first = pad - 1
        used = coefficients[first : first + rows + 3, first : first + columns + 3]
        return cls(origin, cell, np.ascontiguousarray(used))


def _filter_columns(values: Array) -> None:
    """Replace values at nodes (rows, columns) by the coefficients of cubic splines down the columns, in place.

    M. Unser, "Splines: a perfect fit for signal and image processing", 1999, box 2. `scipy.ndimage` has it, too, and
    takes a quarter of a second to import.
    """
    pole = -1.0 / (2.0 + math.sqrt(3.0))
    values *= (1.0 - pole) * (1.0 - 1.0 / pole)
    power = pole
    for row in values[1:40]:  # 0.27^40 is nothing beside 1
        values[0] += power * row
        power *= pole
    for k in range(1, len(values)):
        values[k] += pole * values[k - 1]
    values[-1] = (pole * values[-2] + values[-1]) * pole / (pole * pole - 1.0)
    for k in range(len(values) - 2, -1, -1):
        values[k] = pole * (values[k + 1] - values[k])
