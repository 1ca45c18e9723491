"""Messages that the node publishes of an estimate, with a stand-in for rclpy: `rosbags` has the same types."""

import threading
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate import Estimate, ros2
from palpate.io.ros_messages import ros_types
from palpate.live.ros2_topics import Ros2Poses
from palpate.live.session import LiveEstimate, LiveState
from palpate.live.sources import Clock, Refused, SensorPlace, TimedPose
from palpate.types.estimate import Answer
from palpate.types.space import plane_across

COVARIANCE = np.diag([4e-6, 9e-6, 1e-4])
POSES = np.array([[0.1, 0.2, 0.0], [0.1, 0.24, np.pi / 2]])


def test_all_answers_are_published(monkeypatch):
    published: dict[str, list[Any]] = {}

    def create_publisher(type_: type, topic: str, _: int) -> Any:
        return SimpleNamespace(publish=published.setdefault(topic, []).append)

    monkeypatch.setattr(ros2, "message_type", lambda name: ros_types("cdr").types[name])
    ros: Any = SimpleNamespace(node=SimpleNamespace(create_publisher=create_publisher))
    plane = plane_across("base", np.array([0.0, 0.0, 1.0]), np.array([[0.0, 0.0, 0.25]]))
    publisher = ros2.Publisher(ros, lambda: plane, 10**9, LiveState(print))
    several = tuple(Answer(pose, COVARIANCE, weight) for pose, weight in zip(POSES, (0.7, 0.3), strict=True))
    ambiguous = Estimate(0.5, POSES[0], np.eye(3), True, "ambiguous", "2 poses fit", several)
    sure = Estimate(0.75, POSES[1], COVARIANCE, True, "tracking", "", (Answer(POSES[1], COVARIANCE, 1.0),))
    for estimate in (ambiguous, sure):
        publisher.publish(LiveEstimate(estimate, SensorPlace(np.zeros(3), 0.0), 0.004))
    arrays, diagnoses = published["~/object_pose_answers"], published["~/diagnostics"]
    for index, poses in enumerate((POSES, POSES[1:])):
        array, diagnosis, best = arrays[index], diagnoses[index], published["~/object_pose"][index]
        assert array.header == diagnosis.header == best.header and array.header.frame_id == "base"
        found = [[one.position.x, one.position.y, one.position.z, one.orientation.z] for one in array.poses]
        assert np.allclose(found, [[x, y, 0.25, np.sin(yaw / 2)] for x, y, yaw in poses])
        assert array.poses[0] == best.pose
    assert [one.status[0].message for one in diagnoses] == ["ambiguous", "tracking"]
    words = [{each.key: each.value for each in one.status[0].values} for one in diagnoses]
    assert [one["answer weights"] for one in words] == ["0.7000 0.3000", "1.0000"]
    assert [one["answer sigmas y [mm]"] for one in words] == ["3.00 3.00", "3.00"]


def test_poses_are_those_of_the_plane_through_the_first():
    types = ros_types("cdr").types

    def message(height: float, w: float = 1.0, frame: str = "base") -> Any:
        pose = SimpleNamespace(
            position=SimpleNamespace(x=0.5, y=0.0, z=height), orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=w)
        )
        stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)  # none: the time is that of the arrival
        return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id=frame), pose=pose)

    messages = [message(0.2), message(0.23), message(0.2, 0.5), message(0.2, frame="map"), message(0.205)]
    ros: Any = SimpleNamespace(messages=lambda *_: iter(messages))
    first, off, broken, other, last = Ros2Poses(ros, "/robot/sensor_pose", Clock()).poses(threading.Event())
    for pose in (first, last):
        assert isinstance(pose, TimedPose) and pose.pose == pytest.approx([0.5, 0.0, 0.0])
        assert pose.time == pytest.approx(time.time(), abs=60.0)
    words = ("30.0 mm off the plane of the first", "a quaternion of length 1", "the first was in 'base'")
    for refused, expected in zip((off, broken, other), words, strict=True):
        assert isinstance(refused, Refused) and expected in refused.reason
