"""Output of commands: tables or one JSON object on standard output, progress and errors on standard error."""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from palpate.errors import printable


@dataclass(frozen=True)
class Report:
    """Result of a command."""

    title: str
    data: dict[str, Any] | list[dict[str, Any]]
    """The JSON object of the command, or a list of them, which needs `shown`."""
    shown: dict[str, Any] | None = None
    """Content of its tables, by default that of the JSON object."""
    notes: Sequence[str] = ()
    """Lines below the tables."""
    code: int = 0
    """Exit code."""

    def print(self, as_json: bool) -> None:
        """Print JSON, or tables with its keys: one of values, and one for each list of objects."""
        if as_json:
            print(json.dumps(self.data, indent=2, allow_nan=False))
            return
        for title, rows in self._tables().items():
            widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
            lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
            print("", printable(title), *map(printable, lines), sep="\n")
        print("", *map(printable, self.notes), sep="\n")

    def _tables(self) -> dict[str, list[list[str]]]:
        """Return rows of cells by the title of their table; the first table is that of single values."""
        values: list[list[str]] = []
        tables = {self.title: values}
        shown = self.shown if isinstance(self.data, list) else self.shown or self.data
        for key, value in (shown or {}).items():
            rows = dict(enumerate(value)) if isinstance(value, list) else value
            if not (isinstance(rows, dict) and rows and all(isinstance(row, dict) for row in rows.values())):
                values.append([key, cell(value)])
                continue
            columns = list(dict.fromkeys(name for row in rows.values() for name in row))
            lines = [[str(name), *(cell(row.get(column)) for column in columns)] for name, row in rows.items()]
            title = f"{key}: the first 20 of {len(rows)}" if len(rows) > 20 else key
            tables[title] = [["", *columns], *lines[:20]]
        return tables


def cell(value: Any) -> str:
    """Return a value for a table: numbers with three digits, a dash for None."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {cell(item)}" for name, item in value.items()) or "-"
    if isinstance(value, list | tuple):
        return f"{len(value)}" if len(value) > 20 else ", ".join(map(cell, value)) or "-"
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
    """Show a bar on standard error while the block runs, but only if that is a terminal, even with FORCE_COLOR.

    Yields a function that takes the number done, and optionally a note.
    """
    if not sys.stderr.isatty():
        yield lambda done, note="": None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=total)
        yield lambda done, note="": progress.update(task, completed=done, description=f"{title} {note}".strip())
