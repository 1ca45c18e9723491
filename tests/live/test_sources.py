"""Sensor poses: the pose at an image's time."""

import math
import threading
import time

import numpy as np
import pytest

from palpate.live.sources import PoseTrack, SensorPlace, TimedPose


def track(*rows: tuple[float, float, float]) -> PoseTrack:
    """Poses of (time, x, yaw)."""
    poses = PoseTrack()
    for when, x, yaw in rows:
        assert poses.add(TimedPose(when, np.array([x, 0.5, yaw]))) is None
    return poses


def place(poses: PoseTrack, when: float) -> SensorPlace:
    found = poses.at(when)
    assert found is not None
    return found


def test_between_poses_the_shorter_turn_is_taken():
    poses = track((1.0, 0.1, 3.1), (1.1, 0.2, -3.1), (1.2, 0.2, -3.1))
    found = place(poses, 1.025)
    assert found.age == 0.0
    assert found.pose == pytest.approx([0.125, 0.5, 3.1 + 0.25 * (2 * math.pi - 6.2)])
    for when in (1.1, 1.2):
        assert place(poses, when).age == 0.0
        assert place(poses, when).pose == pytest.approx([0.2, 0.5, -3.1])


def test_after_the_last_pose_motion_is_extrapolated_until_it_is_too_old():
    poses = track((1.0, 0.0, 0.0), (1.04, 0.1, 0.0), (1.06, 0.11, 0.02))
    found = place(poses, 1.08)
    assert found.age == pytest.approx(0.02)
    assert found.pose == pytest.approx([0.12, 0.5, 0.04])
    assert poses.at(1.3) is None
    assert place(track((1.0, 0.2, 0.0)), 1.01).pose == pytest.approx([0.2, 0.5, 0.0])  # one pose shows no motion


def test_unknown_poses():
    assert PoseTrack().at(1.0) is None
    poses = track((1.0, 0.0, 0.0), (1.6, 0.1, 0.0), (1.7, 0.1, 0.0))
    assert poses.at(0.9) is None
    assert poses.at(1.3) is None  # in so long a gap
    assert place(poses, 1.65).age == 0.0


def test_an_image_waits_shortly_for_the_pose_after_it():
    poses = track((1.0, 0.0, 0.0))
    later = threading.Timer(0.002, poses.add, [TimedPose(1.02, np.array([0.1, 0.5, 0.0]))])
    later.start()
    found = poses.at(1.01)
    later.join()
    assert found is not None and found.age in (0.0, pytest.approx(0.01))  # the latter on a machine that is very busy
    begin = time.monotonic()
    assert poses.at(1.15) is not None and time.monotonic() - begin < 1.0


def test_times_must_increase():
    poses = track((1.0, 0.0, 0.0))
    refused = poses.add(TimedPose(1.0, np.zeros(3)))
    assert refused is not None and "not after the last one's" in refused.reason
