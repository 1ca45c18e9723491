"""Output of commands: tables or one JSON object on standard output, progress and errors on standard error."""

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from palpate.errors import printable

LINE_EVERY = 30.0
"""Time between lines of progress in a log [s]."""


def print_json(data: dict[str, Any]) -> None:
    """Print the one JSON object of a command."""
    print(json.dumps(data, indent=2, allow_nan=False))


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> None:
    """Print a table, with the columns of `numbers` aligned to the right. Long cells are wrapped, not cut off."""
    table = Table(title=printable(title), title_justify="left", title_style="bold", box=SIMPLE_HEAD)
    for index, column in enumerate(columns):
        right = index in numbers
        table.add_column(column, justify="right" if right else "left", overflow="fold", no_wrap=right)
    for row in rows:
        table.add_row(*(printable(cell) for cell in row))
    console = Console(highlight=False, markup=False)
    if not console.is_terminal:
        console.width = max(console.width, 160)  # there is no window to wrap for
    console.print(table)


def print_quantities(title: str, rows: Iterable[tuple[str, str, str]]) -> None:
    """Print a table of quantities with their values and units."""
    print_table(title, ("quantity", "value", "unit"), rows, numbers=(1,))


def print_line(text: str) -> None:
    """Print a line for people."""
    print(printable(text))


def complain(error: Exception | str) -> None:
    """Print an error as one line on standard error."""
    print(f"palpate: {printable(' '.join(str(error).split()))}", file=sys.stderr)


@contextmanager
def progress_bar(title: str, total: int) -> Iterator[Callable[..., None]]:
    """Yield a function that shows the number done, and maybe a note.

    It draws a bar, or prints a line every LINE_EVERY seconds if standard error is no terminal.
    """
    console = _terminal()
    if console is None:
        yield _progress_lines(title, total)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(title, total=total)
        yield lambda done, note="": progress.update(task, completed=done, description=f"{title} {note}".strip())


def busy(title: str) -> AbstractContextManager[Any]:
    """Show a spinner on standard error, if it is a terminal, while the block runs."""
    console = _terminal()
    return nullcontext() if console is None else console.status(title)


def number(value: float | None, digits: int = 1) -> str:
    """Return a number for a table, or a dash."""
    return "-" if value is None else f"{value:.{digits}f}"


def percent(share: float | None) -> str:
    """Return a share in % for a table, or a dash."""
    return "-" if share is None else f"{100.0 * share:.0f}"


def _terminal() -> Console | None:
    """Return the terminal of standard error, None for a file even with FORCE_COLOR: bars do not belong in a log."""
    console = Console(stderr=True, force_terminal=sys.stderr.isatty())
    return console if console.is_terminal and not console.is_dumb_terminal else None


def _progress_lines(title: str, total: int) -> Callable[..., None]:
    last = time.monotonic()

    def show(done: int, note: str = "") -> None:
        nonlocal last
        if time.monotonic() - last >= LINE_EVERY:
            last = time.monotonic()
            complain(f"{title}: {done} of {total}{f', {note}' if note else ''}")

    return show
