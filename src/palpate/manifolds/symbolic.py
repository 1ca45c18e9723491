"""The functions of `manifolds.functions` as SymPy knows them, with their derivatives; for generating code."""

from typing import Any

import sympy


def _function(name: str, *derivatives: Any) -> type[sympy.Function]:
    """Return a function of SymPy with this name, whose derivatives by each argument are functions of all arguments.

    Without derivatives it may stand in a noise model only: to differentiate it is an error that names it.
    """

    def fdiff(self: sympy.Function, argindex: int = 1) -> sympy.Expr:
        if not derivatives:
            raise ValueError(f"{name}() has no derivative; it may stand in a noise model, not in a residual")
        return derivatives[argindex - 1](*self.args)

    return type(name, (sympy.Function,), {"fdiff": fdiff})


_inverse_square = _function("inverse_square")
_half_cotangent_slope = _function("half_cotangent_slope")
_is_within = _function("is_within")

FUNCTIONS: dict[str, Any] = {
    "wrap": _function("wrap", lambda _angle: sympy.Integer(1)),
    "bearing": _function("bearing", lambda x, y: -y * _inverse_square(x, y), lambda x, y: x * _inverse_square(x, y)),
    "half_cotangent": _function("half_cotangent", lambda angle: _half_cotangent_slope(angle)),
    "clamp": _function("clamp", lambda value, limit: _is_within(value, limit), lambda _value, _limit: sympy.Integer(0)),
    "side": _function("side", lambda _value: sympy.Integer(0)),
    "larger": _function("larger"),
    "beyond": _function("beyond"),
    "exp": sympy.exp,
    "sin": sympy.sin,
    "arctan": sympy.atan,
}
"""Functions by name; those that are not SymPy's own are printed as calls of `manifolds.function_kernels`."""
