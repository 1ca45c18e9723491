"""The process of Rerun's viewer, without a window, and a session that is shown in it."""

import json
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import psutil
import pytest
from view_samples import imaged_push

from palpate import SettingError, Tracker
from palpate.live.session import LiveEstimate
from palpate.types.estimate import Status
from palpate.viewer.scene import STATUS_COLOURS, touch_images

pytest.importorskip("rerun", reason="the extra view is not installed")
from palpate.viewer import rerun_view


def test_every_status_has_a_colour():
    assert set(STATUS_COLOURS) == set(get_args(Status))
    assert len(set(STATUS_COLOURS.values())) == len(STATUS_COLOURS)


def test_the_difference_is_grey_where_nothing_touches():
    pairs = list(touch_images(imaged_push(), None))
    assert all(difference is None for _, difference in pairs[:14])  # the untouched gel is not known yet
    untouched, touched = pairs[16][1], pairs[30][1]
    assert untouched is not None and touched is not None and touched.shape == (40, 30, 3)
    assert np.abs(untouched.astype(int) - 128).max() < 12
    assert touched[20, 15].min() > 220 and np.abs(touched[3, 3].astype(int) - 128).max() < 12


def tracked_with(listen: Any) -> float:
    """Track the push and return the longest time that `listen` takes [s]."""
    recording, longest = imaged_push(), 0.0
    tracker = Tracker(recording.shape, recording.sensor, (0.3, 0.05, 0.0))
    for frame in recording:
        estimate, begin = tracker.update(frame), time.perf_counter()
        listen(LiveEstimate(estimate, tracker.frame, tracker.background, 0.0, 0.0))
        longest = max(longest, time.perf_counter() - begin)
    return longest


class Served(NamedTuple):
    """A viewer that needs no display."""

    address: str
    processes: list[psutil.Process]
    """All that runs since, the viewer last."""

    def end(self) -> None:
        for process in self.processes:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        psutil.wait_procs(self.processes)


@pytest.fixture
def served(monkeypatch, tmp_path) -> Iterator[Served]:
    """A viewer without a window, of a user who has no home."""
    monkeypatch.setenv("HOME", "/nowhere")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    before = set(psutil.Process().children(recursive=True))
    (tmp_path / "rerun_cli.py").write_text("raise SystemExit(7)")
    monkeypatch.chdir(tmp_path)  # where a stranger's module lies, which is not run
    address = rerun_view.start_viewer("--serve-grpc")
    found = Served(address, [each for each in psutil.Process().children(recursive=True) if each not in before])
    monkeypatch.setattr(rerun_view, "start_viewer", lambda: address)
    yield found
    found.end()


@pytest.mark.filterwarnings("ignore:subprocess .* is still running:ResourceWarning")  # it is meant to go on
def test_the_viewer_listens_on_loopback_only_and_reports_to_nobody(served, tmp_path, caplog):
    port = int(served.address.removeprefix("rerun+http://127.0.0.1:").removesuffix("/proxy"))
    listening = [
        connection.laddr
        for process in served.processes
        for connection in process.net_connections("inet")
        if connection.status == psutil.CONN_LISTEN
    ]
    assert listening == [("127.0.0.1", port)]
    (home,) = {each.environ()["XDG_CONFIG_HOME"] for each in served.processes}
    with rerun_view.live_view(imaged_push(), "push") as watch:
        tracked_with(watch)
    assert caplog.text == ""
    settings = json.loads((Path(home) / "rerun" / "analytics.json").read_text())
    assert settings["analytics_enabled"] is False


@pytest.mark.filterwarnings("ignore:subprocess .* is still running:ResourceWarning")
def test_a_viewer_that_stalls_or_is_closed_never_holds_up_tracking(served, caplog):
    with rerun_view.live_view(imaged_push(), "push") as watch:
        for process in served.processes:
            process.suspend()
        assert tracked_with(watch) < 0.2
        served.end()
        assert tracked_with(watch) < 0.2
    assert "the view is not whole" in caplog.text


def test_a_viewer_that_does_not_start_is_reported():
    with pytest.raises(SettingError, match="the viewer does not start"):
        rerun_view.start_viewer("--no-such-option")
