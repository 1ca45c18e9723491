"""Topics of the node, with a stand-in for rclpy: `rosbags` has the same messages."""

import sys
import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate import Estimate, FrameError, Outline, SettingError, ros2
from palpate.io.ros_messages import ODOMETRY, POSE, POSE_TYPES, TRANSFORM, ros_types
from palpate.live.sources import TimedPose, TouchImage
from palpate.types.estimate import Answer

COVARIANCE = np.diag([4e-6, 9e-6, 1e-4])
POSES = np.array([[0.1, 0.2, 0.0], [0.1, 0.24, np.pi / 2]])


class FakeNode:
    """Stands for rclpy's node: somebody publishes `messages` of a type, and what palpate publishes is kept."""

    def __init__(self, messages: list[Any], type_: str = POSE, **parameters: Any) -> None:
        self.messages, self.type, self.published = messages, type_, dict[str, list[Any]]()
        self.parameters = parameters

    def declare_parameter(self, name: str, default: Any, descriptor: Any) -> Any:
        return SimpleNamespace(value=self.parameters.get(name))

    def get_logger(self) -> Any:
        return SimpleNamespace(info=lambda _: None)

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=10**9))

    def create_publisher(self, type_: Any, topic: str, _: int) -> Any:
        heard, store = self.published.setdefault(topic, []), ros_types("cdr")
        return SimpleNamespace(publish=lambda data: heard.append(store.deserialize_cdr(data, type_.__msgtype__)))

    def resolve_topic_name(self, topic: str) -> str:
        return f"/{topic}"

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        return [SimpleNamespace(topic_type=self.type, qos_profile=SimpleNamespace(reliability="reliable"))]

    def create_subscription(self, type_: type, topic: str, hear: Any, qos: Any) -> None:
        for message in self.messages:
            hear(message)


@pytest.fixture(autouse=True)
def _types(monkeypatch):
    types = ros_types("cdr").types | {"rcl_interfaces/msg/ParameterDescriptor": SimpleNamespace}
    monkeypatch.setattr(ros2, "message_type", types.__getitem__)
    monkeypatch.setitem(sys.modules, "rclpy.qos", SimpleNamespace(QoSProfile=lambda **_: None))


def message(height: float, w: float = 1.0, frame: str = "base") -> Any:
    stamp = ros_types("cdr").types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)  # none: that of the arrival
    turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=w)
    pose = SimpleNamespace(position=SimpleNamespace(x=0.5, y=0.0, z=height), orientation=turn)
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id=frame), pose=pose)


def heard(topics: ros2.Topics, count: int) -> list[Any]:
    poses = topics.poses(threading.Event())
    assert next(poses) == f"waiting for /sensor_pose, of type {' or '.join(POSE_TYPES)}"
    return [next(poses) for _ in range(count)]


def test_poses_are_those_of_the_plane_through_the_first():
    messages = [message(0.2), message(0.23), message(0.2, 0.5), message(0.2, frame="map"), message(0.205)]
    topics = ros2.Topics(FakeNode(messages))
    first, off, broken, other, last = heard(topics, 5)
    for pose in (first, last):
        assert isinstance(pose, TimedPose) and pose.pose == pytest.approx([0.5, 0.0, 0.0]) and pose.time == 0.0
    words = ("30.0 mm off the plane of the first", "a quaternion of length 1", "the first was in 'base'")
    for refused, expected in zip((off, broken, other), words, strict=True):
        assert isinstance(refused, FrameError) and expected in str(refused)


def test_poses_of_a_flange_are_moved_to_the_gel():
    turn = np.sqrt(0.5)  # the flange looks along its z axis, which is the gel's x axis; a quarter turn about y
    gel = (0.0, 0.0, 0.1, 0.0, -turn, 0.0, turn)
    flange = message(0.2)
    flange.pose.orientation = SimpleNamespace(x=0.0, y=turn, z=0.0, w=turn)  # its z axis along the world's x
    (pose,) = heard(ros2.Topics(FakeNode([flange], sensor_T_gel=gel)), 1)
    assert isinstance(pose, TimedPose) and pose.pose == pytest.approx([0.6, 0.0, 0.0])


@pytest.mark.parametrize("type_", [ODOMETRY, TRANSFORM])
def test_poses_of_mobile_robots_and_motion_capture(type_):
    sent = message(0.2)
    pose = vars(sent).pop("pose")
    if type_ == ODOMETRY:
        sent.pose = SimpleNamespace(pose=pose)
    else:
        sent.transform = SimpleNamespace(translation=pose.position, rotation=pose.orientation)
    sent.child_frame_id = "digit"
    (heard_pose,) = heard(ros2.Topics(FakeNode([sent], type_)), 1)
    assert isinstance(heard_pose, TimedPose) and heard_pose.pose == pytest.approx([0.5, 0.0, 0.0])


def test_a_topic_of_another_type_is_refused():
    topics = ros2.Topics(FakeNode([], "std_msgs/msg/String"))
    with pytest.raises(SettingError, match="/sensor_pose has messages of type std_msgs/msg/String, allowed are geom"):
        heard(topics, 1)


def test_estimates_are_published():
    node = FakeNode([message(0.25)])
    topics = ros2.Topics(node)
    heard(topics, 1)
    several = tuple(Answer(pose, COVARIANCE, weight) for pose, weight in zip(POSES, (0.7, 0.3), strict=True))
    ambiguous = Estimate(0.5, POSES[0], np.eye(3), True, "ambiguous", "2 poses fit", several)
    sure = Estimate(0.75, POSES[1], COVARIANCE, True, "tracking", "", (Answer(POSES[1], COVARIANCE, 1.0),))
    for estimate in (ambiguous, sure):
        topics.publish({"left_out": 3}, estimate)
    published = node.published
    diagnoses = published["~/diagnostics"]
    for index, (x, y, yaw) in enumerate(POSES):
        diagnosis, best = diagnoses[index], published["~/object_pose"][index]
        assert diagnosis.header == best.header and best.header.frame_id == "base"
        assert (best.header.stamp.sec, best.header.stamp.nanosec) == (1, (500_000_000, 750_000_000)[index])
        place, turn = best.pose.position, best.pose.orientation
        assert np.allclose([place.x, place.y, place.z, turn.z], [x, y, 0.25, np.sin(yaw / 2)])
    assert [one.status[0].message for one in diagnoses] == ["ambiguous", "tracking"]
    words = [{each.key: each.value for each in one.status[0].values} for one in diagnoses]
    assert [(one["left out"], one["contact"]) for one in words] == [("3", "true")] * 2
    assert [one["reason"] for one in words] == ["2 poses fit", ""]


def test_a_learnt_outline_is_published_where_the_object_is():
    node = FakeNode([message(0.25)])
    topics = ros2.Topics(node)
    heard(topics, 1)
    angle = np.arange(8) * (np.pi / 4)
    outline = Outline(0.05 * np.column_stack((np.cos(angle), np.sin(angle))), np.full(8, 2e-3), np.ones(8, bool))
    answers = (Answer(POSES[1], COVARIANCE, 1.0),)
    topics.publish({}, Estimate(0.5, POSES[1], COVARIANCE, True, "uncertain", "", answers, outline=outline))
    (cloud,) = node.published["~/outline_points"]
    assert cloud.width == 3 * len(outline.points)
    radii = []
    for name in ("outline_inner", "outline", "outline_outer"):
        (polygon,) = node.published[f"~/{name}"]
        assert polygon.header == node.published["~/object_pose"][0].header
        points = np.array([(point.x, point.y, point.z) for point in polygon.polygon.points])
        assert np.allclose(points[:, 2], 0.25)
        away = points[:, :2] - POSES[1][:2]
        assert np.allclose(np.arctan2(away[0, 1], away[0, 0]), POSES[1][2])
        radii.append(np.hypot(*away.T).mean())
    assert radii[0] < radii[1] == pytest.approx(0.05) and radii[1] < radii[2]


def test_an_outline_that_is_not_known_needs_no_first_pose_and_a_sketch_does():
    ended = threading.Event()
    ended.set()
    ros2.run(SilentNode([], shape="unknown:50mm-200mm", tactile="none"), ended)
    ros2.run(SilentNode([], shape="disc", outline_sigma=0.005, first_pose=[0.1, 0.0, 0.3]), ended)
    for given, expected in (
        ({"shape": "disc", "outline_sigma": 0.005}, "shape and first_pose"),
        ({"shape": "unknown:big"}, "unknown:big"),
        ({"shape": "unknown", "outline_sigma": 0.005}, "outline_sigma is of a sketch"),
    ):
        with pytest.raises(SettingError, match=expected):
            ros2.run(FakeNode([], **given), ended)


class SilentNode(FakeNode):
    """A node whose topics nobody publishes."""

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        return []


class RemappedNode(FakeNode):
    """A node whose topics are remapped to one."""

    def resolve_topic_name(self, topic: str) -> str:
        return "/camera/image" if topic.endswith("image") else super().resolve_topic_name(topic)


def test_each_finger_of_a_hand_has_a_topic_of_its_own():
    stamp = ros_types("cdr").types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    pixels = np.arange(12, dtype=np.uint8)
    image = SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id=""), height=2, width=2, step=6, encoding="rgb8", data=pixels
    )
    stop = threading.Event()
    images = ros2.Topics(FakeNode([image], "sensor_msgs/msg/Image"), fingers=("left", "right")).images(stop)
    came = [next(images) for _ in range(4)]
    stop.set()
    notes = sorted(item for item in came if isinstance(item, str))
    assert [note.split(",")[0] for note in notes] == [
        "finger left: waiting for /left/image",
        "finger right: waiting for /right/image",
    ]
    assert sorted(item.finger for item in came if isinstance(item, TouchImage)) == ["left", "right"]
    with pytest.raises(SettingError, match="'left' and 'right' have one topic, /camera/image"):
        ros2.Topics(RemappedNode([]), fingers=("left", "right"))


def test_without_rclpy_it_says_what_to_do(capsys):
    assert ros2.main([]) == 2
    assert "source its setup.bash" in " ".join(capsys.readouterr().err.split())
