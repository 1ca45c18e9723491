"""A calm table in the terminal: the same rows all the time, some times a second."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.live import Live
from rich.table import Table

from palpate.live.state import LiveState
from palpate.pipeline.poses import pose_words, world_sigma

_REFRESH = 5  # times a second
_RECENT = 600  # estimates whose latency is shown


class LiveTable:
    """The table of a session, on standard error; where that is no terminal, there is none."""

    def __init__(self, title: str) -> None:
        """Take what to write above it."""
        self._title = title
        self._console = Console(stderr=True, force_terminal=sys.stderr.isatty())  # whatever FORCE_COLOR says

    @property
    def shown(self) -> bool:
        """Whether there is a terminal."""
        return self._console.is_terminal

    @contextmanager
    def of(self, state: LiveState) -> Iterator[None]:
        """Show how a session goes while the block runs."""
        if not self.shown:
            yield
            return
        table = Live(
            get_renderable=lambda: table_of(self._title, state),
            console=self._console,
            refresh_per_second=_REFRESH,
            transient=True,
        )
        with table:
            yield


def table_of(title: str, state: LiveState) -> Table:
    """How a session goes now."""
    table = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, show_header=False)
    table.add_column(style="dim")
    table.add_column(min_width=60, overflow="fold")
    for name, text in _rows(state):
        table.add_row(name, text)
    return table


def _rows(state: LiveState) -> list[tuple[str, str]]:
    last = state.last  # first, for what is told with it is there by then
    rate, latency = state.rate, state.latency_ms(_RECENT)
    counts = f"{state.tracked} tracked, {state.dropped} dropped, {state.unplaced} without a pose"
    rows = [("images", f"{'-' if rate is None else f'{rate:.1f}'} Hz; {counts}")]
    waiting = [("latency", "-"), ("contact", "-"), ("status", "-"), ("object", "-")]
    if last is None:
        rows += waiting
    else:
        estimate = last.estimate
        sigma = world_sigma(estimate.pose, estimate.covariance)
        rows += [
            ("latency", f"{latency['p50']:.1f} ms, 99 %: {latency['p99']:.1f} ms"),
            ("contact", "yes" if estimate.contact else "no"),
            ("status", f"{estimate.status}{f': {estimate.reason}' if estimate.reason else ''}"),
            ("object", pose_words(estimate.pose, sigma)),
        ]
    how = last.place.how if last else "-"
    age = "none yet" if state.pose_age is None else f"the last {1e3 * max(state.pose_age, 0.0):.0f} ms ago"
    rows.append(("sensor pose", f"{age}, {how}; {state.refused} refused"))
    if state.true_poses is not None:
        rows.append(("truth", _truth(state)))
    return [*rows, ("", "\n".join(state.notes))]


def _truth(state: LiveState) -> str:
    if state.truth_age is None:
        return "not known yet"
    seen = f"seen {1e3 * max(state.truth_age, 0.0):.0f} ms ago"
    if state.error is None:
        return f"{seen}, not compared yet"
    mm, deg = state.error
    return f"the estimate is {mm:.1f} mm, {deg:.1f}° off; {seen}"
