import json
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_samples import SIZE, FakeTracker, images_at, state, wait_for
from test_package import EXAMPLES, python

from palpate.errors import SettingError
from palpate.live.poses import Refused, TimedPose
from palpate.live.session import Sources, track_live
from palpate.live.sources import Clock, UdpPoses, own_poses

RUBBISH = [
    b"",
    b"\xff\xfe\x00",
    b"[" * 60000,
    b'{"pose": [1, 2]}',
    b'{"pose": "abc"}',
    b'{"pose": [1, 2, NaN]}',
    b'{"pose": [1, 2, 1e999]}',
    b'{"time": Infinity, "pose": [1, 2, 3]}',
    b'{"time": {}, "pose": [1, 2, 3]}',
    b'{"time": 12.0, "pose": [1, 2, 3]}',
    b'{"pose": [1, 2, null]}',
    b"[1, 2, 3]",
    b'{"position": [1, 2, 3]}',
]


def gathered(source: Any, count: int) -> list[Any]:
    """The first items of a source, in a thread's turn at most some seconds."""
    stop, found = threading.Event(), []
    timer = threading.Timer(10.0, stop.set)
    timer.start()
    for item in source(stop):
        found.append(item)
        if len(found) == count:
            stop.set()
    timer.cancel()
    return found


def send(port: int, *packets: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in packets:
            sender.sendto(data, ("127.0.0.1", port))


def test_udp_takes_poses_and_refuses_rubbish():
    clock = Clock(time.time())
    source = UdpPoses(0, clock)
    now = clock.now()
    good = [json.dumps({"time": now - 0.25, "pose": [0.1, 0.2, 0.3]}).encode(), b'{"pose": [1, 2, 3]}']
    send(source.port, b"from before anybody listened")
    robot = threading.Timer(0.3, send, [source.port, good[0], *RUBBISH, good[1]])
    robot.start()
    found = gathered(source.poses, len(RUBBISH) + 2)
    robot.join()
    assert isinstance(found[0], TimedPose) and isinstance(found[-1], TimedPose)
    assert (found[0].time, found[0].pose.tolist()) == (pytest.approx(now - 0.25), [0.1, 0.2, 0.3])
    assert abs(found[-1].time - now) < 5.0 and found[-1].pose.tolist() == [1.0, 2.0, 3.0]
    assert all(isinstance(each, Refused) for each in found[1:-1])
    reasons = [each.reason for each in found[1:-1]]
    assert all("\n" not in reason and len(reason) < 300 for reason in reasons)
    assert "'' is no JSON" in reasons[0] and "s off this computer's clock" in reasons[9]


def test_udp_keeps_to_loopback_and_a_port_in_use_is_said():
    source = UdpPoses(0, Clock(0.0))
    assert source._socket.getsockname()[0] == "127.0.0.1"
    with pytest.raises(SettingError, match=rf"cannot listen on port {source.port} of 127.0.0.1 \(.*in use"):
        UdpPoses(source.port, Clock(0.0))
    stop = threading.Event()
    stop.set()
    assert list(source.poses(stop)) == []


SENDER = """
import json, socket, sys, time
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
while True:
    sender.sendto(json.dumps({"time": time.time(), "pose": [0.1, 0.2, 0.3]}).encode(), ("127.0.0.1", int(sys.argv[1])))
    time.sleep(0.005)
"""


def test_a_source_that_is_killed_and_begun_again_five_times():
    clock, stop = Clock(time.time()), threading.Event()
    source, (counts, said) = UdpPoses(0, clock), state()

    def robot() -> None:
        for times in range(1, 6):
            before = counts.poses
            sender = subprocess.Popen([sys.executable, "-S", "-c", SENDER, str(source.port)])
            wait_for(lambda before=before: counts.poses > before + 20)
            sender.kill()
            sender.wait()
            wait_for(lambda times=times: sum("have stalled" in text for text in said) == times)
        stop.set()

    hand = threading.Thread(target=robot)
    hand.start()
    images = images_at(clock, clock.now() + np.arange(3000) / 60)
    track_live(FakeTracker(), Sources(images, source.poses, clock, SIZE), counts, stop)  # pyright: ignore[reportArgumentType]
    hand.join()
    assert sum("have stalled" in text for text in said) == 5 and sum("sensor poses come" in text for text in said) >= 4
    assert counts.refused == 0 and counts.poses > 100 and counts.without_pose > 0
    assert counts.images == counts.tracked + counts.dropped + counts.without_pose


def install(folder: Path, module: str, code: str, monkeypatch: Any) -> None:
    """A package of somebody's own that is installed, with one entry point, named like its module."""
    (folder / f"{module}.py").write_text(code)
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[palpate.poses]\n{module} = {module}:poses\n")
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.delitem(sys.modules, module, raising=False)


def test_poses_come_from_an_entry_point(tmp_path, monkeypatch):
    install(tmp_path, "own_poses", (EXAMPLES / "own_package/my_robot_poses.py").read_text(), monkeypatch)
    clock = Clock(time.time())
    found = gathered(own_poses("own_poses", clock), 4)
    assert all(isinstance(each, TimedPose) for each in found)
    assert abs(found[-1].time - clock.now()) < 1.0
    assert [each.pose[0] for each in found] == pytest.approx([0.1 + 0.02 * (e.time - found[0].time) for e in found])
    with pytest.raises(
        SettingError, match=r"allowed are udp:PORT, ros2:TOPIC or an entry point of palpate.poses, known are own_"
    ):
        own_poses("other", clock)


def test_the_example_runs():
    lines = python(str(EXAMPLES / "own_package/my_robot_poses.py")).splitlines()
    assert len(lines) == 3 and all("theta 0.00 rad" in line for line in lines)


def test_an_entry_point_that_gives_rubbish_or_raises(tmp_path, monkeypatch):
    code = "import time\ndef poses():\n    yield 7\n    yield 1.0, 2.0\n    yield time.time(), 1, 2, float('nan')\n"
    install(tmp_path, "bad_poses", code + "    raise KeyError('robot')\n", monkeypatch)
    source, found = own_poses("bad_poses", Clock(time.time())), []
    with pytest.raises(
        SettingError, match=r"entry point bad_poses of palpate.poses, bad_poses:poses, ended with KeyError: 'robot'"
    ):
        for item in source(threading.Event()):
            found.append(item)
    assert len(found) == 3 and all(isinstance(each, Refused) for each in found)
    install(tmp_path, "broken", "raise ImportError('no driver')", monkeypatch)
    with pytest.raises(SettingError, match="cannot be loaded: ImportError: no driver"):
        own_poses("broken", Clock(0.0))
