"""The examples, each run as a script on little data."""

import re
import runpy
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from recording_samples import pushed
from view_samples import imaged_push

from palpate import TouchModel, load_recording, write_recording

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def example(capsys, monkeypatch) -> Any:
    """What an example prints, in lines."""

    def run(name: str, *words: object) -> list[str]:
        monkeypatch.setattr(sys, "argv", [name, *map(str, words)])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out.splitlines()

    return run


def numbers(line: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.\d+", line)]


def test_track_a_recording(example, tmp_path):
    push = pushed()
    write_recording(replace(push, first_pose=push.object_pose[0]), tmp_path / "push.mcap")
    *said, pose, sigma, off = example("01_track_a_recording.py", tmp_path / "push.mcap")
    assert [line.split()[:3] for line in said][:2] == [["0.00", "s:", "resting"], ["0.17", "s:", "tracking"]]
    assert len(numbers(pose)) == len(numbers(sigma)) == 3
    assert off == f"{numbers(off)[0]:.1f} mm from the ground truth"


def test_own_arrays(example, tmp_path):
    frames, moved = example("02_own_arrays.py", tmp_path)
    assert frames == "95 frames, 49 in contact"
    found, true = numbers(moved)
    assert true > 30.0 and abs(found - true) < 1.5
    assert len(load_recording(tmp_path / "push.mcap")) == 95


def test_own_outline(example, tmp_path):
    drawn, typed, scanned, box = (line.split(": ")[1] for line in example("04_own_outline.py", tmp_path))
    assert drawn.replace("-0.0", "0.0") == "34.75 cm2, centroid at x 0.0 mm, y 0.0 mm"
    assert typed == "34.75 cm2, centroid at x 35.3 mm, y 23.1 mm"
    assert abs(numbers(scanned)[0] - 34.75) < 0.1 and box.startswith("54.00 cm2")
    assert (tmp_path / "outlines.png").stat().st_size > 0


def test_a_live_loop(example, tmp_path):
    write_recording(imaged_push(), tmp_path / "push.mcap")
    *said, counts = example("03_live_loop.py", tmp_path / "push.mcap", 20)
    # A line a second: frames 0 and 30, in the middle of the push.
    assert [line.split()[0] for line in said] == ["free", "touching"]
    assert abs(numbers(said[-1])[0] - 322.0) < 10.0  # the object is at 300 mm and was pushed for 22 mm
    assert counts.startswith("50 frames, 0 left out; a step took ")


def test_a_sensor_of_ones_own(example):
    contact, moved = example("05_own_sensor.py")
    assert contact == "my gel: contact in 60 frames, 100% of all told right"
    found, truth = numbers(moved)
    assert truth == 40.0 and abs(found - truth) < 2.0


def test_a_camera_puts_a_wrong_pose_right(example):
    lines = example("06_camera_opinion.py")
    errors = {line.split(":")[0]: numbers(line) for line in lines}
    assert list(errors) == ["first pose", "tag seen", "and pushed"]
    assert errors["first pose"] == [20.0, 5.0]
    assert errors["tag seen"][0] < 8.0  # the tag is 54 mm from the centre, and nothing tells the yaw
    assert errors["and pushed"][0] < 1.5
    assert errors["and pushed"][1] < 1.0


def test_train_on_your_data(example, tmp_path, monkeypatch):
    pytest.importorskip("torch", reason="torch is not installed: pip install 'palpate-lab[train]'")
    from training_samples import DISC, RECTANGLE, pushes

    network = TouchModel(EXAMPLES.parent / "src/palpate/data/digit").network  # to export takes a minute
    monkeypatch.setattr("palpate_lab.train.train.exported", lambda *_: network)
    write_recording(pushes(DISC, 3), tmp_path / "push-0.mcap")
    write_recording(pushes(RECTANGLE, 2), tmp_path / "push-1.mcap")
    write_recording(pushed(), tmp_path / "bare.mcap")
    said = example("07_train_on_your_data.py", tmp_path, tmp_path / "model", 1)
    assert "touch, 1 to do" in said
    assert f"left out: {tmp_path / 'bare.mcap'}: has no image; learning needs them" in said
    assert [line.split(":")[0] for line in said[-3:]] == ["direction", "turn", "push-1.mcap"]


def test_a_study_on_a_cluster(example, tmp_path):
    pytest.importorskip("distributed", reason="not installed: pip install 'palpate-lab[cluster]'")
    for number in range(2):
        write_recording(pushed(20 + number), tmp_path / f"disc-{number}.mcap")
    counts, *table = example("08_study_on_a_cluster.py", tmp_path, tmp_path / "report")
    assert counts == "4 runs of 2 recordings, 0 of them from before"
    assert [line.split(":")[0] for line in table] == ["none", "oracle"]


def test_a_new_factor(example, tmp_path):
    (line,) = example("09_new_factor.py", tmp_path)
    mean, deviation = numbers(line)
    assert abs(mean - 0.4) < 3.0 * deviation and deviation < 0.05  # half of the prior's is 0.1
