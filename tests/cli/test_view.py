"""`palpate view`, and `palpate track --view` and `--save-rrd`, on a machine without a display."""

import sys
from pathlib import Path

import pytest
from view_samples import imaged_push, without_display

import palpate

pytest.importorskip("rerun", reason="the extra view is not installed")


@pytest.fixture(autouse=True)
def _in_folder(folder, monkeypatch):
    without_display(folder, monkeypatch)
    palpate.write_recording(imaged_push(), "push.mcap", overwrite=True)


def test_without_a_display_a_file_is_written(succeeds, json_of):
    assert json_of("track", "push.mcap", "--out", "run", "--save-rrd", "live.rrd")["frames"] == 50
    assert "run.rrd: open it with `rerun run.rrd`" in succeeds("view", "run")
    succeeds("view", "push.mcap", "--save", "seen.rrd")
    assert all(Path(name).read_bytes().startswith(b"RRF2") for name in ("live.rrd", "run.rrd", "seen.rrd"))


def test_with_a_display_a_viewer_is_opened(succeeds, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":7")
    shown = []
    monkeypatch.setattr("palpate.viewer.rerun_view.show_scene", lambda scene: shown.append(scene.name))
    succeeds("view", "push.mcap")
    assert shown == ["push.mcap"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("view", "push.mcap", "--save", "there.rrd"), "there.rrd: already exists; --force"),
        (("track", "push.mcap", "--save-rrd", "there.rrd"), "there.rrd: already exists; --force"),
        (("view", "gone.mcap"), "gone.mcap: no such file"),
        (("view", "push.mcap", "--save", "nowhere/a.rrd"), "the folder nowhere does not exist"),
        (("track", "push.mcap", "--view"), "no display to open a window on; --save-rrd"),
        (("track", "push.mcap", "push.mcap", "--save-rrd", "a.rrd"), "show one recording, and 2 are given"),
    ],
)
def test_bad_input_is_one_line(fails, words, message):
    Path("there.rrd").write_text("mine")
    before = sorted(Path().iterdir())
    assert message in fails(*words)
    assert sorted(Path().iterdir()) == before


def test_without_rerun_a_sentence_names_the_extra(fails, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    for words in (("view", "push.mcap"), ("track", "push.mcap", "--save-rrd", "a.rrd")):
        assert "pip install palpate[view]" in fails(*words)
