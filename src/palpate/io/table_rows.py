"""Rows of a table of times: cells that are dates or times of day, and rows that are not in the order of time."""

import logging
import math
import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array, Times
from palpate.errors import FileError
from palpate.io.time_order import UNKNOWN, are_few

logger = logging.getLogger(__name__)

_CLOCK = re.compile(
    r"(?:(?P<day>\d{4}-\d\d-\d\d)[T ])?(?P<hour>\d\d:\d\d:\d\d)(?:[.,](?P<part>\d{1,9}))? ?"
    r"(?P<zone>[Zz]|UTC|[-+]\d\d:?\d\d)?"
)
_EVEN = 0.98
"""Share of steps between sorted times that are alike, if these are the times of one stream."""
MISSING = ("", "na", "n/a", "#n/a", "null", "none", "-")
"""Cells that hold no number, as programs write them, in lower case."""


class Table(NamedTuple):
    """Rows of cells, below the names of their columns if there are any."""

    path: Path
    names: list[str]
    """Names as `column_name` writes them; empty without a header."""
    lines: list[int]
    """Line of each row in the file."""
    cells: list[list[str]]
    """Cells of each row."""

    def column(self, index: int) -> list[str]:
        """Return the cells of a column."""
        return [row[index] for row in self.cells]

    def numbers(self, indices: Sequence[int], expected: str = "") -> Array:
        """Return columns as numbers (N, columns), NaN where a cell holds none.

        Raises FileError that names the line and what is expected, by default numbers.
        """
        numbers = np.empty((len(self.cells), len(indices)))
        for index, (line, row) in enumerate(zip(self.lines, self.cells, strict=True)):
            words = [row[column] for column in indices]
            try:
                numbers[index] = [math.nan if word.lower() in MISSING else float(word) for word in words]
            except ValueError:
                expected = expected or ("a number" if len(indices) == 1 else f"{len(indices)} numbers")
                raise FileError(f"line {line}: found {','.join(words)[:80]!r}, expected {expected}") from None
        return numbers

    @property
    def columns(self) -> str:
        """Its columns in words, for errors."""
        return ", ".join(self.names) or f"{len(self.cells[0])} columns without a header"


def is_clock(word: str) -> bool:
    """Return true for a time as ISO 8601 writes it, with or without its day."""
    return _CLOCK.fullmatch(word) is not None


def with_numbers_for_clocks(table: Table, is_time: Callable[[str], bool]) -> Table:
    """Return a table in which times of ISO 8601 are nanoseconds since 1970, and times of day those since midnight.

    `is_time` tells names of columns of times without a unit. Times without a zone are taken to be in UTC, with a
    warning if they have a day. Raises FileError if some have a zone or a day and others none.
    """
    cells = [list(row) for row in table.cells]
    names = list(table.names)
    for index in range(len(cells[0])):
        column = [row[index] for row in cells]
        matches = [_CLOCK.fullmatch(cell) for cell in column]
        found = [match for match in matches if match is not None]
        if not found or len(found) + sum(cell.lower() in MISSING for cell in column) < len(cells):
            continue
        kinds = {(match["day"] is None, match["zone"] is None) for match in found}
        if len(kinds) > 1:
            raise FileError(
                f"{table.path}: some times have a day or a zone and others none; allowed is one form for all"
            )
        if kinds == {(False, True)}:
            logger.warning("%s: times have no zone and are taken to be in UTC", table.path)
        for row, match in zip(cells, matches, strict=True):
            row[index] = "" if match is None else str(_nanoseconds_of(match, table.path))
        if names and is_time(names[index]):
            names[index] += "_ns"
    return table._replace(names=names, cells=cells)


def _nanoseconds_of(match: re.Match[str], path: Path) -> int:
    """Return the time [ns] since 1970, or since midnight without a day. Raises FileError if there is no such time."""
    zone = match["zone"] or "Z"
    offset = "+00:00" if zone in ("Z", "z", "UTC") else zone
    try:
        time = datetime.fromisoformat(f"{match['day'] or '1970-01-01'}T{match['hour']}{offset}")
    except ValueError as error:
        raise FileError(f"{path}: there is no time {match[0]!r}; allowed is such as 2026-11-29T08:15:30.25Z") from error
    whole = (time - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(seconds=1)
    return whole * 10**9 + int((match["part"] or "").ljust(9, "0"))


def are_even(steps: NDArray[Any], least: float = _EVEN) -> bool:
    """Return true if a share of steps (N,), of `least` or more, are alike, as those of times of one stream."""
    usual = float(np.median(steps))
    return float(np.mean((steps > 0.5 * usual) & (steps < 1.5 * usual))) >= least


def rows_in_order(path: Path, rows: Sequence[Sequence[Any]], stamps: Times) -> NDArray[np.intp]:
    """Return the numbers of rows at times (N,) [ns] without those that are there twice, in the order of time.

    Rows are sorted, with a warning, only if that leaves even steps, as of one stream that was shuffled, reversed or
    sorted by something else. Others stay as they are, since times that go back are evidence: see `time_order`.
    """
    first = {(stamps[number], *row): number for number, row in reversed(list(enumerate(rows)))}
    numbers = np.sort(np.array(list(first.values()), np.intp))
    if len(numbers) < len(rows):
        logger.warning("%s: %d of %d rows are there twice", path, len(rows) - len(numbers), len(rows))
    known = stamps[numbers]
    back = int((np.diff(known) < 0).sum())
    if not back or (known == UNKNOWN).any():
        return numbers
    order = np.argsort(known, kind="stable")
    if not are_even(np.diff(known[order]), 1.0 if are_few(back, len(known)) else _EVEN):
        return numbers
    logger.warning("%s: rows are not in the order of time and are sorted", path)
    return numbers[order]
