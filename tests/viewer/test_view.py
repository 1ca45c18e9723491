"""`palpate view` and what it writes for Rerun, read back from the files."""

import os
import shutil
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed
from view_samples import FIRST, FRAMES, LAST, imaged_push, without_display

import palpate

pytest.importorskip("rerun", reason="the extra view is not installed")


def read_back(path: Any) -> dict[str, dict[int, list[Any]]]:
    """Of each entity, the value of its first component by frame."""
    from rerun.chunk import RrdReader

    found: dict[str, dict[int, list[Any]]] = defaultdict(dict)
    for chunk in RrdReader(path).stream():
        if chunk.is_static or "time" not in chunk.timeline_names:
            continue
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if ":" in name and "indicator" not in name.lower()]
        times = batch.column("time").to_numpy(zero_copy_only=False).astype("timedelta64[ns]").astype(np.int64) * 1e-9
        for when, value in zip(times, batch.column(names[0]).to_pylist(), strict=True):
            found[str(chunk.entity_path)][round(float(when) * 30)] = value
    return found


@pytest.fixture(scope="module")
def run(tmp_path_factory, command) -> Path:
    """The folder of a run."""
    folder = tmp_path_factory.mktemp("view")
    palpate.write_recording(imaged_push(), folder / "push.mcap")
    run = folder / "run"
    assert command("track", folder / "push.mcap", "--out", run) == 0
    return run


@pytest.fixture(scope="module")
def saved(run, command) -> Path:
    path = run.parent / "push.rrd"
    assert command("view", run, "--save", path) == 0
    return path


@pytest.fixture(scope="module")
def entities(saved) -> Any:
    return read_back(saved)


@pytest.fixture(scope="module")
def online() -> Any:
    return palpate.track(imaged_push()).online


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    without_display(tmp_path, monkeypatch)


def test_all_frames_are_there(entities):
    for path in ("above/estimate", "above/sensor", "above/truth", "status"):
        assert sorted(entities[f"/{path}"]) == list(range(FRAMES))
    assert sorted(entities["/touch"]) == list(range(FRAMES))


def test_the_push_is_seen_from_above_in_millimetres_with_y_up(entities, online):
    x, y, _ = online.pose[25]
    (outline,) = entities["/above/estimate"][25]
    np.testing.assert_allclose(np.mean(np.array(outline)[:-1], axis=0), [1e3 * x, -1e3 * y], atol=0.01)
    (ellipse,) = entities["/above/ellipse"][25]
    yaw = online.pose[25, 2]
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    offsets = (np.array(ellipse) * (1.0, -1.0) - 1e3 * online.pose[25, :2]) @ turn
    weight = np.linalg.inv(1e6 * online.covariance[25, :2, :2])
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", offsets, weight, offsets), 5.991, rtol=1e-3)  # 95 %


def test_what_is_unknown_is_not_drawn(entities, online):
    assert [[len(strip) for strip in entities["/above/truth"][frame]] for frame in (2, 3)] == [[101], []]
    touching = [frame for frame in range(FRAMES) if entities["/above/contact"][frame]]
    assert touching == np.flatnonzero(online.contact).tolist() and FIRST <= touching[0] < LAST


def test_status_is_shown_over_time(entities, online):
    assert [entities["/status"][frame][0] for frame in range(FRAMES)] == list(online.status)


def test_a_bare_recording_is_shown_with_its_dates(run_palpate):
    bare = replace(pushed(), object_pose=None, contact=None)
    palpate.write_recording(replace(bare, time=bare.time + 1.7e9), "day.mcap")
    code, out, _ = run_palpate("view", "day.mcap")
    assert code == 0 and "day.rrd: open it with `rerun day.rrd`" in out
    from rerun.chunk import RrdReader

    chunks = [each for each in RrdReader("day.rrd").stream() if "time" in each.timeline_names]
    assert {str(each.entity_path) for each in chunks} == {"/above/sensor"}
    assert "timestamp" in str(chunks[0].to_record_batch().schema.field("time").type)


def test_what_cannot_be_viewed(run, fails):
    push = run.parent / "push.mcap"
    Path("there.rrd").write_text("mine")
    assert "there.rrd: already exists; --force" in fails("view", push, "--save", "there.rrd")
    assert "gone.mcap: no such file" in fails("view", "gone.mcap")
    assert "the folder nowhere does not exist" in fails("view", push, "--save", "nowhere/a.rrd")
    assert [path.name for path in Path().iterdir()] == ["there.rrd"] and Path("there.rrd").read_text() == "mine"


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("settings.json", None, "is no run of palpate track"),
        ("settings.json", "{}", "settings.json: recording is None, expected the name of a file"),
        ("settings.json", '{"recording": "gone.mcap"}', "gone.mcap: no such file"),
        ("estimates.csv", "LESS", "49 estimates are not of the 50 frames"),
    ],
)
def test_a_run_folder_that_cannot_be_shown(run, fails, file, text, message):
    shutil.copytree(run, "run")
    lines = Path("run", file).read_text().splitlines(keepends=True)
    Path("run", file).unlink()
    if text is not None:
        Path("run", file).write_text(text.replace("LESS", "".join(lines[:-1])))
    assert message in fails("view", "run")


def test_names_that_are_no_text(run, fails, run_palpate):
    name = os.fsdecode(b"r\xfcck")
    try:
        shutil.copy(run.parent / "push.mcap", f"{name}.mcap")
    except OSError:
        pytest.skip("this file system takes no such names")
    code, out, _ = run_palpate("view", f"{name}.mcap")
    assert code == 0 and r"r\udcfcck.rrd: open it with" in out and Path(r"r\udcfcck.rrd").exists()
    assert "Rerun writes only to names that are UTF-8" in fails("view", f"{name}.mcap", "--save", f"{name}.rrd")
