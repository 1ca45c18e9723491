"""What commands print: tables or one JSON object on standard output, all else on standard error."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.status import Status
from rich.table import Table


def print_json(data: dict[str, Any]) -> None:
    """Print the one JSON object of a command."""
    print(json.dumps(data, indent=2, allow_nan=False))


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> None:
    """Print a table.

    The columns of `numbers` are set to the right. Nothing is cut off: what is long is wrapped.
    """
    table = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD)
    for index, column in enumerate(columns):
        right = index in numbers
        table.add_column(column, justify="right" if right else "left", overflow="fold", no_wrap=right)
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = max(console.width, 160)  # nobody's window to wrap for
    console.print(table)


def print_line(text: str) -> None:
    """Print a line for people."""
    print(text)


def complain(error: Exception | str) -> None:
    """Print an error as one line on standard error."""
    print(f"palpate: {' '.join(str(error).split())}", file=sys.stderr)


@contextmanager
def progress_bar(title: str, total: int) -> Iterator[Callable[..., None]]:
    """A bar on standard error, where that is a terminal; call what it yields with the number done, and maybe a note."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(title, total=total)
        yield lambda done, note="": progress.update(task, completed=done, description=f"{title} {note}".strip())


def busy(title: str) -> Status:
    """A spinner on standard error, where that is a terminal, while its block runs."""
    return Console(stderr=True).status(title)


def number(value: float | None, digits: int = 1) -> str:
    """A number for a table, or a dash."""
    return "-" if value is None else f"{value:.{digits}f}"


def percent(share: float | None) -> str:
    """A share for a table in %, or a dash."""
    return "-" if share is None else f"{100.0 * share:.0f}"
