"""What is recorded once and said again."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from palpate.graph.fixed_lag import FixedLag
from push_samples import with_settings
from recording_samples import pushed

from palpate.config import TrackerSettings
from palpate.errors import EstimationError, FileError
from palpate.geometry.objects import SHAPES
from palpate.io.recording_mcap import write_recording
from palpate.lab.simulate.recordings import simulate_recording
from palpate.lab.tune.recorded_touch import (
    RecordedTouch,
    _Remembered,
    record_touch,
    record_touch_of_files,
    track_recorded,
)
from palpate.pipeline.track import Run, track
from palpate.touch.background import background_of
from palpate.touch.calibration import Calibration, DirectionCorrection
from palpate.touch.camera_view import CameraView
from palpate.types.images import encode_image
from palpate.types.measurements import Measurement, RelativePoses
from palpate.types.recording import Recording
from palpate.types.trajectory import Trajectory

Tactile = Any


@pytest.fixture(scope="module")
def seen() -> Recording:
    """A push with images and wrong flags."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")
    recording = simulate_recording(SHAPES["disc"], "disc", 3, 4.0)
    return replace(recording, contact=np.zeros(len(recording), np.bool_), episode=None)


@pytest.mark.parametrize("tactile", ["learnt", "learnt-pairs", "none"])
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
    assert "untouched_from_s" in run.summary


def test_what_is_known_of_the_unit_is_known_again(seen):
    images = [np.asarray(frame.image)[::-1, ::-1] for frame in seen]
    told = DirectionCorrection(0.05, 0.9, 0.01, 0.02)
    unit = Calibration(background_of(image[::-1, ::-1] for image in images[:15]), CameraView(2), told)
    turned = replace(
        seen, image=tuple(encode_image(np.ascontiguousarray(image), "png") for image in images), codec="png"
    )
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


def test_pairs_with_a_frame_that_was_refused_are_not_said():
    recording, refused = pushed(), 11  # in contact from frame 5 to 19
    said: list[tuple[Measurement, ...]] = [() for _ in recording.time]
    for index in range(5, 20):
        back = np.arange(1, index - 4)
        said[index] = (RelativePoses(back, np.zeros((len(back), 3)), np.tile(np.eye(3), (len(back), 1, 1))),)
    remembered = _Remembered(recording.time, tuple(said))
    for index in (*range(5, refused), refused + 1):
        (pairs,) = remembered.measure(recording[index])
        assert isinstance(pairs, RelativePoses)
        assert pairs.back.tolist() == list(range(1, min(index, refused) - 4))


def test_modes_without_images_feel_anew_with_the_noise_of_the_settings():
    recording = pushed()
    recorded = record_touch(recording, "oracle")
    assert recorded.measurements is None
    for sigma in (1e-2, 1.0):
        settings = TrackerSettings(tactile="oracle")
        settings = replace(settings, noise=with_settings(settings.noise, relative_pose={"oracle": (1.0, 1.0, sigma)}))
        online, run = track_recorded(recorded, settings), track(recording, settings)
        assert np.array_equal(online.pose, run.online.pose)
        assert np.array_equal(online.covariance, run.online.covariance)  # pyright: ignore[reportArgumentType]


def test_what_was_said_of_frames_before_the_tracker_began_anew_is_not_said_again(monkeypatch):
    recording, lost = pushed(), 11  # in contact from frame 5 to 19
    covariance, add = np.diag([1.0, 1.0, 1e-4]), FixedLag.add

    def add_or_lose(self: FixedLag, sensor_pose: Any, measurements: Any, time: float) -> None:
        if time == recording.time[lost]:
            raise EstimationError("no solution")
        add(self, sensor_pose, measurements, time)

    monkeypatch.setattr(FixedLag, "add", add_or_lose)

    def tracked(first_after: int) -> Trajectory:
        """Tracked with pairs that reach back as far as the contact or, later on, the frame that was lost, does."""
        said: list[tuple[Measurement, ...]] = [() for _ in recording.time]
        for index in range(5, 20):
            first = 5 if index <= lost else first_after
            back = np.array([back for back in (3, 1, 10, 2) if index - back >= first], int)
            known = np.broadcast_to(covariance, (len(back), 3, 3))
            said[index] = (RelativePoses(back, np.zeros((len(back), 3)), known),)
        return track_recorded(RecordedTouch(recording, recording.object_pose, tuple(said)), TrackerSettings("learnt"))

    found, wanted = tracked(5), tracked(lost)
    assert [index for index, status in enumerate(found.status or ()) if status == "indeterminate"] == [lost]
    assert np.isfinite(found.pose).all()
    assert np.array_equal(found.pose, wanted.pose)


def test_recordings_that_cannot_be_tuned_on(tmp_path):
    good = pushed()
    lacking = {
        "blind": replace(good, object_pose=None),
        "flagless": replace(good, contact=None),
        "apart": replace(good, contact=np.zeros(40, np.bool_)),
    }
    for name, recording in {"good": good, **lacking}.items():
        write_recording(recording, tmp_path / f"{name}.mcap")
    (tmp_path / "broken.mcap").write_text("no")
    names = ["broken", "blind", "good", "flagless", "apart"]
    done: list[int] = []
    found, left_out = record_touch_of_files(
        {name: tmp_path / f"{name}.mcap" for name in names}, "none", progress=done.append
    )
    assert list(found) == ["good"] and list(left_out) == ["broken", "blind", "flagless", "apart"]
    assert done == [1, 2, 3, 4, 5]
    for name, why in left_out.items():
        assert why.startswith(f"{tmp_path / name}.mcap: ") and why.count(f"{name}.mcap") == 1
    assert "no ground truth" in left_out["blind"]
    assert "neither images nor contact flags" in left_out["flagless"]
    assert "never in contact" in left_out["apart"]
    with pytest.raises(FileError, match=r"be tuned on; the first: .*good.mcap: has no images, which tactile learnt"):
        record_touch_of_files({"good": tmp_path / "good.mcap"}, "learnt")
