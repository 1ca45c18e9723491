import io

import pytest

from palpate.cli import console


class Terminal(io.StringIO):
    """Standard error that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def _colourful(monkeypatch):
    """FORCE_COLOR, as build servers set it: it is no reason to write bars into a log."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")


@pytest.mark.parametrize(("term", "bars"), [("xterm", True), ("dumb", False)])
def test_a_terminal_gets_bars_if_it_can_draw_them(monkeypatch, term, bars):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", term)
    with console.progress_bar("reading"), console.progress_bar("touch", 3) as show:
        show(1)
        show(2, "loss 0.5")
    assert ("touch" in terminal.getvalue() and "\r" in terminal.getvalue()) == bars
