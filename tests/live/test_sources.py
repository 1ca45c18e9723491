"""Sensor poses: those that arrive, and the pose at an image's time."""

import json
import math
import socket
import threading
from typing import Any

import numpy as np
import pytest

from palpate import FrameError
from palpate.live.sources import PoseTrack, TimedPose, udp_poses
from palpate.types.choices import Placement
from palpate.types.space import GelPoses


def track(*rows: tuple[float, float, float]) -> PoseTrack:
    poses = PoseTrack()
    for when, x, yaw in rows:
        assert poses.add(TimedPose(when, np.array([x, 0.5, yaw]))) is None
    return poses


def place(poses: PoseTrack, when: float) -> Any:
    found = poses.at(when)
    assert not isinstance(found, FrameError)
    return found


def refused(poses: PoseTrack, when: float) -> str:
    found = poses.at(when)
    assert isinstance(found, FrameError)
    return str(found)


def test_between_poses_the_shorter_turn_is_taken():
    poses = track((1.0, 0.1, 3.1), (1.1, 0.2, -3.1), (1.2, 0.2, -3.1))
    assert place(poses, 1.025) == pytest.approx([0.125, 0.5, 3.1 + 0.25 * (2 * math.pi - 6.2)])
    for when in (1.1, 1.2):
        assert place(poses, when) == pytest.approx([0.2, 0.5, -3.1])


def test_after_the_last_pose_motion_is_extrapolated_until_it_is_too_old():
    poses = track((1.0, 0.0, 0.0), (1.04, 0.1, 0.0), (1.06, 0.11, 0.02))
    assert place(poses, 1.08) == pytest.approx([0.12, 0.5, 0.04])
    assert "is 0.24 s older" in refused(poses, 1.3)
    assert place(track((1.0, 0.2, 0.0)), 1.01) == pytest.approx([0.2, 0.5, 0.0])  # one pose shows no motion


def test_unknown_poses():
    assert "none has come before it" in refused(PoseTrack(), 1.0)
    poses = track((1.0, 0.0, 0.0), (1.6, 0.1, 0.0), (1.7, 0.1, 0.0))
    assert "none has come before it" in refused(poses, 0.9)
    assert "is 0.30 s older" in refused(poses, 1.3)  # in so long a gap
    assert place(poses, 1.65) == pytest.approx([0.1, 0.5, 0.0]) and poses.reaches(1.65) and not poses.reaches(1.75)


def test_times_must_increase():
    poses = track((1.0, 0.0, 0.0))
    refused = poses.add(TimedPose(1.0, np.zeros(3)))
    assert refused is not None and "not after the last one's" in str(refused)


def received(**packet: Any) -> TimedPose | FrameError | str:
    """Return what is made of a packet that arrives at 50 s."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind(("127.0.0.1", 0))
        port = sender.getsockname()[1]
    with (
        udp_poses(f"udp:{port}", lambda: 50.0, GelPoses(Placement())) as source,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        robot = threading.Timer(0.1, sender.sendto, (json.dumps(packet).encode(), ("127.0.0.1", port)))
        robot.start()
        found = next(source(threading.Event()))
        robot.join()
    return found


@pytest.mark.parametrize("name", ["timestamp", "Time", "stamp", "t", "time_ms"])
def test_a_time_of_another_name_is_not_that_of_arrival(name):
    found = received(pose=[0.1, 0.0, 0.3], **{name: 49.9})
    assert f"its time is named '{name}'; allowed is 'time'" in str(found)


def test_a_pose_without_a_time_has_that_of_its_arrival():
    found = received(pose=[0.1, 0.0, 0.3], frame="base")
    assert isinstance(found, TimedPose) and found.time == 50.0


def test_a_sensor_upside_down_is_told_as_by_w_first(caplog):
    found = received(pose=[0.1, 0.0, 0.1, math.cos(0.05), 0.0, 0.0, math.sin(0.05)])
    assert isinstance(found, TimedPose) and "unless the quaternions have w first" in caplog.text
