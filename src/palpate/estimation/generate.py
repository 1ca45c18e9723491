"""Compiled code from a model: each factor's residual and weight, and the derivatives that SymPy takes of them.

Used by `make kernels`, and by `models.pushing.compiled.extended_pushing`; a written file is used without it.
"""

# SymPy has no types: what it returns is unknown.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false

import inspect
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import sympy
from sympy.printing.precedence import PRECEDENCE
from sympy.printing.pycode import PythonCodePrinter

from palpate.errors import SettingError
from palpate.estimation.differentiate import Derivatives, with_calls_named
from palpate.estimation.factor import Factor
from palpate.estimation.model import Model
from palpate.estimation.symbols import Symbols
from palpate.manifolds.symbolic import FUNCTIONS

HEADER = '''"""Compiled code of the model in `{source}`: written by `make kernels`, not by hand.

Each function writes the linearised rows of a factor to `out` and returns their number; see
`estimation.records.linear_type`.
{columns}
"""

import math

from palpate.arrays import Array, Records
from palpate.compiled import kernel
from palpate.manifolds.function_kernels import (
    beyond,
    bearing,
    clamp,
    half_cotangent,
    half_cotangent_slope,
    inverse_square,
    is_within,
    larger,
    side,
    wrap,
)
from palpate.manifolds.se2_kernels import between, cauchy, exp_onto, log, rotation
from palpate.estimation.whitening import whiten
{lookups}'''
STEP_ARGUMENTS = "before: Records, now: Records, row: Records, settings: Records, out: Records"
MEASURED_ARGUMENTS = "now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records"


class _Printer(PythonCodePrinter):
    """Python code in which numbers keep all their digits and functions of residuals are called by name.

    What is read once is read where it is used; what is read several times gets a line of its own.
    """

    def __init__(self, symbols: Symbols, values: Sequence[Any]) -> None:
        functions = (*FUNCTIONS, "inverse_square", "is_within", "half_cotangent_slope")
        super().__init__({"user_functions": {name: name for name in functions}})
        self._load = symbols.load
        self._uses = Counter(atom for value in values for atom in _atoms(value))
        self._loaded: set[sympy.Symbol] = set()

    def loads(self, values: Sequence[Any]) -> Iterable[str]:
        """Yield the lines that load the symbols in some values, each once."""
        needed = set().union(*(value.free_symbols for value in values)) & self._load.keys()
        for symbol in sorted(needed - self._loaded, key=str):
            self._loaded.add(symbol)
            if not self._is_inline(symbol) and self._load[symbol] != str(symbol):
                yield f"    {symbol} = {self._load[symbol]}"

    def _is_inline(self, symbol: sympy.Symbol) -> bool:
        return symbol in self._load and self._uses[symbol] == 1 and " if " not in self._load[symbol]

    def _print_Symbol(self, expr: Any) -> str:
        return self._load[expr] if self._is_inline(expr) else str(expr)

    def _print_Float(self, expr: Any) -> str:
        return repr(float(expr))

    def _print_Integer(self, expr: Any) -> str:
        return f"{int(expr)}.0"

    def _print_Rational(self, expr: Any) -> str:
        return repr(float(expr))

    def _print_exp(self, call: sympy.Function) -> str:
        return f"math.exp({self._print(call.args[0])})"

    def _print_sin(self, call: sympy.Function) -> str:
        return f"math.sin({self._print(call.args[0])})"

    def _print_cos(self, call: sympy.Function) -> str:
        return f"math.cos({self._print(call.args[0])})"

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        base = self.parenthesize(expr.base, PRECEDENCE["Pow"])
        if expr.exp.is_Integer:
            return f"{base}**{int(expr.exp)}" if expr.exp > 0 else f"{base}**({int(expr.exp)})"
        return f"{base}**{self.parenthesize(expr.exp, PRECEDENCE['Pow'])}"


def _atoms(value: Any) -> Iterable[sympy.Symbol]:
    """Yield the symbols in a value, as often as they stand there."""
    return (node for node in sympy.preorder_traversal(value) if isinstance(node, sympy.Symbol))


def generate(model: Model, settings: np.dtype, source: str) -> str:
    """Return the text of the module of compiled code.

    Raises SettingError, which names the factor, where a residual cannot be differentiated or reads what is not there.
    """
    imports = [
        f"from {factor.lookup.__module__} import {factor.lookup.__name__}\n"
        for factor in model.factors
        if factor.lookup is not None
    ]
    lookups = "".join(dict.fromkeys(imports))
    parts = [HEADER.format(source=source, columns="\n".join(_columns(model)), lookups=lookups)]
    parts.extend(_step_functions(model))
    parts.extend(_factor_function(model, settings, factor) for factor in model.factors)
    parts.append(_dispatch(model, "linearise_step", STEP_ARGUMENTS, _is_of_step))
    parts.append(_dispatch(model, "linearise_measured", MEASURED_ARGUMENTS, _is_measured))
    return "\n\n".join(part.strip("\n") + "\n" for part in parts)


def _is_of_step(factor: Factor) -> bool:
    return factor.steps is not None


def _is_measured(factor: Factor) -> bool:
    return factor.steps is None


def _columns(model: Model) -> Iterable[str]:
    yield ""
    yield "Columns of a Jacobian:"
    yield ""
    for step, first in (("before", 0), ("now", model.step_size)):
        for variable, place in model.in_step.items():
            yield f"- {first + place.start} to {first + place.stop - 1}: {variable.name} of the step {step}"
    for variable in model.shared:
        yield f"- {model.column(variable)}{_to(model.column(variable), variable.dimension)}: {variable.name}"


def _to(first: int, count: int) -> str:
    return f" to {first + count - 1}" if count > 1 else ""


def _step_functions(model: Model) -> Iterable[str]:
    """Yield the functions that move a step, copy it, compare it with a past one, and write its rotations."""
    steps = list(model.in_step.items())
    move = [f"exp_onto(now.{variable.field}, change[{place.start}:])" for variable, place in steps]
    yield _function(
        "move_step(now: Records, change: Array) -> None",
        "Perturb the variables of a step by a tangent vector.",
        move,
    )
    copy = [f"past.{variable.field} = now.{variable.field}" for variable, _ in steps]
    yield _function(
        "copy_step(now: Records, past: Records) -> None",
        "Copy the variables of a step to a past one.",
        copy,
    )
    compare: list[str] = []
    for variable, place in steps:
        compare.append(f"between(past.{variable.field}, now.{variable.field}, error)")
        compare.append(f"log(error, change[{place.start} : {place.stop}])")
    yield _function(
        "difference(past: Records, now: Records, error: Array, change: Array) -> None",
        "Write the tangent vector from a past step to this one; `error` is room.",
        compare,
    )
    rotations = [f"now.turn_{variable.field} = rotation(now.{variable.field}[2])" for variable, _ in steps]
    yield _function(
        "put_rotations(now: Records) -> None",
        "Write the rotations of the poses of a step.",
        rotations,
    )


def _function(signature: str, summary: str, lines: Sequence[str]) -> str:
    """Return the text of a compiled function."""
    body = "\n".join(f"    {line}" for line in lines)
    return f'@kernel\ndef {signature}:\n    """{summary}"""\n{body}'


def _factor_function(model: Model, settings: np.dtype, factor: Factor) -> str:
    """Return the text of the function that linearises a factor."""
    _check(factor, settings)
    symbols = Symbols(model, settings, factor)
    arguments = symbols.arguments()
    residual = [sympy.sympify(row) for row in _called(factor.residual, arguments)]
    variance = [sympy.sympify(row) for row in _called(factor.variance, arguments)] if factor.variance else []
    weight = [sympy.sympify(_called(factor.weight, arguments))] if factor.weight else []
    condition = [_called(factor.applies, arguments)] if factor.applies else []
    names = sympy.numbered_symbols("t")
    reduced: Any
    repeated, reduced = sympy.cse([*residual, *variance, *weight], names, order="none")
    temporaries, outputs = with_calls_named(repeated, reduced, names)
    count = len(residual)
    derivatives = Derivatives(factor.name, temporaries, symbols.derivatives)
    jacobian = [derivatives.of(row) for row in outputs[:count]]
    assignments = [*temporaries, *derivatives.temporaries]

    differences = _differences(model, symbols, outputs[:count])
    each = count - (model.object_size if differences else 0)  # rows that are written one by one
    read = [*outputs[:each], *outputs[count:], *(value for _, value in assignments), *_values(jacobian[:each])]
    code = _Printer(symbols, [*condition, *read])
    lines = ["@kernel", f"def {factor.name}({STEP_ARGUMENTS if factor.steps else MEASURED_ARGUMENTS}) -> int:"]
    lines.append(f'    """{_summary(factor)}"""')
    if factor.finger is not None:
        steps = ("before", "now") if factor.steps == "pair" else ("now",)
        touch = " and ".join(f"{step}.touches[{factor.finger}] > 0.5" for step in steps)
        lines.append(f"    if not ({touch}):")
        lines.append("        return 0")
    if factor.lookup is not None:
        names = ", ".join(f"known_{name}" for name in factor.found)
        step = "now" if factor.finger is None else f"now, {factor.finger}"
        lines.append(f"    {names} = {factor.lookup.__name__}({step}, places)")
    if condition:
        lines.extend(code.loads(condition))
        lines.append(f"    applies = {code.doprint(condition[0])}")
        lines.append("    if not applies:")
        lines.append("        return 0")
    lines.extend(code.loads(read))
    lines.extend(f"    {name} = {code.doprint(value)}" for name, value in assignments)
    lines.extend(f"    out.residual[{r}] = {code.doprint(row)}" for r, row in enumerate(outputs[:each]))
    lines.extend(differences)
    for r, row in enumerate(jacobian[:each]):
        lines.extend(f"    out.jacobian[{r}, {column}] = {code.doprint(value)}" for column, value in row.items())
    lines.extend(_weights(factor, code, outputs[count:], count))
    lines.append(f"    return {count}")
    return "\n".join(lines)


def _differences(model: Model, symbols: Symbols, residual: Sequence[Any]) -> list[str]:
    """Return the loop that writes the last rows of a residual, if they are all differences from the belief."""
    size = model.object_size
    if not size or list(residual[-size:]) != symbols.differences:
        return []
    first = len(residual) - size
    return [
        f"    for k in range({size}):",
        f"        out.residual[{first} + k] = row.shared[{model.contact_size} + k] - row.first_values[k]",
        f"        out.jacobian[{first} + k, {2 * model.step_size + model.contact_size} + k] = 1.0",
    ]


def _check(factor: Factor, settings: np.dtype) -> None:
    """Raise SettingError on a robust kernel that has no scale, or no rows to act on."""
    if factor.kernel == "none":
        return
    group = factor.settings or factor.name
    has_scale = group in (settings.names or ()) and "kernel" in (settings[group].names or ())
    if not has_scale:
        groups = [name for name in settings.names or () if "kernel" in (settings[name].names or ())]
        raise SettingError(
            f"factor {factor.name!r} has a robust kernel, and the settings {group!r} have no scale for it; "
            f"settings= names one of {', '.join(groups)}"
        )
    if factor.variance is None:
        raise SettingError(f"factor {factor.name!r} has a robust kernel, which needs a variance for each row")


def _values(jacobian: Sequence[dict[int, sympy.Expr]]) -> list[sympy.Expr]:
    return [value for row in jacobian for value in row.values()]


def _called(function: Any, arguments: dict[str, Any]) -> Any:
    """Return a function of the given arguments that it names."""
    return function(**{name: arguments[name] for name in inspect.signature(function).parameters})


def _weights(factor: Factor, code: _Printer, reduced: Sequence[Any], count: int) -> Iterable[str]:
    """Yield the lines that write information and weight of the rows."""
    if factor.variance is None:
        yield f"    whiten({count}, {'row.first_root' if factor.root is None else 'term.root'}, out)"
        return
    share = "1.0" if factor.weight is None else code.doprint(reduced[count])
    is_same = len(set(reduced[:count])) == 1
    for r in range(1 if is_same else count):
        yield f"    information{r} = {share} / ({code.doprint(reduced[r])})"
    names = [f"information{0 if is_same else r}" for r in range(count)]
    scale = f"settings.{factor.settings or factor.name}.kernel"
    if factor.kernel == "together":
        squares = " + ".join(f"{names[r]} * out.residual[{r}]**2" for r in range(count))
        yield f"    left = cauchy({squares}, {scale})"
    for r in range(count):
        yield f"    out.information[{r}] = {names[r]}"
        left = {
            "none": "",
            "each": f" * cauchy({names[r]} * out.residual[{r}]**2, {scale})",
            "together": " * left",
        }[factor.kernel]
        yield f"    out.weight[{r}] = {names[r]}{left}"


def _summary(factor: Factor) -> str:
    """Return the first sentence of the documentation of a factor's residual."""
    text = inspect.getdoc(factor.residual) or factor.name
    return text.split("\n\n")[0].replace("\n", " ")


def _dispatch(model: Model, name: str, arguments: str, belongs: Any) -> str:
    """Return the text of the function that calls the function of a factor by its place among all."""
    call = ", ".join(part.split(":")[0] for part in arguments.split(", "))
    lines = ["@kernel", f"def {name}(kind: int, {arguments}) -> int:"]
    lines.append('    """Write the linearised rows of the factor of this place, and return their number."""')
    for place, factor in enumerate(model.factors):
        if belongs(factor):
            lines.append(f"    if kind == {place}:")
            lines.append(f"        return {factor.name}({call})")
    lines.append("    return 0")
    return "\n".join(lines)
