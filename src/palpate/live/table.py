"""A table in the terminal that shows the state of a live session."""

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
    last, rate, counts = state.last, state.rate, state.counts
    seen = f"{counts['tracked']} tracked, {counts['dropped']} dropped, {counts['without_pose']} without a pose"
    table.add_row("images", f"{'-' if rate is None else f'{rate:.1f}'} Hz; {seen}")
    latency = contact = status = pose = age = "-"
    if last:
        one, recent = last.estimate, state.latency_ms(600)
        latency = f"{recent['p50']:.1f} ms, 99 %: {recent['p99']:.1f} ms"
        contact = "yes" if one.contact else "no"
        status = f"{one.status}{one.reason and f': {one.reason}'}"
        pose = pose_words(one.pose, world_sigma(one.pose, one.covariance))
        age = f"{1e3 * last.place.age:.0f} ms before the image"
    for name, words in (("latency", latency), ("contact", contact), ("status", status), ("object", pose)):
        table.add_row(name, words)
    table.add_row("sensor pose", f"{age}; {counts['refused_poses']} refused")
    return table
