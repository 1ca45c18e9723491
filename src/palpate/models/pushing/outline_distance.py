"""Signed distance to an outline, with its gradient and Hessian, from the spline of a distance field."""

from palpate.compiled import kernel
from palpate.geometry.distance_field import DistanceField

Weights = tuple[float, float, float, float]
_ORDER = 3  # of the spline: it has so many more coefficients than cells along each axis


@kernel
def distance_at(point: complex, field: DistanceField) -> tuple[float, complex, complex, complex]:
    """Return signed distance, gradient, and the gradient's derivatives along x and y.

    They are those of a cubic B-spline inside the grid; outside, the value at the nearest point of the border plus the
    distance to it.
    """
    origin, cell, coefficients = field
    rows = coefficients.shape[0] - _ORDER
    columns = coefficients.shape[1] - _ORDER
    x = (point.real - origin[0]) / cell
    y = (point.imag - origin[1]) / cell
    at_x = min(max(x, 0.0), columns - 1.0)
    at_y = min(max(y, 0.0), rows - 1.0)
    value, gradient, bend_x, bend_y = _spline(at_x, at_y, field)
    if x == at_x and y == at_y:
        return value, gradient, bend_x, bend_y
    off = complex(x - at_x, y - at_y) * cell
    length = abs(off)
    way = off / length
    # Beyond a border, the nearest point of the grid does not move across it.
    is_beyond_x = 1.0 if x != at_x else 0.0
    is_beyond_y = 1.0 if y != at_y else 0.0
    inside_x = 1.0 - is_beyond_x
    inside_y = 1.0 - is_beyond_y
    gradient = complex(gradient.real * inside_x, gradient.imag * inside_y) + way
    across = bend_x.imag * inside_x * inside_y - way.real * way.imag / length
    bend_x = complex(bend_x.real * inside_x + (is_beyond_x - way.real**2) / length, across)
    bend_y = complex(across, bend_y.imag * inside_y + (is_beyond_y - way.imag**2) / length)
    return value + length, gradient, bend_x, bend_y


@kernel
def _spline(x: float, y: float, field: DistanceField) -> tuple[float, complex, complex, complex]:
    """Return value, gradient, and the gradient's derivatives along x and y of the spline at a place in cells."""
    _origin, cell, coefficients = field
    column = int(x)
    row = int(y)
    weights_x = _weights(x - column)
    weights_y = _weights(y - row)
    value = 0.0
    by_x = 0.0
    by_y = 0.0
    by_xx = 0.0
    by_xy = 0.0
    by_yy = 0.0
    for i in range(4):
        along = 0.0
        slope = 0.0
        curvature = 0.0
        for j in range(4):
            coefficient = coefficients[row + i, column + j]
            along += coefficient * weights_x[0][j]
            slope += coefficient * weights_x[1][j]
            curvature += coefficient * weights_x[2][j]
        value += weights_y[0][i] * along
        by_x += weights_y[0][i] * slope
        by_xx += weights_y[0][i] * curvature
        by_y += weights_y[1][i] * along
        by_xy += weights_y[1][i] * slope
        by_yy += weights_y[2][i] * along
    gradient = complex(by_x, by_y) / cell
    bend_x = complex(by_xx, by_xy) / cell**2
    bend_y = complex(by_xy, by_yy) / cell**2
    return value, gradient, bend_x, bend_y


@kernel
def _weights(f: float) -> tuple[Weights, Weights, Weights]:
    """Return the weights of four spline coefficients at position f in a cell: value, first and second derivative."""
    rest = 1.0 - f
    value = (
        rest**3 / 6.0,
        (4.0 - 6.0 * f**2 + 3.0 * f**3) / 6.0,
        (1.0 + 3.0 * f + 3.0 * f**2 - 3.0 * f**3) / 6.0,
        f**3 / 6.0,
    )
    first = (-0.5 * rest**2, 1.5 * f**2 - 2.0 * f, 0.5 + f - 1.5 * f**2, 0.5 * f**2)
    second = (rest, 3.0 * f - 2.0, 1.0 - 3.0 * f, f)
    return value, first, second
