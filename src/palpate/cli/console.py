"""Output of commands: tables or one JSON object on standard output, progress and errors on standard error."""

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, Any

from palpate.errors import printable

if TYPE_CHECKING:
    from rich.table import Table

UNITS = {"share": "%", "hz": "Hz", "s": "s", "ms": "ms", "mm": "mm", "deg": "deg", "nats": "nats"}
"""Ends of keys, as in `delay_s`, and their units."""
NAMES = {
    "in_95": "in the 95 % region",
    "in_95_contact": "in the 95 % region, in contact",
    "in_95_rest": "in the 95 % region, at rest",
    "nees_mean": "NEES, mean (3 if consistent)",
    "nats": "log likelihood in contact [nats]",
    "nats_rescaled": "with the best factor on covariances [nats]",
    "crps": "CRPS in contact",
    "sigma": "sigma in contact",
    "episodes": "contacts",
}
"""Names of keys, without their units, that say too little by themselves."""


def print_json(data: dict[str, Any]) -> None:
    """Print the one JSON object of a command."""
    print(json.dumps(data, indent=2, allow_nan=False))


def report(json: bool, title: str, data: dict[str, Any]) -> None:
    """Print the result of a command as one JSON object or as tables, one for each list or dictionary of objects."""
    if json:
        print_json(data)
        return
    several = {key: dict(enumerate(value)) if isinstance(value, list) else value for key, value in data.items()}
    tables = {
        key: rows
        for key, rows in several.items()
        if isinstance(rows, dict) and rows and all(isinstance(row, dict) for row in rows.values())
    }
    print_table(quantities(title, {key: value for key, value in data.items() if key not in tables}))
    for key, rows in tables.items():
        title = key.replace("_", " ") + (f": the first 20 of {len(rows)}" if len(rows) > 20 else "")
        print_rows(title, dict(islice(rows.items(), 20)))


def quantities(title: str, data: Mapping[str, Any]) -> "Table":
    """Return a table of quantities with their units."""
    rows = [(name, cell(key, value), unit) for key, value in data.items() for name, unit in [_name_and_unit(key)]]
    return _table(title, ("quantity", "value", "unit"), rows, "left")


def print_rows(title: str, rows: Mapping[Any, Mapping[str, Any]]) -> None:
    """Print a table with a named row for each object; units are those of the keys."""
    keys = list(dict.fromkeys(key for row in rows.values() for key in row))
    headings = [f"{name} [{unit}]" if unit else name for name, unit in map(_name_and_unit, keys)]
    cells = [[str(name), *(cell(key, row.get(key)) for key in keys)] for name, row in rows.items()]
    print_table(_table(title, ("", *headings), cells, "right"))


def cell(key: str, value: Any) -> str:
    """Return a value for a table: numbers with three digits, shares in %, a dash for None."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {cell(key, each)}" for name, each in value.items()) or "-"
    if isinstance(value, list | tuple):
        return f"{len(value)}" if len(value) > 20 else ", ".join(cell(key, each) for each in value) or "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        value *= 100.0 if key.endswith("_share") else 1.0
        return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
    return "-" if value is None or value == "" else str(value)


def _name_and_unit(key: str) -> tuple[str, str]:
    name, _, end = key.rpartition("_")
    name, unit = (name, UNITS[end]) if name and end in UNITS else (key, "")
    return NAMES.get(name, name.replace("_", " ")), unit


def _table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], justify: Any) -> "Table":
    """Return a table, all columns but the first aligned to one side. Long cells are wrapped, not cut off."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title=printable(title), title_justify="left", title_style="bold", box=SIMPLE_HEAD)
    for index, column in enumerate(columns):
        table.add_column(column, justify=justify if index else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(printable, row))
    return table


def print_table(table: "Table") -> None:
    """Print a table; one for a file is wide, since there is no window to wrap for."""
    from rich.console import Console

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
