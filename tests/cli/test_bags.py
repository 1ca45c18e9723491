"""Bags of ROS messages on the command line: info, track and convert."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_samples import (
    compressed_message,
    image_message,
    image_times,
    pose_message,
    pose_times,
    push_messages,
    touch_images,
    true_pose,
    write_bag,
)
from rosbags.highlevel import AnyReader

import palpate

TRACK = ("track", "push.bag", "--shape", "disc", "--first-pose", "0.3", "0", "0")


@pytest.fixture(autouse=True)
def _bag(folder):
    write_bag(Path("push"), "ros1", push_messages())


def messages(path: str, topic: str) -> list:
    with AnyReader([Path(path)]) as bag:  # a reader of others
        found = ((bag.deserialize(data, one.msgtype), one.topic) for one, _, data in bag.messages())
        return [message for message, name in found if name == topic]


def test_info_lists_topics_and_what_would_be_read(succeeds, json_of):
    out = succeeds("info", "push.bag")
    (image,) = [" ".join(line.split()) for line in out.splitlines() if "sensor_msgs/msg/CompressedImage" in line]
    assert "/digit/image/compressed sensor_msgs/msg/CompressedImage ros1 24 30 0.0333" in image
    assert " track push.bag --shape NAME|AxB|FILE --first-pose X Y THETA" in out
    found = json_of("info", "push.bag")
    assert (found["format"], found["source"]) == ("bag", "bag push.bag: /digit/image/compressed, /ee_pose")
    poses = found["topics"][2]
    assert (poses["topic"], poses["messages"], poses["rate_hz"]) == ("/ee_pose", 68, pytest.approx(50.0))


def test_track_reads_a_bag_and_writes_messages(succeeds):
    assert "final pose" in succeeds(*TRACK, "--tactile", "learnt", "--mcap")
    online = np.genfromtxt("runs/push/estimates.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert online["time"].tolist() == (image_times() / 1e9).tolist()
    poses = [message.pose.position for message in messages("runs/push/estimates.mcap", "/palpate/object_pose")]
    assert np.allclose([(pose.x, pose.y) for pose in poses], np.column_stack([online["x"], online["y"]]), atol=1e-12)
    assert "diagnostic_msgs/msg/DiagnosticArray" in succeeds("info", "runs/push/estimates.mcap")
    succeeds(*TRACK, "--force")
    assert not Path("runs/push/estimates.mcap").exists()
    settings = json.loads(Path("runs/push/settings.json").read_text())
    assert settings["source"] == "bag push.bag: /digit/image/compressed, /ee_pose"


def test_track_reads_a_folder_and_named_topics(json_of):
    times = pose_times()
    others = [pose_message(time, pose, "/mocap") for time, pose in zip(times, true_pose(times), strict=True)]
    write_bag(Path("two"), "ros2", sorted([*push_messages(), *others], key=lambda message: message.log_time))
    topics = ("--sensor-poses", "/ee_pose", "--object-poses", "/mocap", "--images", "/digit/image/compressed")
    found = json_of("track", "two", "--shape", "disc", *topics, "--time-offset", "-0.005")
    assert (found["frames"], found["scored_frames"]) == (24, 24)


def test_all_that_a_bag_lacks_is_in_one_message(fails):
    times = pose_times()
    others = [pose_message(time, pose, "/mocap") for time, pose in zip(times, true_pose(times), strict=True)]
    images = [replace(message, topic="/left") for message in push_messages() if message.type.endswith("Image")]
    write_bag(Path("two"), "ros2", sorted([*push_messages(), *others, *images], key=lambda message: message.log_time))
    error = fails("track", "two")
    for missing in ("--shape", "--first-pose", "--images TOPIC", "--sensor-poses TOPIC", "/mocap", "/left"):
        assert missing in error, missing


def test_what_reading_warns_of_is_in_the_summary_and_compiling_is_not(json_of, monkeypatch):
    monkeypatch.setattr("palpate.tracker.path_of", lambda function: None)
    monkeypatch.delitem(vars(sys.modules["palpate.tracker"].PUSHING.improve), "code")
    found = json_of(*TRACK, "--time-offset", "0.8")
    assert [each.split(": ")[1] for each in found["warnings"][:1]] == [
        "8 of 24 images have no sensor pose at their time and are left out"
    ]
    assert not any("compiling" in each for each in found["warnings"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("track", "push.bag"), "--shape"),
        (("track", "push.bag", "--shape", "disc"), "--first-pose X Y THETA"),
        ((*TRACK, "--plane", "0", "-1", "0"), "mm off the plane"),
        (("convert", "push.bag", "a.mcap", "--shape", "90x60"), "are these millimetres"),
    ],
)
def test_bad_input_is_one_line(fails, words, message):
    assert message in fails(*words)
    assert not list(Path().glob("runs/*")) and not Path("a.mcap").exists()


def test_info_proposes_no_track_that_is_refused(json_of):
    grey = [
        image_message(time, image, encoding="mono8") for time, image in zip(image_times(), touch_images(), strict=True)
    ]
    turned = [
        image_message(time, image.transpose(1, 0, 2)) for time, image in zip(image_times(), touch_images(), strict=True)
    ]
    poses = [message for message in push_messages() if message.topic == "/ee_pose"]
    advice = {}
    for name, images in (("grey", grey), ("turned", turned)):
        write_bag(Path(name), "ros1", [*images, *poses])
        advice[name] = json_of("info", f"{name}.bag")["advice"]
    steep = [pose_message(time, (0.3, 0.0, 0.0), height=0.01 * index) for index, time in enumerate(pose_times())]
    torn = compressed_message(image_times()[3], touch_images()[3])
    torn.content["data"] = torn.content["data"][:900]
    images = [message for message in push_messages() if message.type.endswith("Image")]
    write_bag(Path("steep"), "ros1", [*images, *steep])
    write_bag(Path("torn"), "ros1", [*images[:3], torn, *images[4:], *poses])
    assert "mm off the plane" in json_of("info", "steep.bag")["advice"]
    assert json_of("info", "torn.bag")["damaged_images"] == 1
    assert "images are encoded as 'mono8', allowed are rgb8" in advice["grey"]
    assert "--orientation 90" in advice["turned"] and "another --sensor" in advice["turned"]
    for words in (("--orientation", "90"), ("--sensor", "gelsight-mini")):
        found = json_of("info", "turned.bag", *words)["advice"]
        assert f" track turned.bag {' '.join(words)} --shape" in found


def test_info_chooses_the_topics_that_are_named_as_touch(json_of, succeeds):
    scene = [
        replace(message, topic="/camera/color") for message in push_messages() if message.topic.startswith("/digit")
    ]
    times = pose_times()
    others = [pose_message(time, pose, "/mocap") for time, pose in zip(times, true_pose(times), strict=True)]
    touch = [replace(message, topic="/digit_pose") for message in push_messages() if message.topic == "/ee_pose"]
    images = [message for message in push_messages() if message.topic.startswith("/digit")]
    write_bag(Path("robot"), "ros2", sorted([*scene, *others, *touch, *images], key=lambda message: message.log_time))
    found = json_of("info", "robot")
    assert " track robot --images /digit/image/compressed --sensor-poses /digit_pose --shape" in found["advice"]
    assert "/mocap" in found["other_poses"] and "--object-poses" in found["other_poses"]
    words = found["advice"].partition("track ")[2].replace("NAME|AxB|FILE", "disc").partition(" --first")[0].split()
    succeeds("convert", *words, "--object-poses", "/mocap", "robot.mcap")  # OUT may stand at the end
    assert json_of("info", "robot.mcap")["truth_share"] == 1.0


def test_convert_joins_images_in_a_folder_and_poses_in_a_bag(succeeds):
    Path("film").mkdir()
    for index, image in enumerate(touch_images()):
        cv2.imwrite(f"film/{index}.png", np.rot90(image, -1)[..., ::-1])
    rows = [f"{index}.png, {time}\n" for index, time in enumerate(image_times().tolist())]
    Path("times.csv").write_text("file, time\n" + "".join(rows))
    words = ("--images", "film", "--image-times", "times.csv", "--orientation", "90", "--shape", "disc")
    flange = ("--sensor-T-gel", *map(str, (0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)))
    succeeds("convert", "push.bag", "joined.mcap", *words, *flange)
    found = palpate.load_recording("joined.mcap")
    assert all((frame.image == image).all() for frame, image in zip(found, touch_images(), strict=True))
    assert found.time.tolist() == (image_times() / 1e9).tolist()


def test_convert_makes_a_recording_of_a_bag(succeeds):
    succeeds("convert", "push.bag", "box.mcap", "--shape", "90x60", "--shape-unit", "mm")
    found = palpate.load_recording("box.mcap")
    assert found.shape == palpate.Rectangle(0.09, 0.06)
    off = found.sensor_pose - true_pose(image_times())
    assert np.abs(off[:, :2]).max() < 1e-9 and np.abs(np.sin(off[:, 2])).max() < 1e-9
