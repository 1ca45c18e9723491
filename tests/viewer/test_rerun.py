"""What is sent to Rerun, read back from files; and its viewer's process, without a window."""

import json
import logging
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import psutil
import pytest
from recording_samples import pushed
from view_samples import FIRST, FRAMES, LAST, imaged_push, scene_of, tracked_push

from palpate.errors import FileError, SettingError
from palpate.filter.consistency import Status
from palpate.geometry import se2
from palpate.geometry.lines import ellipses_95
from palpate.pipeline.track import track
from palpate.tracker import Tracker
from palpate.viewer import colours, rerun_view
from palpate.viewer.rerun_view import LiveLog, live_view, open_stream, save_scene
from palpate.viewer.scene import Scene

rerun = pytest.importorskip("rerun", reason="the extra view is not installed")


def read_back(path: Any) -> dict[str, dict[float, list[Any]]]:
    """Of each entity, what there is at each time [s] in its first component."""
    from rerun.chunk import RrdReader

    found: dict[str, dict[float, list[Any]]] = defaultdict(dict)
    for chunk in RrdReader(path).stream():
        if chunk.is_static or "time" not in chunk.timeline_names:
            continue
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if ":" in name and "indicator" not in name.lower()]
        times = batch.column("time").to_numpy(zero_copy_only=False).astype("timedelta64[ns]").astype(np.int64) * 1e-9
        for when, value in zip(times, batch.column(names[0]).to_pylist(), strict=True):
            found[str(chunk.entity_path)][round(float(when), 6)] = value
    return found


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Any:
    path = tmp_path_factory.mktemp("saved") / "push.rrd"
    save_scene(scene_of(tracked_push(), "push"), path)
    return path


@pytest.fixture(scope="module")
def entities(saved):
    return read_back(saved)


def at(values: dict[float, list[Any]], frame: int) -> Any:
    return values[round(frame / 30.0, 6)]


def test_all_frames_are_there(entities):
    for path in ("above/estimate/outline", "above/sensor/pad", "above/truth/outline", "status", "friction/learnt"):
        assert len(entities[f"/{path}"]) == FRAMES
    assert len(entities["/touch/image"]) == FRAMES
    assert len(entities["/touch/seen"]) == FRAMES - 14  # the untouched gel is known from the fifteenth on


def test_the_push_is_seen_from_above_in_millimetres_with_y_up(entities):
    run = tracked_push()
    x, y, _ = run.online.pose[25]
    (outline,) = at(entities["/above/estimate/outline"], 25)
    np.testing.assert_allclose(np.mean(np.array(outline)[:-1], axis=0), [1e3 * x, -1e3 * y], atol=0.01)
    np.testing.assert_allclose(at(entities["/above/estimate/path"], 25), [[1e3 * x, -1e3 * y]], atol=1e-3)
    covariance = run.online.covariance
    assert covariance is not None
    (ellipse,) = at(entities["/above/estimate/ellipse"], 25)
    expected = ellipses_95(run.online.pose[25:26], covariance[25:26])[0] * (1e3, -1e3)
    np.testing.assert_allclose(ellipse, expected, atol=1e-3)


def test_truth_that_is_not_known_is_not_drawn(entities):
    assert [len(strip) for strip in at(entities["/above/truth/outline"], 3)] == [0]
    assert [len(strip) for strip in at(entities["/above/truth/outline"], 2)] == [101]
    assert at(entities["/above/truth/path"], 4) == []


def test_contact_is_drawn_while_there_is_some(entities):
    shown = [frame for frame in range(FRAMES) if at(entities["/above/contact"], frame)]
    contact = tracked_push().online.contact
    assert contact is not None
    assert shown == np.flatnonzero(contact).tolist() and FIRST <= shown[0] < LAST
    ((x, y),) = at(entities["/above/contact"], 30)
    pose = tracked_push().online.pose[30]
    np.testing.assert_allclose(se2.transform(se2.inverse(pose), [x / 1e3, -y / 1e3]), [-0.05, 0.0], atol=1e-3)


def test_other_answers_are_drawn_where_there_are_several(entities):
    others = entities["/above/others"]
    assert [frame for frame in range(FRAMES) if any(len(strip) for strip in at(others, frame))] == [30]
    (outline,) = at(others, 30)
    x, y, _ = tracked_push().answers[30][1].pose
    np.testing.assert_allclose(np.mean(np.array(outline)[:-1], axis=0), [1e3 * x, -1e3 * y], atol=0.01)


def test_plots_tell_what_the_run_says(entities):
    run = tracked_push()
    assert run.truth is not None
    off = np.hypot(*(run.online.pose - run.truth)[45, :2]) * 1e3
    np.testing.assert_allclose(at(entities["/translation/error"], 45), [off])
    np.testing.assert_allclose(at(entities["/friction/learnt"], 45), [run.friction[45, 0]])
    np.testing.assert_allclose(at(entities["/friction/more"], 45), [run.friction[45].sum()])
    status = run.online.status
    assert status is not None
    assert [at(entities["/status"], frame)[0] for frame in range(FRAMES)] == list(status)


def test_images_are_those_of_the_recording(entities):
    images = imaged_push().image
    assert images is not None and bytes(at(entities["/touch/image"], 30)[0]) == images[30]


def test_a_layout_of_ours_comes_along(saved):
    from rerun.chunk import RrdReader

    assert len(RrdReader(saved).blueprints()) == 1
    assert [entry.application_id for entry in RrdReader(saved).recordings()] == ["palpate"]


def test_a_recording_without_images_truth_or_contact_is_saved(tmp_path):
    recording = replace(pushed(), object_pose=None, contact=None)
    save_scene(Scene("bare", recording, None), tmp_path / "bare.rrd")
    found = read_back(tmp_path / "bare.rrd")
    assert set(found) == {"/above/sensor/pad", "/above/sensor/path"}


def test_times_that_are_dates_are_shown_as_dates(tmp_path):
    recording = pushed()
    save_scene(Scene("day", replace(recording, time=recording.time + 1.7e9), None), tmp_path / "day.rrd")
    from rerun.chunk import RrdReader

    chunk = next(each for each in RrdReader(tmp_path / "day.rrd").stream() if "time" in each.timeline_names)
    assert "timestamp" in str(chunk.to_record_batch().schema.field("time").type)


def test_a_file_is_replaced_only_if_asked_for(saved):
    before = saved.read_bytes()
    with pytest.raises(FileError, match="already exists"):
        save_scene(scene_of(tracked_push(), "push"), saved)
    assert saved.read_bytes() == before
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


def test_every_status_has_a_colour():
    from typing import get_args

    assert set(colours.STATUS) == set(get_args(Status))
    assert len(set(colours.STATUS.values())) == len(colours.STATUS)


def tracked_with(watch: Any) -> None:
    track(imaged_push(), watch=watch)


def test_tracking_is_shown_ten_times_a_second(monkeypatch, tmp_path):
    monkeypatch.setattr(rerun_view, "WAITING", 1000)  # none is dropped on a slow machine
    recording = imaged_push()
    with live_view(recording, "push", tmp_path / "live.rrd", force=False, window=False) as log:
        tracked_with(log.show)
    assert log.dropped == 0
    found = read_back(tmp_path / "live.rrd")
    times = sorted(found["/above/estimate/outline"])
    assert len(times) == 17 and min(np.diff(times)) > 0.099
    assert sorted(found["/touch/image"]) == times
    assert len(found["/touch/seen"]) == sum(when > 14 / 30.0 - 1e-3 for when in times)
    run = tracked_push()
    for when in times:
        x, y, _ = run.online.pose[round(when * 30)]
        np.testing.assert_allclose(found["/above/estimate/path"][when], [[1e3 * x, -1e3 * y]], atol=1e-3)


def test_a_view_that_stalls_never_holds_up_tracking(caplog, monkeypatch):
    monkeypatch.setattr(rerun_view, "INTERVAL", 0.0)
    stream = open_stream("stalled")
    stream.memory_recording()
    recording, released = imaged_push(), threading.Event()
    log = LiveLog(stream, recording.shape, recording.sensor)
    monkeypatch.setattr(log, "_send", lambda _: released.wait(20.0))
    tracker = Tracker(recording.shape, recording.sensor, (0.3, 0.05, 0.0))
    slowest = 0.0
    for frame in recording:
        estimate = tracker.update(frame)
        begin = time.perf_counter()
        log.show(frame, estimate, tracker.background)
        slowest = max(slowest, time.perf_counter() - begin)
    assert slowest < 0.05
    assert FRAMES - 20 <= log.dropped < FRAMES - 10  # ten wait, and up to ten were taken before
    dropped = log.dropped
    released.set()
    with caplog.at_level(logging.WARNING):
        log.close()
    assert log.dropped == dropped
    assert f"too slow for {dropped} frames" in caplog.text


def test_a_view_that_fails_ends_and_tracking_goes_on(caplog, tmp_path, monkeypatch):
    def fail(*_: object) -> None:
        raise RuntimeError("no space left")

    monkeypatch.setattr(rerun_view.SceneLog, "send", fail)
    with live_view(imaged_push(), "push", tmp_path / "live.rrd", force=False, window=False) as log:
        tracked_with(log.show)
    assert log.dropped >= 13
    assert caplog.text.count("the view ends at 0.000 s: no space left") == 1


def test_tracking_that_fails_leaves_no_file(tmp_path):
    with (
        pytest.raises(ZeroDivisionError),
        live_view(imaged_push(), "push", tmp_path / "live.rrd", force=False, window=False),
    ):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


class Served(NamedTuple):
    """A viewer that needs no display."""

    address: str
    """Where it listens."""
    processes: list[psutil.Process]
    """What runs since, the viewer last."""

    def end(self) -> None:
        for process in self.processes:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        psutil.wait_procs(self.processes)


@pytest.fixture
def served(monkeypatch, tmp_path) -> Iterator[Served]:
    """A viewer without a window, of a user whose home is tmp_path."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    before = set(psutil.Process().children(recursive=True))
    address = rerun_view.start_viewer("--serve-grpc")
    found = Served(address, [each for each in psutil.Process().children(recursive=True) if each not in before])
    monkeypatch.setattr(rerun_view, "start_viewer", lambda: address)
    yield found
    found.end()


@pytest.mark.filterwarnings("ignore:subprocess .* is still running:ResourceWarning")  # it is meant to go on
def test_the_viewer_listens_on_loopback_only_and_reports_to_nobody(served, monkeypatch, tmp_path):
    port = int(served.address.removeprefix("rerun+http://127.0.0.1:").removesuffix("/proxy"))
    listening = [
        connection.laddr
        for process in served.processes
        for connection in process.net_connections("inet")
        if connection.status == psutil.CONN_LISTEN
    ]
    assert listening == [("127.0.0.1", port)]
    words = " ".join(served.processes[-1].cmdline())
    assert "--memory-limit 1GiB" in words and "--server-memory-limit 256MiB" in words
    assert all(
        each.environ()["XDG_CONFIG_HOME"] == str(tmp_path / "cache" / "palpate" / "rerun") for each in served.processes
    )
    monkeypatch.setattr(rerun_view, "WAITING", 1000)
    with live_view(imaged_push(), "push", None, force=False, window=True) as log:
        tracked_with(log.show)
    assert log.dropped == 0
    settings = json.loads((tmp_path / "cache" / "palpate" / "rerun" / "rerun" / "analytics.json").read_text())
    assert settings["analytics_enabled"] is False
    assert not (tmp_path / ".config").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is a window to open")
@pytest.mark.parametrize("mode", [("--no-such-option",), ()])  # without one it finds no window to open
def test_a_viewer_that_does_not_start_is_told(mode, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":no-such-display")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(SettingError, match="the viewer does not start"):
        rerun_view.start_viewer(*mode)


@pytest.mark.filterwarnings("ignore:subprocess .* is still running:ResourceWarning")  # it is meant to go on
def test_a_viewer_that_is_closed_meanwhile_ends_the_view_only(served, caplog):
    begin = time.monotonic()
    with live_view(imaged_push(), "push", None, force=False, window=True) as log:
        served.end()
        tracked_with(log.show)
    assert time.monotonic() - begin < 15.0
    assert "the view is not whole" in caplog.text
