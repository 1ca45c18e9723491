"""Functions that residuals and noise models may use, of numbers and of symbols alike.

Each stands in three forms: here, by name, for whoever writes a residual; in `manifolds.function_kernels`, for compiled
code; and in `manifolds.symbolic`, with its derivative, for SymPy. Where a function has a kink, its derivative is that
of one side.
"""

import math
from typing import Any

from palpate.manifolds import function_kernels

Scalar = Any
"""A number, or a SymPy expression while code is generated."""


def wrap(angle: Scalar) -> Scalar:
    """Return the same angle [rad] in (-pi, pi]."""
    return _apply("wrap", angle)


def bearing(x: Scalar, y: Scalar) -> Scalar:
    """Return the angle of a vector [rad] in (-pi, pi]; its derivative is 0 where the vector is."""
    return _apply("bearing", x, y)


def half_cotangent(angle: Scalar) -> Scalar:
    """Return h / tan(h) of half an angle h, which is 1 at 0."""
    return _apply("half_cotangent", angle)


def clamp(value: Scalar, limit: Scalar) -> Scalar:
    """Return the value, or the limit nearest to it where it is outside of -limit to limit."""
    return _apply("clamp", value, limit)


def side(value: Scalar) -> Scalar:
    """Return 1 for positive numbers, -1 for negative ones and 0 for 0."""
    return _apply("side", value)


def larger(a: Scalar, b: Scalar) -> Scalar:
    """Return the larger of two numbers."""
    return _apply("larger", a, b)


def beyond(angle: Scalar, limit: Scalar, width: Scalar) -> Scalar:
    """Return 0 where |angle| is inside a limit and 1 where it is outside, smoothly within 1.5 widths of it.

    Farther inside it is exactly 0: in a contact that sticks for minutes, many small values would add up and shrink the
    friction cone to the force.
    """
    return _apply("beyond", angle, limit, width)


def exp(value: Scalar) -> Scalar:
    """Return e to the power of a number."""
    return _apply("exp", value)


def sin(angle: Scalar) -> Scalar:
    """Return the sine of an angle [rad]."""
    return _apply("sin", angle)


def arctan(value: Scalar) -> Scalar:
    """Return the angle [rad] of this tangent."""
    return _apply("arctan", value)


def _apply(name: str, *values: Scalar) -> Scalar:
    if any(hasattr(value, "free_symbols") for value in values):
        from palpate.manifolds import symbolic

        return symbolic.FUNCTIONS[name](*values)
    plain = getattr(math, {"arctan": "atan"}.get(name, name), None)
    return plain(*values) if plain else getattr(function_kernels, name).function(*values)
