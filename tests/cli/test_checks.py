"""Checks of recordings by `palpate info --json`: everything that can be wrong with one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from recording_samples import pushed, seen

import palpate

pytestmark = pytest.mark.usefixtures("folder")

SIZE, STEP = 0.09, 1e-3
Check = Callable[..., Any]


def push(n: int = 90, **changes: Any) -> Any:
    """Return a point pushing a square at 1 mm a frame along x, 30 Hz, in contact throughout."""
    tip: Any = np.column_stack([np.arange(n) * STEP, np.zeros((n, 2))])
    truth = tip + np.array([SIZE / 2, 0.0, 0.0])
    shape = palpate.Rectangle(SIZE, SIZE)
    return replace(palpate.Recording(np.arange(n) / 30, tip, shape, palpate.POINT, truth, np.ones(n, bool)), **changes)


@pytest.fixture
def check(json_of) -> Check:
    """Write a recording and return what `palpate info --json` shows."""

    def run(recording: Any) -> Any:
        palpate.write_recording(recording, "checked.mcap", overwrite=True)
        return json_of("info", "checked.mcap")

    return run


def kinds(found: Any) -> list[str]:
    return [finding["kind"] for finding in found["findings"]]


def test_a_clean_push_has_no_findings(check):
    found = check(push())
    assert found["findings"] == []
    assert (found["frames"], found["images"], found["image_size"]) == (90, 0, None)
    assert (found["rate_hz"], found["duration_s"]) == (pytest.approx(30.0), pytest.approx(89 / 30))
    assert (found["contact_share"], found["truth_share"]) == (1.0, 1.0)
    assert [(each["start_s"], each["end_s"]) for each in found["contacts"]] == [(0.0, pytest.approx(89 / 30))]


def test_recordings_with_less(check):
    found = check(push(object_pose=None, contact=None))
    assert (found["contact_share"], found["truth_share"], found["findings"]) == (None, 0.0, [])
    found = check(push(1))
    assert (found["rate_hz"], found["duration_s"]) == (None, 0.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sensor_pose": push().sensor_pose * [1e3, 1e3, 1.0]}, "sensor_pose: found positions that span 89 m"),
        ({"shape": palpate.Rectangle(90.0, 60.0)}, "the outline is 90 m wide"),
        ({"time": push().time * 1e3}, "frames come at 0.03 Hz, the sensor profile says 30.0 Hz: are these milli"),
    ],
)
def test_implausible_units(check, changes, words):
    sentences = [each["sentence"] for each in check(push(object_pose=None, contact=None, **changes))["findings"]]
    assert any(sentence.startswith(words) and "are these milli" in sentence for sentence in sentences)


def test_time_gaps(check):
    late = push().time + 0.5 * (np.arange(90) >= 30)
    found = check(push(time=late))
    (gap,) = found["findings"]
    assert gap["kind"] == "time gap" and "0.53 s" in gap["sentence"]
    assert kinds(check(push(time=late, contact=np.zeros(90, bool), object_pose=None))) == ["time gap"]


def test_rates(check):
    (finding,) = check(push(time=push().time * 2))["findings"]
    assert finding["sentence"] == "frames come at 15 Hz, the sensor profile says 30.0 Hz"


def test_damaged_images(check):
    good, wide = (cv2.imencode(".png", np.zeros((8, width, 3), np.uint8))[1].tobytes() for width in (6, 8))
    sensor = palpate.SensorProfile("camera", radius=0.0, image_height=8, image_width=6)
    found = check(push(5, sensor=sensor, image=(good, good, b"", wide, good)))
    assert (found["images"], found["image_size"], kinds(found)) == (4, [8, 6], ["image", "image"])
    assert [f"frame {k}" in each["sentence"] for k, each in zip((2, 3), found["findings"], strict=True)] == [True, True]


def test_real_pushes_by_two_fingers(json_of, shared_data: Path):
    fingers = [json_of("info", file) for file in sorted((shared_data / "cmu_two_finger").glob("*.txt"))]
    assert all("time gap" in kinds(each) for each in fingers)


def test_poses_of_something_else_are_told(check):
    seen_push = seen(pushed(60))
    still = np.repeat(seen_push.sensor_pose[:1], len(seen_push), axis=0)
    untouched = (seen_push.image[0],) * len(seen_push)
    for change, words in (
        ({"sensor_pose": still}, "does not change"),
        ({}, "moves along -x of its own frame"),
        ({"image": untouched, "contact": None}, "show no touch"),
    ):
        findings = check(replace(seen_push, **change))["findings"]
        assert [words in each["sentence"] for each in findings if each["kind"] == "mismatch"] == [True]


def test_warnings_of_an_import_are_repeated(check):
    (finding,) = check(replace(push(), warnings=("two of 40 poses are unknown",)))["findings"]
    assert (finding["kind"], finding["sentence"]) == ("import", "two of 40 poses are unknown")
