import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_samples import push_messages, write_bag
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from view_samples import FRAMES, imaged_push, without_display

from palpate import io as formats
from palpate.cli import main
from palpate.live import setup
from palpate.live.poses import SensorPlace
from palpate.live.session import LiveEstimate, LiveState
from palpate.live.table import table_of
from palpate.tracker_arguments import ANYWHERE, ANYWHERE_SIGMA
from palpate.types.estimate import Estimate


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    """Every test works in a folder of its own that holds push.mcap at 60 Hz, and has no display."""
    without_display(tmp_path, monkeypatch)
    push = imaged_push()
    formats.write(replace(push, time=np.arange(FRAMES) / 60.0), "push.mcap")


def palpate(*words: str) -> int:
    return main.main(["live", "--tactile", "none", *words])


def failure(capsys: Any, *words: str) -> str:
    """Return the one line with which a command fails; it leaves no file."""
    before = sorted(Path().iterdir())
    assert palpate(*words) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert sorted(Path().iterdir()) == before
    return err


def same_frames(name: str, count: int | None = None) -> None:
    """What was recorded is the push: all of it, or its beginning."""
    push: Any = formats.load_recording("push.mcap")
    found: Any = formats.load_recording(name)
    assert len(found) == (count or len(found))
    assert found.image == push.image[: len(found)]
    assert np.allclose(found.time, push.time[: len(found)], rtol=0.0, atol=1e-9)
    assert np.allclose(found.sensor_pose, push.sensor_pose[: len(found)], rtol=0.0, atol=1e-12)
    assert (found.shape, found.sensor) == (push.shape, push.sensor)


def test_a_replay_is_tracked_in_real_time_and_recorded(capsys):
    begin = time.monotonic()
    assert palpate("--replay", "push.mcap", "--record", "live.mcap", "--json") == 0
    assert time.monotonic() - begin > (FRAMES - 1) / 60
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert err == "" or "stalled" in err  # by a machine that is very busy
    assert (found["images"], found["sensor_poses"], found["refused_poses"]) == (FRAMES, FRAMES, 0)
    assert found["tracked"] + found["dropped"] + found["without_pose"] == FRAMES
    assert found["tracked"] > FRAMES // 2 and found["contact_frames"] > 5
    assert found["rate_hz"] == pytest.approx(60.0)
    assert 0.0 < found["latency_ms"]["p50"] <= found["latency_ms"]["p99"] <= found["latency_ms"]["max"]
    same_frames("live.mcap", FRAMES)
    with Path("live.mcap").open("rb") as file:
        messages = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert messages.count("/palpate/object_pose") == found["tracked"]
    with AnyReader([Path("live.mcap")]) as bag:  # none of our code
        assert [connection.topic for connection, _, _ in bag.messages()].count("/sensor/pose") == FRAMES
    assert main.main(["track", "live.mcap", "--first-pose", "0.3", "0.05", "0"]) == 0
    assert main.main(["info", "live.mcap"]) == 0
    assert "rectangle" in capsys.readouterr().out


def test_a_bag_is_replayed(capsys):
    write_bag(Path("bag.mcap"), "mcap", push_messages())
    options = ("--shape", "disc", "--first-pose", "0.3", "0", "0", "--first-pose-sigma", "0.01", "0.01", "0.1")
    assert palpate("--replay", "bag.mcap", *options, "--seconds", "0.4") == 0
    out, _ = capsys.readouterr()
    assert "latency, 99 %" in out and "tracked" in out
    assert "--first-pose X Y THETA" in failure(capsys, "--replay", "bag.mcap", "--shape", "disc")
    assert "take it by --shape" in failure(capsys, "--replay", "bag.mcap")


def test_nothing_is_known_of_where_the_object_is(capsys, monkeypatch):
    real, given = setup.replay_set_up, []
    monkeypatch.setattr(setup, "replay_set_up", lambda *said: given.append(said[2:]) or real(*said))
    write_bag(Path("bag.mcap"), "mcap", push_messages())
    assert palpate("--replay", "bag.mcap", "--shape", "disc", "--first-pose-unknown", "--seconds", "0.2") == 0
    assert given == [(ANYWHERE, ANYWHERE_SIGMA)]


def test_ctrl_c_ends_it_and_the_file_is_whole(capsys):
    push = imaged_push()
    formats.write(replace(push, time=np.arange(FRAMES) / 2.0), "push.mcap", overwrite=True)
    before = signal.getsignal(signal.SIGINT)
    timer = threading.Timer(1.5, os.kill, [os.getpid(), signal.SIGINT])
    timer.start()
    assert palpate("--replay", "push.mcap", "--record", "live.mcap", "--json") == 0
    timer.join()
    assert signal.getsignal(signal.SIGINT) is before
    found = json.loads(capsys.readouterr().out)
    assert 1 <= found["images"] <= 4
    same_frames("live.mcap", found["images"])
    with Path("live.mcap").open("rb") as file:
        assert make_reader(file).get_summary() is not None


def test_a_killed_session_leaves_what_it_recorded():
    words = ("live", "--replay", "push.mcap", "--tactile", "none", "--record", "live.mcap")
    process = subprocess.Popen([sys.executable, "-m", "palpate.cli.main", *words], stderr=subprocess.DEVNULL)
    last = time.monotonic() + 60.0
    while time.monotonic() < last and not (Path("live.mcap").exists() and Path("live.mcap").stat().st_size > 30_000):
        time.sleep(0.01)
    process.kill()
    process.wait()
    found = formats.load_recording("live.mcap")
    assert 1 <= len(found) <= FRAMES
    same_frames("live.mcap")


def test_the_view_sees_each_frame(monkeypatch):
    from contextlib import contextmanager

    from palpate.viewer import rerun_view

    class Log:
        def __init__(self):
            self.times = []

        def show(self, frame, estimate, background):
            assert frame.time == estimate.time and frame.image.shape == (40, 30, 3)
            self.times.append(frame.time)

    log = Log()

    @contextmanager
    def live_view(recording, name, file, force, window):
        assert (len(recording), name, file, window) == (FRAMES, "push.mcap", None, True)
        yield log

    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(rerun_view, "live_view", live_view)
    assert palpate("--replay", "push.mcap", "--view", "--seconds", "0.4") == 0
    assert len(log.times) > 5


def test_what_cannot_be_tracked_live(capsys):
    push = imaged_push()
    formats.write(replace(push, image=None), "blind.mcap")
    Path("there.mcap").write_text("mine")
    assert "there is no display" in failure(capsys, "--replay", "push.mcap", "--view")
    assert "oracle needs ground truth" in failure(capsys, "--replay", "push.mcap", "--tactile", "oracle")
    assert "--seconds is 0" in failure(capsys, "--replay", "push.mcap", "--seconds", "0")
    assert "there.mcap: already exists" in failure(capsys, "--replay", "push.mcap", "--record", "there.mcap")
    assert "folder nowhere does not exist" in failure(capsys, "--replay", "push.mcap", "--record", "nowhere/a.mcap")
    assert "has no images" in failure(capsys, "--replay", "blind.mcap", "--record", "new.mcap")
    assert "gone.mcap: no such file" in failure(capsys, "--replay", "gone.mcap")


def cells(state: LiveState, column: int) -> list[Any]:
    """What a column of the table shows."""
    return list(table_of("palpate live", state).columns[column].cells)


def estimated() -> LiveEstimate:
    return LiveEstimate(
        Estimate(0.0, np.zeros(3), np.eye(3), True, "tracking"), SensorPlace(np.zeros(3), "known", 0.0), 0.02
    )


def test_the_table_keeps_its_rows():
    state = LiveState(lambda text: None)
    empty = cells(state, 0)
    assert empty == ["images", "latency", "contact", "status", "object", "sensor pose", ""]
    state.add(estimated())
    state.note("the camera is lost")
    assert cells(state, 0) == empty
    shown = cells(state, 1)
    assert shown[1:4] == ["20.0 ms, 99 %: 20.0 ms", "yes", "tracking"] and shown[-1] == "the camera is lost"


def test_the_table_may_be_drawn_while_the_first_estimate_comes(monkeypatch):
    state = LiveState(lambda text: None)
    latency_ms = state.latency_ms

    def in_between(last: int = 0) -> Any:
        before = latency_ms(last)
        state.add(estimated())
        return before

    monkeypatch.setattr(state, "latency_ms", in_between)
    assert cells(state, 1)[1] == "-"
    assert cells(state, 1)[1] == "20.0 ms, 99 %: 20.0 ms"


def test_a_camera_with_poses_by_udp(monkeypatch, capsys):
    """A fake camera and a program that sends poses; what is recorded is a recording."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    closed: list[bool] = []

    class Fake:
        def __init__(self, path, size):
            assert size == (320, 240)
            self.index = 0

        def grab(self):
            time.sleep(1.0 / 60)
            self.index += 1
            return True

        def image(self):
            gel = np.full((320, 240, 3), 90, np.uint8)
            if self.index > 60:
                gel[100:200, 80:160] += 60
            return gel

        def close(self):
            closed.append(True)

    done = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for index in itertools.count():
                if done.wait(0.01):
                    return
                said: dict[str, Any] = {"time": time.time(), "pose": [0.1, 0.05, 0.0]}
                sender.sendto(b"rubbish" if index % 20 == 0 else json.dumps(said).encode(), ("127.0.0.1", port))

    defaults: Any = setup.camera_set_up.__defaults__
    monkeypatch.setattr(setup.camera_set_up, "__defaults__", (*defaults[:-1], Fake))
    monkeypatch.setattr(setup, "camera_path", lambda name: Path("/dev") / name)
    robot = threading.Thread(target=send)
    robot.start()
    words = ("--camera", "fake", "--poses", f"udp:{port}", "--shape", "rectangle", "--first-pose", "0.3", "0.05", "0")
    try:
        assert "folder nowhere does not exist" in failure(capsys, *words, "--record", "nowhere/live.mcap")
        assert closed  # and the port is free again
        assert palpate(*words, "--record", "live.mcap", "--seconds", "3", "--json") == 0
    finally:
        done.set()
        robot.join()
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert "a sensor pose is refused, 1 so far: 'rubbish' is no JSON" in err
    assert found["tracked"] > 20 and found["contact_frames"] > 5 and found["refused_poses"] > 2
    assert 5.0 < found["rate_hz"] < 66.0  # the camera's 60; a busy machine grabs fewer, and never more
    recorded: Any = formats.load_recording("live.mcap")
    assert len(recorded) > 20 and recorded.sensor.image_height == 320
    assert np.allclose(recorded.sensor_pose, [0.1, 0.05, 0.0])
    assert abs(recorded.time[-1] - time.time()) < 30.0


def test_what_a_camera_needs(capsys):
    assert "either --camera with --poses, or --replay" in failure(capsys)
    assert "either --camera with --poses, or --replay" in failure(capsys, "--camera", "0")
    assert "X Y THETA or --first-pose-unknown" in failure(capsys, "--camera", "0", "--poses", "udp:9")
    object_ = ("--shape", "disc", "--first-pose", "0", "0", "0")
    assert "only --shape and --shape-unit" in failure(
        capsys, "--camera", "0", "--poses", "udp:9", *object_, "--plane", "fit"
    )
    assert "there is no such device" in failure(capsys, "--camera", "/dev/video98", "--poses", "udp:9", *object_)
