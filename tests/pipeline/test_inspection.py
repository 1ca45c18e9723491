import dataclasses
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate import io as formats
from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle
from palpate.pipeline.check_recording import LIMITS, Finding, counted, inspect_recording
from palpate.pipeline.truth import trusted_truth
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import POINT, SensorProfile

SIZE = 0.09
STEP = 1e-3


def push(n: int = 90) -> Any:
    """Return a point pushing a square at 1 mm a frame along x, 30 Hz, in contact throughout."""
    tip: Any = np.column_stack([np.arange(n) * STEP, np.zeros((n, 2))])
    truth = tip + np.array([SIZE / 2, 0.0, 0.0])
    contact = np.ones(n, np.bool_)
    return Recording(np.arange(n) / 30, tip, Rectangle(SIZE, SIZE), POINT, truth, contact)


def changed(recording: Any, **fields: Any) -> Any:
    return dataclasses.replace(recording, **fields)


def kinds(recording: Any) -> list[str]:
    return [finding.kind for finding in inspect_recording(recording).findings]


def with_truth(move: Any) -> Any:
    """Return the push with `move` applied to a copy of its ground truth."""
    recording = push()
    truth = recording.object_pose.copy()
    move(truth)
    return changed(recording, object_pose=truth)


def test_a_clean_push_has_no_findings():
    found = inspect_recording(push())
    assert found.findings == ()
    assert found.unbroken and not found.knocked
    assert (found.frames, found.contact, found.images, found.image_size) == (90, "measured", 0, None)
    assert found.rate == pytest.approx(30.0)
    assert found.jitter == pytest.approx(0.0, abs=1e-9)
    assert found.duration == pytest.approx(89 / 30)
    assert (found.contact_share, found.truth_share) == (1.0, 1.0)
    assert [(c.start, c.end) for c in found.contacts] == [(0.0, pytest.approx(89 / 30))]
    assert "unbroken" in found.verdict


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sensor_pose": push().sensor_pose * [1e3, 1e3, 1.0]}, "sensor_pose: found positions that span 89 m"),
        ({"shape": Rectangle(90.0, 60.0)}, "the outline is 90 m wide"),
        (
            {"time": push().time * 1e3},
            "frames come at 0.03 Hz, the sensor profile says 30.0 Hz: are these milliseconds?",
        ),
    ],
)
def test_a_recording_in_another_unit_is_told(changes, words):
    found = inspect_recording(changed(push(), object_pose=None, contact=None, **changes)).findings
    assert any(finding.sentence.startswith(words) and "are these milli" in finding.sentence for finding in found)


def test_a_recording_of_poses_alone_can_be_inspected():
    found = inspect_recording(changed(push(), object_pose=None, contact=None))
    assert (found.contact, found.contact_share, found.truth_share, found.findings) == (
        "absent",
        None,
        0.0,
        (),
    )
    assert "nothing to judge" in found.verdict


def test_a_single_frame_can_be_inspected():
    found = inspect_recording(push(1))
    assert (found.rate, found.jitter, found.duration) == (None, None, 0.0)


def test_derived_contact_is_said():
    assert inspect_recording(changed(push(), contact_derived=True)).contact == "derived"


def test_drop_out_in_the_middle_breaks():
    def move(truth):
        truth[40:45] = np.nan
        truth[47] = np.nan

    found = inspect_recording(with_truth(move))
    assert [(f.kind, f.start, f.end) for f in found.findings] == [
        ("drop-out", pytest.approx(40 / 30), pytest.approx(47 / 30))
    ]
    assert "6 frames" in found.findings[0].sentence
    assert not found.unbroken
    assert found.truth_share == pytest.approx(84 / 90)


def test_drop_out_at_the_ends_does_not_break():
    def move(truth):
        truth[:3] = np.nan
        truth[-4:] = np.nan

    found = inspect_recording(with_truth(move))
    assert [f.kind for f in found.findings] == ["drop-out", "drop-out"]
    assert found.unbroken


def test_a_spike_is_a_jump_and_is_not_trusted():
    def move(truth):
        truth[50, 1] += 0.02

    recording = with_truth(move)
    found = inspect_recording(recording)
    assert {f.kind for f in found.findings} == {"jump"}
    assert not found.unbroken
    assert np.flatnonzero(~trusted_truth(recording)).tolist() == [50]


def test_a_step_between_two_frames_is_a_jump_that_stays():
    def move(truth):
        truth[50:, 1] += 0.02

    found = inspect_recording(with_truth(move))
    assert [f.kind for f in found.findings] == ["jump"]
    assert not found.unbroken


def test_a_shove_over_some_frames_is_a_knock_and_breaks_nothing():
    def move(truth):
        truth[50:, 1] += np.minimum(np.arange(40) * 0.006, 0.024)

    found = inspect_recording(with_truth(move))
    assert [f.kind for f in found.findings] == ["knock"]
    # 6 mm sideways and 1 mm on for each of 4 frames: sqrt(24^2 + 4^2) = 24.3 mm.
    assert "24.3 mm" in found.findings[0].sentence
    assert "sensor moves 4.0 mm" in found.findings[0].sentence
    assert (found.findings[0].start, found.findings[0].end) == (
        pytest.approx(50 / 30),
        pytest.approx(54 / 30),
    )
    assert found.unbroken and found.knocked


def test_a_turn_about_the_contact_is_a_knock_too():
    def move(truth):
        # 5 degrees a frame about the contact, 4 times: the contact stays, the far corner goes 9 mm each time.
        for index in range(50, 90):
            turn = np.radians(5.0) * min(index - 49, 4)
            tip = np.array([index * STEP, 0.0, turn])
            truth[index] = se2.compose(tip, np.array([SIZE / 2, 0.0, 0.0]))

    assert kinds(with_truth(move)) == ["knock"]


@pytest.mark.parametrize("seed", range(8))
def test_noise_of_the_capture_is_no_knock(seed):
    # Slower than the noise: 0.2 mm a frame, a capture with 0.4 mm and 0.35 degrees, and a hand at the end.
    recording = push()
    noise = np.random.default_rng(seed).normal(size=(90, 3)) * [4e-4, 4e-4, np.radians(0.35)]
    slow = changed(
        recording,
        sensor_pose=0.2 * recording.sensor_pose,
        object_pose=0.2 * recording.sensor_pose + [SIZE / 2, 0.0, 0.0] + noise,
    )
    assert kinds(slow) == []
    shoved = slow.object_pose + np.clip(np.arange(90) - 70, 0, 4)[:, None] * [0.0, 0.006, 0.0]
    assert kinds(changed(slow, object_pose=shoved)) == ["knock"]


def test_sliding_and_turning_as_a_push_does_is_no_knock():
    # Pushed without friction at offset c from the centre, the far corner moves 1.4 times as fast as the tip:
    # v = c^2 / (c^2 + d^2) = 1/2 and omega = d / (c^2 + d^2) = 1 / (2 c) for a normal speed of 1.
    n, c = 30, Rectangle(SIZE, SIZE).friction_radius()
    recording = push(n)
    s = np.arange(n) * STEP
    truth = np.column_stack([SIZE / 2 + s / 2, np.full(n, c), s / (2 * c)])
    assert "knock" not in kinds(changed(recording, object_pose=truth))


def test_contact_lost_and_found():
    recording = push()
    contact = recording.contact.copy()
    contact[40:50] = False
    found = inspect_recording(changed(recording, contact=contact))
    # The truth of `push` goes on meanwhile, 10 frames of 1 mm.
    assert [f.kind for f in found.findings] == ["contact lost", "untouched motion"]
    assert not found.unbroken
    assert len(found.contacts) == 2
    assert found.contacts[0].end == pytest.approx(39 / 30)
    assert found.contacts[1].start == pytest.approx(50 / 30)


def lifted(retreat: float, frames: int, numbers: bool = False) -> Any:
    """Return a push in which the tip leaves for some frames, going back by `retreat`, and comes again."""
    recording = push()
    end = 40 + frames
    sensor, truth, contact = (
        recording.sensor_pose.copy(),
        recording.object_pose.copy(),
        recording.contact.copy(),
    )
    contact[40:end] = False
    sensor[40:end, 0] = sensor[39, 0] - retreat
    sensor[end:, 0] = sensor[39, 0] + np.arange(90 - end) * STEP
    truth[40:, 0] = sensor[40:, 0] + SIZE / 2
    truth[40:end, 0] = truth[39, 0]
    episode = np.where(contact, (np.arange(90) >= end).astype(np.int64), -1) if numbers else None
    return changed(recording, sensor_pose=sensor, object_pose=truth, contact=contact, episode=episode)


def test_letting_go_is_not_losing_contact():
    assert kinds(lifted(0.005, 10)) == []
    assert kinds(lifted(0.0, 10)) == ["contact lost"]
    assert kinds(lifted(0.0, 35)) == []
    assert kinds(lifted(0.0, 10, numbers=True)) == []


def test_an_episode_number_ends_a_contact():
    recording = push()
    found = inspect_recording(changed(recording, episode=(np.arange(90) >= 45).astype(np.int64)))
    assert [(c.start, c.end) for c in found.contacts] == [
        (0.0, pytest.approx(44 / 30)),
        (pytest.approx(45 / 30), pytest.approx(89 / 30)),
    ]


def test_untouched_motion():
    recording = lifted(0.005, 20)
    truth = recording.object_pose.copy()
    truth[45:, 1] += 0.004
    found = inspect_recording(changed(recording, object_pose=truth))
    assert [f.kind for f in found.findings] == ["untouched motion"]
    assert "4.0 mm" in found.findings[0].sentence and "nothing touches it" in found.findings[0].sentence
    assert not found.unbroken


def test_time_gap():
    recording = push()
    time = recording.time + 0.5 * (np.arange(90) >= 30)
    found = inspect_recording(changed(recording, time=time))
    assert [(f.kind, f.start, f.end) for f in found.findings] == [
        ("time gap", pytest.approx(29 / 30), pytest.approx(1.5))
    ]
    assert not found.unbroken  # during contact
    assert found.jitter == pytest.approx(0.0, abs=1e-9)
    untouched = changed(recording, time=time, contact=np.zeros(90, np.bool_), object_pose=None)
    assert kinds(untouched) == ["time gap"]
    assert inspect_recording(untouched).unbroken


def test_another_rate_than_the_sensor_says():
    recording = push()
    found = inspect_recording(changed(recording, time=recording.time * 2))
    assert [f.sentence for f in found.findings] == ["frames come at 15 Hz, the sensor profile says 30.0 Hz"]
    assert found.unbroken


def test_frames_that_come_more_often_than_serves():
    recording = push()
    often = changed(recording, time=recording.time / 4.0, sensor=replace(recording.sensor, rate=120.0))
    assert [finding.sentence for finding in inspect_recording(often).findings] == [
        "frames come 120 times a second; the pose is known better from one in 2 of them"
    ]
    assert inspect_recording(often).unbroken


@pytest.mark.parametrize(("shift", "kind"), [(0.003, "overlap"), (-0.003, "stand-off")])
def test_sensor_off_the_outline(shift, kind):
    recording = push()
    sensor = recording.sensor_pose + np.array([shift, 0.0, 0.0])
    found = inspect_recording(changed(recording, sensor_pose=sensor))
    assert [f.kind for f in found.findings] == [kind]
    assert "3.0 mm" in found.findings[0].sentence
    assert found.unbroken


def test_damaged_images_are_named():
    sensor = SensorProfile("camera", radius=0.0, image_height=8, image_width=6)
    good = encode_image(np.zeros((8, 6, 3), np.uint8))
    images = [good] * 5
    images[2] = b""
    images[3] = encode_image(np.zeros((8, 8, 3), np.uint8))
    found = inspect_recording(changed(push(5), sensor=sensor, image=tuple(images)))
    assert (found.images, found.image_size) == (4, (8, 6))
    assert [f.kind for f in found.findings] == ["image", "image"]
    assert "frame 2" in found.findings[0].sentence and "frame 3" in found.findings[1].sentence


def test_what_is_found_again_and_again_is_counted():
    one = Finding("image", 1.0, 1.0, "image of frame 30: is damaged")
    images = [replace(one, start=k / 30, end=k / 30, sentence=f"image of frame {k}: is damaged") for k in range(2, 90)]
    gaps = [Finding("time gap", float(k), k + 0.5, "no frames for 0.50 s", breaks=k == 2) for k in range(LIMITS.listed)]
    found = sorted([*images, *gaps], key=lambda finding: finding.start)
    told = counted(found)
    # Of LIMITS.listed gaps each is told, of 88 images one sentence, in order of time.
    assert [finding.kind for finding in told] == ["time gap", "image", *["time gap"] * (LIMITS.listed - 1)]
    assert told[1] == Finding("image", 2 / 30, 89 / 30, "88 times; first: image of frame 2: is damaged")
    assert [finding for finding in told if finding.kind == "time gap"] == gaps
    (more,) = counted([*gaps, Finding("time gap", 9.0, 9.5, "no frames for 0.50 s")])
    assert more == Finding("time gap", 0.0, 9.5, "6 times; first: no frames for 0.50 s", breaks=True)


def test_inspection_is_plain_json():
    data = json.loads(json.dumps(inspect_recording(lifted(0.0, 10)).to_dict()))
    assert data["findings"][0]["kind"] == "contact lost"


def test_inspection_of_an_inner_drop_out_is_plain_json():
    def move(truth):
        truth[40:50] = np.nan

    data = json.loads(json.dumps(inspect_recording(with_truth(move)).to_dict()))
    assert [(finding["kind"], finding["breaks"]) for finding in data["findings"]] == [("drop-out", True)]


def test_real_runs_with_hands_and_drop_outs_are_told_apart(shared_data):
    files = sorted((shared_data / "mit_point_push").glob("*.json.gz"))
    found = {file.name: inspect_recording(formats.load_recording(file)) for file in files}
    # Motion capture loses the object for up to 5.6 s, or the hand throws it off the tip.
    broken = {name for name, inspection in found.items() if not inspection.unbroken}
    assert broken == {
        "StraightLineBigPertubations.json.gz",
        "StraightLineBigPertubations3.json.gz",
        "StraightLinePertubations.json.gz",
        "StraightLine_2016_10_23_DoublesBigPerturbations.json.gz",
        "StraightLine_2016_10_23_NoPerturbations.json.gz",
    }
    knocks = {
        name: sum(finding.kind == "knock" for finding in inspection.findings)
        for name, inspection in found.items()
        if inspection.unbroken
    }
    assert knocks == {
        "StraightLineBigPertubations5.json.gz": 0,
        "StraightLine_2016_10_23_NoPerturbationsBlackDark.json.gz": 0,
        "StraightLine_2016_10_23_SinglePerturbationsBlack.json.gz": 1,
        "StraightLine_2016_10_23_StraightLineDoublePerturbationsPlywoodNoLighting.json.gz": 2,
        "StraightLine_2016_10_23_StraightLineNoPerturbationsPlywoodNoLighting.json.gz": 0,
        "StraightLine_2016_10_23_StraightLineOpenLoopAmbientLight.json.gz": 2,
    }


def test_camera_noise_of_real_logs_is_no_knock(shared_data):
    files = sorted((shared_data / "cmu_two_finger").glob("*.txt"))
    found = [inspect_recording(formats.load_recording(file)) for file in files]
    assert not any(inspection.knocked for inspection in found)
    assert all(any(f.kind == "time gap" for f in inspection.findings) for inspection in found)
