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
    rate, counts = state.rate, state.counts
    seen = f"{counts['tracked']} tracked, {counts['dropped']} dropped, {counts['without_pose']} without a pose"
    rows = {"images": f"{'-' if rate is None else f'{rate:.1f}'} Hz; {seen}"}
    rows |= dict.fromkeys(("latency", "contact", "status", "object"), "-")
    rows["sensor poses"] = f"{counts['refused_poses']} refused"
    if state.last:
        one, recent = state.last.estimate, state.latency_ms(600)
        rows["latency"] = f"{recent['p50']:.1f} ms, 99 %: {recent['p99']:.1f} ms"
        rows["contact"] = "yes" if one.contact else "no"
        rows["status"] = f"{one.status}{one.reason and f': {one.reason}'}"
        rows["object"] = pose_words(one.pose, world_sigma(one.pose, one.covariance))
    for name, words in rows.items():
        table.add_row(name, words)
    return table
