"""Output of commands: lines, tables or one JSON object on standard output, progress and errors on standard error."""

import json
import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic
from typing import Any

from palpate.errors import printable

progress_log = logging.getLogger("palpate.progress")
"""Enabled for INFO unless a command is to be quiet."""


@dataclass(frozen=True)
class Report:
    """Result of a command."""

    title: str
    data: dict[str, Any] | list[dict[str, Any]]
    """The JSON object of the command, or a list of them, which needs `shown`."""
    shown: dict[str, Any] | None = None
    """Content of its tables, by default that of the JSON object."""
    lines: Sequence[str] = ()
    """The result in short, which is printed in place of the tables unless all is asked for."""
    notes: Sequence[str] = ()
    """Lines below the tables."""
    code: int = 0
    """Exit code."""

    def print(self, as_json: bool, show_all: bool = False) -> None:
        """Print JSON, or the lines, or tables with its keys: of values, and one for each list of objects."""
        if as_json:
            print(json.dumps(self.data, indent=2, allow_nan=False))
            return
        if self.lines and not show_all:
            print(*map(printable, (*self.lines, *self.notes)), sep="\n")
            return
        for title, rows in self._tables(sys.maxsize if show_all else 20).items():
            widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
            lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
            print("", printable(title), *map(printable, lines), sep="\n")
        print("", *map(printable, self.notes), sep="\n")

    def _tables(self, most: int) -> dict[str, list[list[str]]]:
        """Return at most so many rows of cells by the title of their table; the first table has the single values."""
        values: list[list[str]] = []
        tables = {self.title: values}
        shown = self.shown if isinstance(self.data, list) else self.shown or self.data
        for key, value in (shown or {}).items():
            rows = dict(enumerate(value)) if isinstance(value, list) else value
            if not (isinstance(rows, dict) and rows and all(isinstance(row, dict) for row in rows.values())):
                if value is not None and value != "":
                    values.append([key, cell(value)])
                continue
            columns = list(dict.fromkeys(name for row in rows.values() for name in row))
            lines = [[str(name), *(cell(row.get(column)) for column in columns)] for name, row in rows.items()]
            title = f"{key}: the first {most} of {len(rows)}, --all shows all" if len(rows) > most else key
            tables[title] = [["", *columns], *lines[:most]]
        return tables


def cell(value: Any) -> str:
    """Return a value for a table: numbers with three digits, a dash for None, none for an empty list."""
    if isinstance(value, dict):
        if any(isinstance(item, str) and " " in item for item in value.values()):  # sentences, with commas of their own
            return "; ".join(f"{name}: {cell(item)}" for name, item in value.items())
        return ", ".join(f"{name} {cell(item)}" for name, item in value.items()) or "none"
    if isinstance(value, list | tuple):
        return f"{len(value)}" if len(value) > 20 else ", ".join(map(cell, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
    return "-" if value is None or value == "" else str(value)


def complain(error: Exception | str) -> None:
    """Print an error as one line on standard error."""
    print(f"palpate: {printable(' '.join(str(error).split()))}", file=sys.stderr)


@contextmanager
def progress_bar(title: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show a bar on standard error while the block runs; where that is no terminal, a line a minute.

    Yields a function that takes the number done, and optionally a note. Nothing is shown by a quiet command.
    """
    if not progress_log.isEnabledFor(logging.INFO):
        yield lambda done, note="": None
        return
    if not sys.stderr.isatty():
        yield _line_a_minute(title, total)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=total)
        yield lambda done, note="": progress.update(task, completed=done, description=f"{title} {note}".strip())


def _line_a_minute(title: str, total: int | None) -> Callable[..., None]:
    """Return a function that prints a line with the number done, at most once a minute."""
    begin = monotonic()
    last = begin

    def show(done: int, note: str = "") -> None:
        nonlocal last
        now = monotonic()
        if now - last < 60.0:  # [s]
            return
        last = now
        count = f"{done} of {total}" if total else f"{done}"
        complain(f"{title} {note}".strip() + f": {count} after {(now - begin) / 60.0:.0f} min")

    return show
