"""Signed distance from an outline on a grid, with a smooth interpolant between the nodes.

The interpolant is the natural cubic B-spline through the node values. Its second derivatives are
continuous, and value, gradient and Hessian belong together, as the smoother needs them. Frame: the object's.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from palpate.errors import EstimationError, SettingError
from palpate.geometry.shapes import Shape

Array = NDArray[np.float64]


# Weights of the four nearby spline coefficients, for (1, f, f^2, f^3) with f the place in the cell: columns
# 0-3 for the value, 4-7 for the first and 8-11 for the second derivative by f.
_BASIS = (
    np.array(
        [
            [1, 4, 1, 0, -3, 0, 3, 0, 6, -12, 6, 0],
            [-3, 0, 3, 0, 6, -12, 6, 0, -6, 18, -18, 6],
            [3, -6, 3, 0, -3, 9, -9, 3, 0, 0, 0, 0],
            [-1, 3, -3, 1, 0, 0, 0, 0, 0, 0, 0, 0],
        ]
    )
    / 6.0
)
_POWERS = np.arange(4)


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Signed distance at the nodes of a square grid, negative inside."""

    origin: Array
    """Position of the first node (2,) [m]."""
    cell: float
    """Distance between nodes [m]."""
    values: Array
    """Signed distance at the nodes (rows along y, columns along x) [m]."""
    coefficients: Array = field(init=False, repr=False)
    """Of the spline, (rows + 3, columns + 3): those of a cell are the four by four from its row and column on."""
    _windows: Array = field(init=False, repr=False)
    """Spline coefficients around each cell (rows, columns, 4, 4), a view."""

    def __post_init__(self) -> None:
        from scipy.ndimage import spline_filter

        origin, values = (np.array(a, dtype=np.float64) for a in (self.origin, self.values))
        origin.flags.writeable = values.flags.writeable = False
        pad = 12  # nodes; the effect of the far end has then died out to 0.27^12, 1e-7
        padded = np.pad(values, pad, mode="reflect", reflect_type="odd")
        coefficients = spline_filter(padded, order=3, mode="mirror")[pad - 1 :, pad - 1 :]
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "cell", float(self.cell))
        object.__setattr__(self, "values", values)
        rows, columns = values.shape
        object.__setattr__(self, "coefficients", np.ascontiguousarray(coefficients[: rows + 3, : columns + 3]))
        object.__setattr__(self, "_windows", sliding_window_view(self.coefficients, (4, 4)))

    @classmethod
    def of(cls, shape: Shape, cell: float | None = None, margin: float = 0.04) -> "DistanceField":
        """Sample a shape, with a margin [m] around it that should exceed the sensor's radius of curvature.

        The default cell [m] puts 512 nodes along the longer side of the grid: a few megabytes for any object.
        The spline is exact to micrometres where the distance is smooth. At its kinks, the corners and the
        medial axis, it is off by a fifth of a cell and recovers within three, so a small object needs a small
        cell.
        """
        outline = shape.outline(400)
        low, high = outline.min(axis=0) - margin, outline.max(axis=0) + margin
        extent = high - low
        if not (margin >= 0.0 and np.isfinite(extent).all()):
            raise SettingError(f"distance field margin is {margin!r}; it must be a finite length, 0 or more [m]")
        if cell is None:
            cell = float(extent.max()) / (512 - 1)
        if not 0.0 < cell <= extent.min():
            raise SettingError(f"distance field cell is {cell!r}; it must be a length up to the grid's [m]")
        columns, rows = np.ceil(extent / cell - 1e-9).astype(int) + 1
        x = low[0] + cell * np.arange(columns)
        y = low[1] + cell * np.arange(rows)
        return cls(low, cell, shape.signed_distance(np.stack(np.meshgrid(x, y), axis=-1)))

    def value(self, points: ArrayLike) -> Array:
        """Return the signed distance (...) [m] at points (..., 2) [m]."""
        return self.value_gradient_hessian(points)[0]

    def value_gradient_hessian(self, points: ArrayLike) -> tuple[Array, Array, Array]:
        """Return distance (...) [m], gradient (..., 2) and Hessian (..., 2, 2) [1/m] at points (..., 2) [m].

        They are exact derivatives of one interpolant. Outside the grid it goes on as the distance at the
        nearest point of the border plus the way to there: continuous, and never below the true distance.
        Raises EstimationError on a point that is not finite.
        """
        points = np.asarray(points, dtype=np.float64)
        if not np.isfinite(points).all():
            raise EstimationError(f"distance was queried at {_first_bad(points)}; points must be finite")
        place = (points - self.origin) / self.cell
        rows, columns = self.values.shape
        clamped = np.minimum(np.maximum(place, 0.0), (columns - 1.0, rows - 1.0))
        node = clamped.astype(np.intp)
        weights = ((clamped - node)[..., None] ** _POWERS @ _BASIS).reshape(*points.shape, 3, 4)
        window = self._windows[node[..., 1], node[..., 0]]
        # table[i, j] is the i-th derivative by y of the j-th derivative by x, in cells.
        table = weights[..., 1, :, :] @ window @ np.swapaxes(weights[..., 0, :, :], -1, -2)
        distance = table[..., 0, 0]
        gradient = table[..., (0, 1), (1, 0)] / self.cell
        hessian = table[..., ((0, 1), (1, 2)), ((2, 1), (1, 0))] / self.cell**2
        outside = place != clamped
        if outside.any():
            return _continued(distance, gradient, hessian, (place - clamped) * self.cell, outside)
        return distance, gradient, hessian


def _continued(
    distance: Array, gradient: Array, hessian: Array, beyond: Array, outside: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Add the way (..., 2) [m] from the border; across it the border's own distance does not change."""
    length = np.hypot(beyond[..., 0], beyond[..., 1])
    safe = np.where(length > 0.0, length, 1.0)[..., None]
    direction = beyond / safe
    inside = ~outside
    turning = np.eye(2) * outside[..., None, :] - direction[..., :, None] * direction[..., None, :]
    return (
        distance + length,
        gradient * inside + direction,
        hessian * inside[..., :, None] * inside[..., None, :] + turning / safe[..., None],
    )


def _first_bad(points: Array) -> tuple[float, ...]:
    flat = points.reshape(-1, points.shape[-1])
    return tuple(flat[~np.isfinite(flat).all(axis=1)][0].tolist())
