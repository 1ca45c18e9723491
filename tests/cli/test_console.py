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


def test_a_line_comes_every_half_minute(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    with console.progress_bar("touch", 5) as show:
        for done, now[0] in enumerate((110.0, 130.0, 140.0, 159.0, 160.0), 1):
            show(done)
    assert capsys.readouterr().err == "palpate: touch: 2 of 5\npalpate: touch: 5 of 5\n"


@pytest.mark.parametrize(("term", "bars"), [("xterm", True), ("dumb", False)])
def test_a_terminal_gets_bars_if_it_can_draw_them(monkeypatch, term, bars):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("TERM", term)
    with console.busy("reading"), console.progress_bar("touch", 3) as show:
        show(1)
        show(2, "loss 0.5")
    assert ("touch" in terminal.getvalue() and "\r" in terminal.getvalue()) == bars
