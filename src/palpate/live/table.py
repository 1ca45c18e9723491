"""A table in the terminal that shows how a live session goes."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.live import Live
from rich.table import Table

from palpate.live.session import LiveState
from palpate.pipeline.metrics import pose_words, world_sigma


@contextmanager
def live_table(title: str, state: LiveState) -> Iterator[None]:
    """Show the table on standard error while the block runs; nothing is shown where that is no terminal."""
    console = Console(stderr=True, force_terminal=sys.stderr.isatty())  # FORCE_COLOR would ask for a table in a file
    if not console.is_terminal:
        yield
        return
    with Live(get_renderable=lambda: table_of(title, state), console=console, refresh_per_second=5, transient=True):
        yield


def table_of(title: str, state: LiveState) -> Table:
    """Return the table of a session as it stands."""
    table = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, show_header=False)
    table.add_column(style="dim")
    table.add_column(min_width=60, overflow="fold")
    for row in _rows(state):
        table.add_row(*row)
    return table


def _rows(state: LiveState) -> list[tuple[str, str]]:
    last, rate, latency = state.last, state.rate, state.latency_ms(600)
    counts = f"{state.tracked} tracked, {state.dropped} dropped, {state.without_pose} without a pose"
    age = "none yet" if state.pose_age is None else f"the last {1e3 * max(state.pose_age, 0.0):.0f} ms ago"
    rows = [("images", f"{'-' if rate is None else f'{rate:.1f}'} Hz; {counts}")]
    if last is None:
        rows += [(name, "-") for name in ("latency", "contact", "status", "object")]
    else:
        one = last.estimate
        rows += [
            ("latency", f"{latency['p50']:.1f} ms, 99 %: {latency['p99']:.1f} ms"),
            ("contact", "yes" if one.contact else "no"),
            ("status", f"{one.status}{one.reason and f': {one.reason}'}"),
            ("object", pose_words(one.pose, world_sigma(one.pose, one.covariance))),
        ]
    rows.append(("sensor pose", f"{age}, {last.place.how if last else '-'}; {state.refused} refused"))
    return [*rows, ("", "\n".join(state.notes))]
