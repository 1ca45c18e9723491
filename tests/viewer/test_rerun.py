"""A live view that stalls or fails, and the process of Rerun's viewer, without a window."""

import json
import logging
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple, get_args

import numpy as np
import psutil
import pytest
from view_samples import FRAMES, imaged_push

from palpate.errors import SettingError
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.shapes import Rectangle
from palpate.tracker import Tracker
from palpate.types.estimate import Status
from palpate.types.sensor import SensorProfile
from palpate.viewer import colours, rerun_view
from palpate.viewer.rerun_view import LiveLog, live_view, open_stream
from palpate.viewer.scene import contact_points, touch_images

rerun = pytest.importorskip("rerun", reason="the extra view is not installed")


def test_every_status_has_a_colour():
    assert set(colours.STATUS) == set(get_args(Status))
    assert len(set(colours.STATUS.values())) == len(colours.STATUS)


def test_the_contact_point_is_the_nearest_of_the_outline():
    sensor = SensorProfile(name="two", radius=0.01, tips=((0.0, -0.02), (0.0, 0.02)))
    field = DistanceField.of(Rectangle(0.1, 0.06))
    # At the object's left side, turned a little so that the one tip is nearer, and then the other.
    sensor_pose = np.array([[-0.055, 0.0, -0.05], [-0.055, 0.0, 0.05]])
    points = contact_points(sensor_pose, np.zeros((2, 3)), sensor, field)
    np.testing.assert_allclose(points, [[-0.05, 0.02], [-0.05, -0.02]], atol=1e-3)


def test_the_difference_is_grey_where_nothing_touches():
    pairs = list(touch_images(imaged_push(), None))
    assert all(difference is None for _, difference in pairs[:14])  # the untouched gel is not known yet
    untouched, touched = pairs[16][1], pairs[30][1]
    assert untouched is not None and touched is not None and touched.shape == (40, 30, 3)
    assert np.abs(untouched.astype(int) - 128).max() < 12
    assert touched[20, 15].min() > 220 and np.abs(touched[3, 3].astype(int) - 128).max() < 12


def tracked_with(watch: Any) -> None:
    recording = imaged_push()
    tracker = Tracker(recording.shape, recording.sensor, (0.3, 0.05, 0.0))
    for frame in recording:
        watch(frame, tracker.update(frame), tracker.background)


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
