"""Bags on the command line: info, track and convert."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from bag_samples import (
    image_times,
    pose_message,
    pose_times,
    push_messages,
    true_pose,
    write_bag,
)
from recording_samples import pushed, tiny_recording
from rosbags.highlevel import AnyReader

from palpate import io as formats
from palpate.cli import main
from palpate.cli.options import Bag, ShapeUnit
from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle
from palpate.io import estimates_csv
from palpate.io.outlines import Unit
from palpate.io.recording_mcap import write_recording
from palpate.io.rosbag_recording import BagChoices
from palpate.pipeline import details
from palpate.pipeline import time_offset as offsets
from palpate.pipeline.run_folder import FILES
from palpate.pipeline.time_offset import TimeOffset


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch, no_figures):
    """Every test works in a folder of its own that holds the bag push.bag and the recording push.mcap."""
    monkeypatch.chdir(tmp_path)
    write_bag(Path("push"), "ros1", push_messages())
    write_recording(pushed(), "push.mcap")


def palpate(*words: str) -> int:
    """Return the exit code of the command line."""
    try:
        return main.main(words)
    except SystemExit as stop:
        return int(stop.code or 0)


def failure(capsys: Any, *words: str) -> str:
    """Return the one line with which a command fails."""
    capsys.readouterr()
    assert palpate(*words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    return line


OBJECT_AND_SENSOR = ("shape", "shape_unit", "sensor")
TRACK = ("track", "push.bag", "--shape", "disc", "--first-pose", "0.3", "0", "0")


def test_options_are_the_choices_of_the_library():
    said = {name: value for name, value in asdict(Bag()).items() if name not in OBJECT_AND_SENSOR}
    assert said == asdict(BagChoices())
    assert get_args(ShapeUnit) == get_args(Unit)


def test_info_lists_topics_and_says_what_would_be_read(capsys):
    assert palpate("info", "push.bag") == 0
    out = capsys.readouterr().out
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines() if line.startswith("  /")}
    assert rows["/digit/image/compressed"] == [
        "sensor_msgs/msg/CompressedImage", "ros1", "24", "30.0", "0", "0.033", "-3.0", "0.0",
    ]  # fmt: skip
    assert rows["/chatter"] == ["std_msgs/msg/String", "ros1", "1", "-", "0", "-", "-", "-"]
    assert "images: /digit/image/compressed   sensor poses: /ee_pose" in out
    assert "palpate track push.bag --shape NAME|FILE --first-pose X Y THETA" in out
    assert palpate("info", "push.bag", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["format"], found["cut"], found["images"]) == ("bag", False, "/digit/image/compressed")
    assert found["topics"][2] == {
        "topic": "/ee_pose",
        "type": "geometry_msgs/msg/PoseStamped",
        "encoding": "ros1",
        "messages": 68,
        "rate_hz": pytest.approx(50.0),
        "gaps": 0,
        "longest_gap_s": pytest.approx(0.02),
        "clock_offset_s": pytest.approx(-0.001),
        "clock_spread_s": pytest.approx(0.0, abs=1e-9),
        "unstamped": 0,
    }


def test_info_says_what_is_ambiguous(capsys):
    others = [pose_message(time, [0, 0, 0], "/object") for time in pose_times(5)]
    write_bag(Path("two"), "ros2", [*push_messages(), *others])
    assert palpate("info", "two") == 0
    assert "two: has more than one source of poses: /ee_pose, /object; name one by" in capsys.readouterr().out


def test_track_takes_a_bag(capsys):
    assert palpate(*TRACK, "--tactile", "learnt", "--mcap") == 0
    out, err = capsys.readouterr()
    assert "in contact" in out and err == ""
    assert sorted(path.name for path in Path("runs/push").iterdir()) == sorted([*FILES, "estimates.mcap"])
    online: Any = formats.read("runs/push/estimates.mcap")
    listed: Any = formats.read("runs/push/estimates.csv")
    assert online.time.tolist() == listed.time.tolist() == (image_times() / 1e9).tolist()
    assert np.array_equal(online.covariance, listed.covariance)
    assert online.pose[0] == pytest.approx([0.3, 0.0, 0.0])
    assert palpate("info", "runs/push/estimates.mcap") == 0
    assert "diagnostic_msgs/msg/DiagnosticArray" in capsys.readouterr().out
    assert palpate(*TRACK, "--force") == 0
    assert not Path("runs/push/estimates.mcap").exists()
    settings = json.loads(Path("runs/push/settings.json").read_text())
    assert settings["source"] == "bag push.bag, images /digit/image/compressed"


def test_track_takes_a_folder_and_names(capsys):
    times = pose_times()
    others = [pose_message(time, pose, "/mocap") for time, pose in zip(times, true_pose(times), strict=True)]
    messages = sorted([*push_messages(), *others], key=lambda message: message.log_time)
    write_bag(Path("two"), "ros2", messages)
    options = ("--sensor-poses", "/ee_pose", "--object-poses", "/mocap", "--images", "/digit/image/compressed")
    assert palpate("track", "two", "--shape", "disc", *options, "--time-offset", "-0.005", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["frames"], found["scored_frames"]) == (24, 24)
    assert "would both go to" not in failure(capsys, "track", "two", "--shape", "disc", "--out", "a")


def test_a_time_offset_is_fitted_said_and_used(capsys, monkeypatch):
    """What is found is a matter of `time_offset`; here it is said, and used where it is more than its sigma."""
    assert "no contact tells the time offset" in failure(capsys, *TRACK, "--time-offset", "fit")
    for seconds, sigma in ((-0.02, 0.005), (-0.02, 0.015)):
        found = TimeOffset(seconds, sigma, 2)
        monkeypatch.setattr(offsets, "time_offset", lambda *_, found=found: found)
        assert palpate(*TRACK, "--time-offset", "fit", "--json", "--force") == 0
        err = capsys.readouterr().err
        assert f"push.bag: time offset -0.020 s, sigma {sigma:.3f} s, from the start of 2 contacts" in err
        times = (formats.read("runs/push/estimates.csv").time * 1e9).astype(np.int64)  # pyright: ignore
        used = seconds if sigma < 0.01 else 0.0
        assert ("not significantly different from 0" in err) == (used == 0.0)
        assert abs(times[0] - image_times()[0] - used * 1e9) < 1000
    line = failure(capsys, "convert", "push.bag", "a.mcap", "--shape", "disc", "--time-offset", "fit")
    assert "--time-offset fit: only for palpate track" in line


def test_what_is_said_of_bags_in_vain(capsys):
    assert "tell no outline of the object; palpate track and convert take it by --shape" in failure(
        capsys, "track", "push.bag"
    )
    assert "push.mcap is no bag" in failure(capsys, "track", "push.mcap", "--shape", "disc")
    line = failure(capsys, "track", "push.mcap", "--time-offset", "-0.1", "--plane", "fit")
    assert "--time-offset, --plane: only for bags, together with --shape" in line
    assert "shape is 'potato'" in failure(capsys, "track", "push.bag", "--shape", "potato")
    Path("box.csv").write_text("0 0\n90 0\n90 60\n0 60\n")
    assert "are these millimetres" in failure(capsys, "track", "push.bag", "--shape", "box.csv")
    assert "are these millimetres" in failure(capsys, "convert", "push.bag", "a.mcap", "--shape", "90x60")
    assert "--first-pose X Y THETA" in failure(capsys, "track", "push.bag", "--shape", "disc")
    assert "mm off the plane" in failure(capsys, *TRACK, "--plane", "0", "-1", "0")
    assert not Path("runs").exists()


def test_convert_names_what_would_be_lost(capsys):
    line = failure(capsys, "convert", "push.mcap", "push.tum")
    assert "push.tum would lack sensor poses, outline and sensor, contact flags; --lossy" in line
    line = failure(capsys, "convert", "push.bag", "bag.mcap", "--shape", "disc")
    assert "bag.mcap would lack poses between images, heights and tilts, topic /chatter; --lossy" in line
    assert not Path("push.tum").exists() and not Path("bag.mcap").exists()
    assert palpate("convert", "push.bag", "box.mcap", "--shape", "90x60", "--shape-unit", "mm", "--lossy") == 0
    assert formats.load_recording("box.mcap").shape == Rectangle(0.09, 0.06)
    assert palpate("convert", "push.bag", "bag.mcap", "--shape", "disc", "--lossy") == 0
    found: Any = formats.read("bag.mcap")
    assert se2.between(found.sensor_pose, true_pose(image_times())) == pytest.approx(0.0, abs=1e-9)


def test_messages_of_a_run_hold_its_answers():
    """Where the first pose is known roughly, a contact begins with several."""
    roughly = ("--first-pose-sigma", "0.02", "0.02", "0.3")
    assert palpate("track", "push.mcap", *roughly, "--tactile", "none", "--mcap") == 0
    online = estimates_csv.read(Path("runs/push/estimates.csv"))
    answers = details.read_answers(Path("runs/push/answers.csv"), online.time)
    with AnyReader([Path("runs/push/estimates.mcap")]) as bag:  # none of our code
        arrays: list[Any] = [
            bag.deserialize(data, connection.msgtype)
            for connection, _, data in bag.messages()
            if connection.topic == "/palpate/object_pose_answers"
        ]
    found = [[(one.position.x, one.position.y) for one in array.poses] for array in arrays]
    assert len(found) == len(online)
    for places, several, pose in zip(found, answers, online.pose, strict=True):
        assert np.allclose(places, [one.pose[:2] for one in several] or [pose[:2]], atol=1e-12)
    assert {len(places) > 1 for places in found} == {True, False}


def test_convert_to_mcap_and_back_is_the_same_file(capsys):
    write_recording(tiny_recording(), "tiny.mcap")
    assert palpate("convert", "tiny.mcap", "back.mcap") == 0
    assert Path("back.mcap").read_bytes() == Path("tiny.mcap").read_bytes()
    capsys.readouterr()
    assert palpate("info", "tiny.mcap", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["format"], found["frames"], found["shape"]["type"]) == ("palpate", 5, "disc")
