"""The node between two processes of a real ROS 2, in an environment of its own that `make ros-test` makes."""

import json
import os
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import planar
import pytest
from recording_samples import encoded

from palpate import DIGIT, Frame, Recording, Tracker, TrackerSettings, load_shape, write_recording

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / ".venv-ros" / "bin" / "python"
FRAMES = int(os.environ.get("PALPATE_ROS_FRAMES", "90"))
SHAPE = load_shape("rectangle")
FIRST = (0.3, 0.05, 0.4)
PATIENCE = 120.0  # [s]
ALIKE = 8.0  # [s] until which poses that messages round make the same estimates; physics knows no push like this one

needs_rclpy = pytest.mark.skipif(
    not PYTHON.exists(), reason="no rclpy to test the ROS 2 node with: `make ros-test` makes .venv-ros, which has it"
)


def push(path: Path) -> Recording:
    """A rectangle that is pushed aslant for half of each two seconds, in images that a DIGIT could give."""
    time = np.arange(FRAMES) / 60.0
    touching = time % 2.0 > 0.6
    moved = 0.0005 * np.cumsum(touching)
    truth: Any = np.column_stack([FIRST[0] + moved * np.cos(0.4), FIRST[1] + moved * np.sin(0.4), 0.4 + 0.0 * moved])
    away = np.where(touching, 0.0, -0.02)
    sensor: Any = planar.compose(truth, np.column_stack([away - 0.11815, 0.005 + 0.0 * away, 0.0 * away]))
    row, column = np.mgrid[0:320, 0:240]
    gels = np.random.default_rng(1).normal(90.0, 3.0, (4, 320, 240, 3))  # no camera says the same twice
    mark = 60.0 * np.exp(-(((row - 160) / 90) ** 4) - ((column - 130) / 25) ** 2)[:, :, None]
    free, pressed = ([encoded(image.clip(0, 255).astype(np.uint8)) for image in gels + more] for more in (0.0, mark))
    images = tuple((pressed if touch else free)[index % len(gels)] for index, touch in enumerate(touching))
    recording = Recording(time, sensor, SHAPE, DIGIT, image=images)
    write_recording(recording, path)
    return recording


def environment() -> dict[str, str]:
    """ROS on the loopback address alone, apart from any other on this machine."""
    domain = str(1 + os.getpid() % 100)
    profile = str(Path(__file__).with_name("loopback.xml"))
    return {
        **os.environ,
        "ROS_DOMAIN_ID": domain,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "FASTDDS_DEFAULT_PROFILES_FILE": profile,
    }


@contextmanager
def node(*given: str) -> Iterator[subprocess.Popen[str]]:
    command = [str(PYTHON), "-m", "palpate.ros2", "--ros-args", *given]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment())
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@needs_rclpy
def test_two_processes_at_60_hz(tmp_path):
    recording = push(tmp_path / "push.mcap")
    parameters = "-p shape:=rectangle -p first_pose:=[0.3,0.05,0.4] -p tactile:=none"
    remapped = "-r image:=/digit/image_raw -r sensor_pose:=/robot/sensor_pose"
    played, heard = tmp_path / "push.mcap", tmp_path / "heard"
    robot = [str(PYTHON), str(Path(__file__).with_name("robot.py")), str(played), str(heard)]
    with node(*parameters.split(), *remapped.split()) as process:
        subprocess.run(robot, check=True, env=environment(), timeout=PATIENCE + FRAMES / 60)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, said
    heard = json.loads((tmp_path / "heard").read_text())
    check_counts(heard, said)
    check_estimates(heard, recording)


def check_counts(heard: dict[str, Any], said: str) -> None:
    """No image is lost but those that the node counts; `before` are its counts when the push begins."""
    counted = re.search(r"(\d+) images, (\d+) tracked, (\d+) dropped, (\d+) without pose", said)
    assert counted, said
    images, tracked, dropped, unplaced = map(int, counted.groups())
    before = heard["before"][0][3]
    assert images - int(before["images"]) == FRAMES
    assert tracked + dropped + unplaced == images
    assert str(unplaced) == before["without pose"]
    assert [len(heard[name]) for name in ("poses", "diagnoses")] == [tracked] * 2


def check_estimates(heard: dict[str, Any], recording: Recording) -> None:
    """Estimates are those of a direct run on the same frames, their covariances about the axes of the header."""
    published = dict(heard["published"])
    tracker = Tracker(SHAPE, DIGIT, FIRST, TrackerSettings("none"))
    turned_by = 0.0
    contacts = []
    for (stamp, frame, pose, covariance), (at, level, status, values) in zip(
        heard["poses"], heard["diagnoses"], strict=True
    ):
        index = published[stamp]
        time = (stamp - heard["poses"][0][0]) * 1e-9
        if time > ALIKE:
            break
        direct = tracker.update(Frame(time, recording.sensor_pose[index], recording[index].image))
        x, y, z, qx, qy, qz, qw = pose
        yaw = 2.0 * np.arctan2(qz, qw)
        assert (frame, at, z, qx, qy) == ("base", stamp, 0.25, 0.0, 0.0)
        assert planar.between(direct.pose, np.array([x, y, yaw])) == pytest.approx([0.0, 0.0, 0.0], abs=1e-5)
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        expected = np.zeros((6, 6))
        expected[np.ix_((0, 1, 5), (0, 1, 5))] = turn @ direct.covariance @ turn.T
        assert np.reshape(covariance, (6, 6)) == pytest.approx(expected, rel=1e-3, abs=1e-10)
        assert (status, values["contact"]) == (direct.status, str(direct.contact).lower())
        contacts.append(direct.contact)
        assert level in (0, 1, 2)
        turned_by = max(turned_by, abs(expected[0, 1]) / np.sqrt(expected[0, 0] * expected[1, 1]))
    assert any(contacts) and not all(contacts)
    assert turned_by > 0.1  # else a covariance that is not turned would look the same


@needs_rclpy
@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ((), "the object is not known: the parameters shape and first_pose say it"),
        (("-p", "shape:=disc", "-p", "first_pose:=[0.1, 0.0]"), "first pose is [0.1, 0.0]; it must be three finite"),
    ],
)
def test_what_a_node_is_not_told(given, expected):
    with node(*given) as process:
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2 and expected in said and "Traceback" not in said
