"""Output of commands: tables or one JSON object on standard output, progress and errors on standard error."""

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

from palpate.errors import printable

if TYPE_CHECKING:
    from rich.console import Console


def print_json(data: dict[str, Any]) -> None:
    """Print the one JSON object of a command."""
    print(json.dumps(data, indent=2, allow_nan=False))


def report(json: bool, title: str, data: dict[str, Any]) -> None:
    """Print the result of a command as one JSON object or as tables, one for each list of objects in it."""
    if json:
        print_json(data)
        return
    tables = [key for key, value in data.items() if isinstance(value, list) and value and isinstance(value[0], dict)]
    print_quantities(title, {key: value for key, value in data.items() if key not in tables})
    for key in tables:
        print_rows(key, dict(enumerate(data[key])))


def print_quantities(title: str, data: Mapping[str, Any]) -> None:
    """Print a table of quantities, each with its unit, which its key ends with as in `delay_s`."""
    rows = [(*_name_and_unit(key), cell(key, value)) for key, value in data.items()]
    _print_table(title, ("quantity", "value", "unit"), [(name, value, unit) for name, unit, value in rows], right=False)


def print_rows(title: str, rows: Mapping[Any, Mapping[str, Any]]) -> None:
    """Print a table with a named row for each object; units are those of the keys."""
    keys = list(dict.fromkeys(key for row in rows.values() for key in row))
    headings = [f"{name} [{unit}]" if unit else name for name, unit in map(_name_and_unit, keys)]
    cells = [[str(name), *(cell(key, row.get(key)) for key in keys)] for name, row in rows.items()]
    _print_table(title, ("", *headings), cells, right=True)


def cell(key: str, value: Any) -> str:
    """Return a value for a table: numbers with three digits, shares in %, a dash for None."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {cell(key, each)}" for name, each in value.items()) or "-"
    if isinstance(value, list | tuple):
        return ", ".join(cell(key, each) for each in value) or "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        value *= 100.0 if key.endswith("_share") else 1.0
        return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
    return "-" if value is None or value == "" else str(value)


def _name_and_unit(key: str) -> tuple[str, str]:
    name, _, unit = key.rpartition("_")
    units = {"share": "%", "hz": "Hz", "s": "s", "ms": "ms", "mm": "mm", "deg": "deg"}
    return (name.replace("_", " "), units[unit]) if name and unit in units else (key.replace("_", " "), "")


def _print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], right: bool) -> None:
    """Print a table, all columns but the first aligned to the right or none. Long cells are wrapped, not cut off."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(title=printable(title), title_justify="left", title_style="bold", box=SIMPLE_HEAD)
    for index, column in enumerate(columns):
        table.add_column(column, justify="right" if right and index else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(printable, row))
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = max(console.width, 240)  # there is no window to wrap for
    console.print(table)


def print_line(text: str) -> None:
    """Print a line for people."""
    print(printable(text))


def complain(error: Exception | str) -> None:
    """Print an error as one line on standard error."""
    print(f"palpate: {printable(' '.join(str(error).split()))}", file=sys.stderr)


@contextmanager
def progress_bar(title: str, total: int) -> Iterator[Callable[..., None]]:
    """Yield a function that shows the number done, and maybe a note: by a bar, or in a log a line each half minute."""
    console = _terminal()
    if console is None:
        yield _progress_lines(title, total)
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(title, total=total)
        yield lambda done, note="": progress.update(task, completed=done, description=f"{title} {note}".strip())


def busy(title: str) -> AbstractContextManager[Any]:
    """Show a spinner on standard error, if it is a terminal, while the block runs."""
    console = _terminal()
    return nullcontext() if console is None else console.status(title)


def _terminal() -> "Console | None":
    """Return the terminal of standard error, None for a file even with FORCE_COLOR: bars do not belong in a log."""
    from rich.console import Console

    console = Console(stderr=True, force_terminal=sys.stderr.isatty())
    return console if console.is_terminal and not console.is_dumb_terminal else None


def _progress_lines(title: str, total: int) -> Callable[..., None]:
    last = time.monotonic()

    def show(done: int, note: str = "") -> None:
        nonlocal last
        if time.monotonic() - last >= 30.0:
            last = time.monotonic()
            complain(f"{title}: {done} of {total}{f', {note}' if note else ''}")

    return show
