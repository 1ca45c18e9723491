"""Derivatives of a residual that is written line by line, from its last line back to what it reads (reverse mode).

SymPy differentiates each line; the chain rule joins them. So the derivatives take a small multiple of the operations of
the residual, where derivatives of the residual as one expression would repeat its parts in each of them.
"""

# SymPy has no types: what it returns is unknown.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownLambdaType=false

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import sympy

from palpate.errors import SettingError

Expression = Any
"""An expression or a symbol of SymPy, whose own types know less."""
Assignments = list[tuple[Expression, Expression]]
"""Lines of code: the name and the value of each."""
ONE = sympy.Integer(1)


def with_calls_named(
    lines: Assignments, rows: Sequence[Expression], names: Iterator[Expression]
) -> tuple[Assignments, list[Expression]]:
    """Return the lines and rows with lines of their own for each call of a function and for its arguments."""
    calls = _Calls(names)
    same: dict[Expression, Expression] = {}
    for symbol, value in lines:
        shorter = calls.named(value.xreplace(same))
        if shorter.is_Atom:
            same[symbol] = shorter
        else:
            calls.lines.append((symbol, shorter))
    shorter_rows = [calls.named(row.xreplace(same)) for row in rows]
    return calls.lines, shorter_rows


class _Calls:
    """Lines that call functions, each call once."""

    def __init__(self, names: Iterator[Expression]) -> None:
        self.lines: Assignments = []
        self._names = names
        self._known: dict[Expression, Expression] = {}

    def named(self, value: Expression) -> Expression:
        """Return an expression with names in place of the calls in it."""
        if value.is_Atom:
            return value
        arguments = [self.named(argument) for argument in value.args]
        if not value.is_Function:
            return value.func(*arguments)
        return self._name(value.func(*(self._name(argument) for argument in arguments)))

    def _name(self, value: Expression) -> Expression:
        if value.is_Atom:
            return value
        if value not in self._known:
            self._known[value] = next(self._names)
            self.lines.append((self._known[value], value))
        return self._known[value]


class Derivatives:
    """Derivatives of the rows of one residual by the columns of a Jacobian."""

    def __init__(self, name: str, lines: Assignments, derivatives: dict[Expression, dict[int, Any]]) -> None:
        """Take the name of the factor, the lines before its rows, and the derivatives of what is read by columns."""
        self._name = name
        self._lines = lines
        self._by_column = derivatives
        self._names = sympy.numbered_symbols("d")
        self._calls = _Calls(self._names)
        self.temporaries = self._calls.lines
        """Lines to be added after those of the residual."""
        self._active = set(derivatives)  # symbols that are not constant
        for symbol, value in lines:
            if value.free_symbols & self._active:
                self._active.add(symbol)

    def of(self, row: Expression) -> dict[int, Expression]:
        """Return the derivatives of a row by column, of columns on which it depends."""
        slopes: dict[Expression, Expression] = {}
        self._add(slopes, ONE, row)
        for symbol, value in reversed(self._lines):
            if symbol in slopes:
                self._add(slopes, self._named(slopes.pop(symbol)), value, symbol)
        columns: dict[int, Expression] = {}
        for symbol in sorted(slopes, key=str):
            slope = slopes[symbol] if len(self._by_column[symbol]) == 1 else self._named(slopes[symbol])
            for column, by in self._by_column[symbol].items():
                columns[column] = columns.get(column, sympy.Integer(0)) + slope * by
        return {column: columns[column] for column in sorted(columns)}

    def _add(
        self,
        slopes: dict[Expression, Expression],
        slope: Expression,
        line: Expression,
        result: Expression | None = None,
    ) -> None:
        """Add the derivative of a line, times a slope, to those of the symbols in it; `result` is the line's name."""
        for symbol in self._ordered(line.free_symbols & self._active):
            try:
                by = sympy.diff(line, symbol)
            except (ValueError, TypeError) as error:
                raise SettingError(f"factor {self._name!r}: its residual has no derivative: {error}") from error
            if by.has(sympy.Derivative):
                raise SettingError(f"factor {self._name!r}: its residual has no derivative: SymPy leaves {by}")
            if result is not None:
                by = by.xreplace({line: result})  # the derivative of exp is what was computed
            by = self._calls.named(by)
            slopes[symbol] = slopes.get(symbol, sympy.Integer(0)) + slope * by

    def _named(self, slope: Expression) -> Expression:
        """Return a symbol for a derivative, unless it is as short as one."""
        if slope.is_Atom or (slope.is_Mul and len(slope.args) == 2 and slope.args[0] == -1 and slope.args[1].is_Atom):
            return slope
        symbol = next(self._names)
        self.temporaries.append((symbol, slope))
        return symbol

    @staticmethod
    def _ordered(symbols: Iterable[Expression]) -> list[Expression]:
        return sorted(symbols, key=str)
