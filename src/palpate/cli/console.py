"""Output of commands: tables or one JSON object on standard output, progress and errors on standard error."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Any

from palpate.errors import printable


def print_json(data: dict[str, Any]) -> None:
    """Print the one JSON object of a command."""
    print(json.dumps(data, indent=2, allow_nan=False))


def report(json: bool, title: str, data: dict[str, Any]) -> None:
    """Print the result of a command as one JSON object, or as tables with its keys, one for each list of objects."""
    if json:
        print_json(data)
        return
    several = {key: dict(enumerate(value)) if isinstance(value, list) else value for key, value in data.items()}
    tables = {
        key: rows
        for key, rows in several.items()
        if isinstance(rows, dict) and rows and all(isinstance(row, dict) for row in rows.values())
    }
    _print_table(title, ("", "value"), [(key, cell(value)) for key, value in data.items() if key not in tables])
    for name, rows in tables.items():
        keys = list(dict.fromkeys(key for row in rows.values() for key in row))
        cells = [[str(first), *(cell(row.get(key)) for key in keys)] for first, row in islice(rows.items(), 20)]
        more = f": the first 20 of {len(rows)}" if len(rows) > 20 else ""
        _print_table(name + more, ("", *keys), cells)


def cell(value: Any) -> str:
    """Return a value for a table: numbers with three digits, a dash for None."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {cell(each)}" for name, each in value.items()) or "-"
    if isinstance(value, list | tuple):
        return f"{len(value)}" if len(value) > 20 else ", ".join(map(cell, value)) or "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
    return "-" if value is None or value == "" else str(value)


def _print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table. Long cells are wrapped, not cut off; one for a file is wide, as there is no window to wrap for."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(title=printable(title), title_justify="left", title_style="bold", box=SIMPLE_HEAD)
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*map(printable, row))
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = max(console.width, 240)
    console.print(table)


def print_line(text: str) -> None:
    """Print a line for people."""
    print(printable(text))


def complain(error: Exception | str) -> None:
    """Print an error as one line on standard error."""
    print(f"palpate: {printable(' '.join(str(error).split()))}", file=sys.stderr)


@contextmanager
def progress_bar(title: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show a bar on standard error while the block runs; nothing where that is no terminal, even with FORCE_COLOR.

    Yields a function that takes the number done, and maybe a note.
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
