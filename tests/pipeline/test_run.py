import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed
from view_samples import imaged_push, write_run

from palpate import io as formats
from palpate.config import PRESETS, TrackerSettings
from palpate.errors import FileError, SettingError
from palpate.pipeline import run_folder
from palpate.pipeline.run_folder import FILES, RECORDING, check_folder
from palpate.pipeline.track import track
from palpate.touch.background import background_of
from palpate.touch.calibration import Calibration
from palpate.touch.camera_view import CameraView
from palpate.types.images import encode_image


@pytest.fixture(scope="module")
def tracked() -> Any:
    return track(pushed(), TrackerSettings(tactile="oracle"))


def test_every_frame_gets_an_estimate_and_a_time(tracked):
    recording = tracked.recording
    assert tracked.online.time.tolist() == recording.time.tolist()
    assert tracked.online.contact.tolist() == recording.contact.tolist()
    assert tracked.online.covariance.shape == (40, 3, 3)
    assert len(tracked.smoothed) == 40
    assert tracked.step_ms.shape == (40,)
    assert (tracked.step_ms > 0).all()
    assert tracked.wall_s * 1e3 >= tracked.step_ms.sum()


def test_summary_is_of_the_online_estimates(tracked):
    # Two stretches of contact, 15 and 8 frames.
    assert tracked.summary["episodes"] == 2
    assert tracked.summary["contact_frames"] == 23
    assert tracked.summary["scored_frames"] == 40
    error = tracked.online.pose[-1, :2] - tracked.recording.object_pose[-1, :2]
    assert tracked.summary["final_translation_error_mm"] == pytest.approx(np.hypot(*error) * 1e3)


def test_progress_counts_frames():
    seen: list[int] = []
    track(pushed(10), progress=seen.append)
    assert seen == list(range(1, 11))


def test_tracking_begins_at_the_first_known_truth_or_at_the_given_pose():
    recording = pushed(10)
    truth = recording.object_pose.copy()
    truth[:2] = np.nan
    assert track(dataclasses.replace(recording, object_pose=truth)).first_pose.tolist() == truth[2].tolist()
    pose = (0.001, 0.0, 3.0)
    run = track(dataclasses.replace(recording, object_pose=None), first_pose=pose)
    assert run.first_pose.tolist() == list(pose)
    assert run.online.pose[0].tolist() == list(pose)
    assert run.summary["scored_frames"] == 0


def test_spikes_of_truth_are_not_scored():
    recording = pushed()
    truth = recording.object_pose.copy()
    truth[25, 0] += 0.1
    run = track(dataclasses.replace(recording, object_pose=truth))
    assert run.truth is not None and np.isnan(run.truth[25]).all()
    assert run.summary["scored_frames"] == np.isfinite(run.truth[:, 0]).sum() >= 33


def test_knocks_of_the_recording_are_in_the_summary(tracked):
    assert (tracked.summary["knocks"], tracked.summary["knock_recovery_s"]) == (0, [])
    told = np.zeros(40, np.bool_)
    told[8:10] = told[35] = True
    run = track(dataclasses.replace(pushed(), extra={"knocked": told}))
    assert (run.summary["knocks"], len(run.summary["knock_recovery_s"])) == (2, 2)
    assert run.summary["knock_recovery_s"][1] is None  # five frames after the second are not 0.3 s


def test_what_the_settings_need_and_the_recording_lacks():
    recording = dataclasses.replace(pushed(), object_pose=None)
    with pytest.raises(SettingError, match="--first-pose X Y THETA"):
        track(recording)
    with pytest.raises(SettingError, match="no ground truth, which tactile oracle"):
        track(recording, TrackerSettings(tactile="oracle"), first_pose=(0, 0, 0))
    with pytest.raises(SettingError, match="neither images nor contact flags"):
        track(dataclasses.replace(pushed(), contact=None))


def test_a_run_leaves_a_folder(tracked, tmp_path):
    folder = tmp_path / "new" / "run"
    write_run(tracked, folder)
    assert sorted(path.name for path in folder.iterdir()) == sorted([*FILES, RECORDING])  # it is in no other file
    assert [path.name for path in folder.parent.iterdir()] == ["run"]
    assert json.loads((folder / "summary.json").read_text()) == tracked.summary
    settings = json.loads((folder / "settings.json").read_text())
    assert (settings["tactile"], settings["smoother"], settings["pressure"]) == (
        "oracle",
        "fixed-lag",
        "uniform",
    )
    assert settings["noise_preset"] == "palpate"
    assert settings["noise"]["contact"] == dataclasses.asdict(PRESETS["palpate"].contact)
    assert settings["first_pose"] == tracked.first_pose.tolist()
    estimates: Any = formats.read(folder / "estimates.csv")
    assert np.array_equal(estimates.pose, tracked.online.pose)
    assert np.allclose(estimates.covariance, tracked.online.covariance, rtol=1e-12, atol=0)
    assert estimates.status == tracked.online.status
    smoothed: Any = formats.read(folder / "trajectory.tum")
    assert np.allclose(smoothed.pose, tracked.smoothed.pose, atol=2e-9)
    assert (folder / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_an_existing_folder_is_kept_without_force(tracked, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "summary.json").write_text("old")
    with pytest.raises(FileError, match="already exists; --force"):
        write_run(tracked, folder)
    assert (folder / "summary.json").read_text() == "old"
    write_run(tracked, folder, force=True)
    assert json.loads((folder / "summary.json").read_text()) == tracked.summary
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_force_replaces_nothing_but_a_run(tracked, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(FileError, match=r"holds 'thesis.tex'.*not replaced"):
        write_run(tracked, tmp_path, force=True)
    assert (tmp_path / "thesis.tex").exists()
    with pytest.raises(FileError, match="is a file"):
        check_folder(tmp_path / "thesis.tex", force=True)
    with pytest.raises(FileError, match="not the name of a new folder"):
        check_folder(Path("/"))


def test_a_run_that_fails_to_be_written_leaves_the_old_one(tracked, tmp_path, monkeypatch):
    folder = tmp_path / "run"
    write_run(tracked, folder)
    old = (folder / "summary.json").read_text()

    def full(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(run_folder.tum, "write", full)
    with pytest.raises(FileError, match="no space left"):
        write_run(tracked, folder, force=True)
    assert (folder / "summary.json").read_text() == old
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_images_that_come_turned_are_tracked_as_the_calibration_says():
    push = imaged_push()
    upright = [frame.image for frame in push if frame.image is not None]
    unit = Calibration(background_of(upright[:15]), CameraView(1))
    turned = tuple(encode_image(np.ascontiguousarray(np.rot90(image, -1)), "png") for image in upright)
    as_come = dataclasses.replace(push.sensor, image_height=30, image_width=40)
    found = track(dataclasses.replace(push, image=turned, sensor=as_come), calibration=unit)
    expected = track(push, calibration=dataclasses.replace(unit, view=CameraView()))
    assert found.summary["contact_frames"] > 10
    assert np.array_equal(found.online.pose, expected.online.pose)
