import json
import sys
from pathlib import Path
from typing import Any

import pytest
from view_samples import imaged_push, without_display

from palpate import io as formats
from palpate.cli import main
from palpate.viewer import rerun_view

pytest.importorskip("rerun", reason="the extra view is not installed")


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    """Every test works in a folder of its own that holds push.mcap, and has no display."""
    without_display(tmp_path, monkeypatch)
    formats.write(imaged_push(), "push.mcap")


def names() -> set[str]:
    return {path.name for path in Path().iterdir()}


def failure(capsys: Any, *words: str) -> str:
    """Return the one line with which a command fails; it leaves no file."""
    before = names()
    assert main.main(words) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert names() == before
    return err


def test_without_a_display_a_file_is_written(capsys):
    assert main.main(["track", "push.mcap", "--out", "run"]) == 0
    capsys.readouterr()
    assert main.main(["view", "run"]) == 0
    assert "run.rrd: open it with `rerun run.rrd`" in capsys.readouterr().out
    assert main.main(["view", "push.mcap", "--save", "seen.rrd"]) == 0
    assert {"run.rrd", "seen.rrd"} < names()
    assert all(Path(name).read_bytes().startswith(b"RRF2") for name in ("run.rrd", "seen.rrd"))


def test_with_a_display_a_viewer_is_opened(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":7")
    shown = []
    monkeypatch.setattr(rerun_view, "show_scene", lambda scene: shown.append(scene.name))
    assert main.main(["view", "push.mcap"]) == 0
    assert shown == ["push.mcap"]


def test_tracking_is_saved_for_rerun(capsys):
    assert main.main(["track", "push.mcap", "--save-rrd", "live.rrd", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 50
    assert Path("live.rrd").read_bytes().startswith(b"RRF2")


def test_what_cannot_be_viewed(capsys):
    Path("there.rrd").write_text("mine")
    assert "there.rrd: already exists; --force" in failure(capsys, "view", "push.mcap", "--save", "there.rrd")
    assert "there.rrd: already exists; --force" in failure(capsys, "track", "push.mcap", "--save-rrd", "there.rrd")
    assert "gone.mcap: no such file" in failure(capsys, "view", "gone.mcap")
    assert "the folder nowhere does not exist" in failure(capsys, "view", "push.mcap", "--save", "nowhere/a.rrd")
    assert "no display to open a window on; --save-rrd" in failure(capsys, "track", "push.mcap", "--view")
    words = failure(capsys, "track", "push.mcap", "push.mcap", "--save-rrd", "a.rrd")
    assert "show one recording, and 2 are given" in words


def test_without_rerun_a_sentence_says_what_to_install(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    for words in (("view", "push.mcap"), ("track", "push.mcap", "--save-rrd", "a.rrd")):
        assert "pip install palpate[view]" in failure(capsys, *words)
    assert rerun_view.has_display() is False
