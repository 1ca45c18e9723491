"""Touch that is recorded once and tracked again: the same estimates as of the images."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate import Calibration, Recording, Run, TrackerSettings, track
from palpate.geometry.shapes import SHAPES
from palpate.lab.simulate.recordings import simulate_recording
from palpate.lab.tune.recorded_touch import RecordedTouch, record_touch, track_recorded
from palpate.touch.background import background_of
from palpate.touch.calibration import CameraView, DirectionCorrection
from palpate.types.images import encode_image

Tactile = Any


@pytest.fixture(scope="module")
def seen() -> Recording:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")
    recording = simulate_recording(SHAPES["disc"], "disc", 3, 4.0)
    return replace(recording, contact=np.zeros(len(recording), np.bool_))


@pytest.mark.parametrize("tactile", ["learnt", "none"])
def test_what_images_say_is_said_again_without_them(seen, tactile: Tactile):
    recorded, _ = both_ways(seen, tactile)
    assert recorded.recording.image is None and (recorded.measurements is None) == (tactile == "none")


def test_a_frame_that_is_refused_is_left_out(seen):
    touched = begun_at(seen)
    poses = seen.sensor_pose.copy()
    poses[touched + 20] += (0.0, 0.3, 0.0)
    _, run = both_ways(replace(seen, sensor_pose=poses), "learnt")
    assert (run.online.status or ())[touched + 20] == "faulty"


def test_a_recording_that_begins_in_contact_is_felt_with_the_gel_after_it(seen):
    touched = begun_at(seen)
    order = [*range(touched + 3, len(seen)), *range(len(seen) - 2, len(seen) - 22, -1)]  # to rest for longer
    late = replace(
        seen,
        time=seen.time[0] + np.arange(len(order)) / 30,
        sensor_pose=seen.sensor_pose[order],
        object_pose=seen.object_pose[order],
        contact=np.zeros(len(order), np.bool_),
        image=tuple(seen.image[index] for index in order),
        first_pose=None,
        first_pose_sigma=None,
        extra={},
    )
    _, run = both_ways(late, "learnt")
    assert any("untouched gel is taken" in each for each in run.summary["warnings"])


def test_what_is_known_of_the_unit_is_known_again(seen):
    images = [np.asarray(frame.image)[::-1, ::-1] for frame in seen]
    told = DirectionCorrection(0.05, 0.9, 0.01, 0.02)
    unit = Calibration(background_of(image[::-1, ::-1] for image in images[:15]), CameraView(2), told)
    turned = replace(seen, image=tuple(encode_image(np.ascontiguousarray(image), "png") for image in images))
    recorded, run = both_ways(turned, "learnt", unit)
    assert recorded.correction == told and run.calibration is unit


def begun_at(recording: Recording) -> int:
    """The first frame of which images show a contact."""
    return int(np.argmax(np.asarray(track(recording).online.contact)))


def both_ways(
    recording: Recording, tactile: Tactile, calibration: Calibration | None = None
) -> tuple[RecordedTouch, Run]:
    """Record touch and track by it, and track as `palpate track` does: the same comes of both."""
    settings = TrackerSettings(tactile=tactile)
    recorded = record_touch(recording, tactile, calibration=calibration)
    run, online = track(recording, settings, calibration=calibration), track_recorded(recorded, settings)
    assert online.contact is not None and online.contact.any()
    assert np.array_equal(online.contact, run.online.contact)  # pyright: ignore[reportArgumentType]
    assert np.array_equal(online.pose, run.online.pose)
    assert np.array_equal(online.covariance, run.online.covariance)  # pyright: ignore[reportArgumentType]
    assert online.status == run.online.status
    return recorded, run
