"""The functions of `manifolds.functions`, and their derivatives, for compiled code."""

import math

from palpate.compiled import kernel
from palpate.manifolds import se2_kernels

wrap = se2_kernels.wrap

_SERIES_BELOW = 0.1  # [rad]; here the series below is exact to rounding and the closed form loses three digits
_LEAST_SQUARE = 1e-12  # squared length of a vector of unit length that has no direction any more


@kernel
def bearing(x: float, y: float) -> float:
    """Return the angle of a vector [rad]."""
    return math.atan2(y, x)


@kernel
def inverse_square(x: float, y: float) -> float:
    """Return one over the squared length of a vector that should have length 1, bounded where it nearly vanishes."""
    return 1.0 / max(x * x + y * y, _LEAST_SQUARE)


@kernel
def half_cotangent(angle: float) -> float:
    """Return h / tan(h) of half an angle [rad]."""
    half = 0.5 * angle
    return half / math.tan(half) if half != 0.0 else 1.0


@kernel
def half_cotangent_slope(angle: float) -> float:
    """Return the derivative of `half_cotangent`."""
    if abs(angle) < _SERIES_BELOW:
        square = angle * angle
        return -angle / 6.0 * (1.0 + square / 30.0 * (1.0 + square / 28.0 * (1.0 + square / 30.0)))
    half = 0.5 * angle
    sine = math.sin(half)
    return 0.5 * (math.cos(half) / sine - half / (sine * sine))


@kernel
def clamp(value: float, limit: float) -> float:
    """Return the value, or the limit nearest to it."""
    return min(max(value, -limit), limit)


@kernel
def is_within(value: float, limit: float) -> float:
    """Return 1 inside of -limit to limit and 0 elsewhere: the derivative of `clamp`."""
    return 1.0 if abs(value) < limit else 0.0


@kernel
def side(value: float) -> float:
    """Return the sign of a number, 0 for 0."""
    if value > 0.0:
        return 1.0
    if value < 0.0:
        return -1.0
    return 0.0


@kernel
def larger(a: float, b: float) -> float:
    """Return the larger of two numbers."""
    return max(a, b)


@kernel
def beyond(angle: float, limit: float, width: float) -> float:
    """Return 0 inside a limit and 1 outside, smoothly within 1.5 widths of it."""
    part = min(max(0.5 + (abs(angle) - limit) / (3.0 * width), 0.0), 1.0)
    return part * part * (3.0 - 2.0 * part)
