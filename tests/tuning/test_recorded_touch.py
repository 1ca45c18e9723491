"""What is recorded once and said again."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from recording_samples import pushed

from palpate.errors import FileError
from palpate.formats.palpate_h5 import write_recording
from palpate.recording.measurements import Feeling, RelativePoses
from palpate.recording.recording import Recording
from palpate.simulation.objects import SHAPES
from palpate.simulation.recordings import simulate_recording
from palpate.tracker import TrackerSettings
from palpate.tracking.run import track
from palpate.tuning.recorded_touch import _Remembered, record_touch, record_touch_of_files, track_recorded

Tactile = Any


@pytest.fixture(scope="module")
def seen() -> Recording:
    """A push with images and wrong flags."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")
    recording = simulate_recording(SHAPES["disc"], "disc", 3, 4.0)
    return replace(recording, contact=np.zeros(len(recording), np.bool_), episode=None)


@pytest.mark.parametrize("tactile", ["learnt", "learnt-pairs", "none"])
def test_what_images_say_is_said_again_without_them(seen, tactile: Tactile):
    settings = TrackerSettings(tactile=tactile)
    recorded, run = record_touch(seen, tactile), track(seen, settings)
    online = track_recorded(recorded, settings)
    assert recorded.recording.image is None and (recorded.feelings is None) == (tactile == "none")
    assert online.contact is not None and online.contact.any()
    assert np.array_equal(online.contact, run.online.contact)  # pyright: ignore[reportArgumentType]
    assert np.array_equal(online.pose, run.online.pose)
    assert np.array_equal(online.covariance, run.online.covariance)  # pyright: ignore[reportArgumentType]
    assert online.status == run.online.status


def test_modes_without_images_feel_anew_with_the_noise_of_the_settings():
    recording = pushed()
    recorded = record_touch(recording, "oracle")
    assert recorded.feelings is None
    for sigma in (1e-2, 1.0):
        settings = TrackerSettings(tactile="oracle")
        settings = replace(settings, noise=replace(settings.noise, tactile=(1.0, 1.0, sigma)))
        online, run = track_recorded(recorded, settings), track(recording, settings)
        assert np.array_equal(online.pose, run.online.pose)
        assert np.array_equal(online.covariance, run.online.covariance)  # pyright: ignore[reportArgumentType]


def test_what_was_felt_before_a_contact_begins_anew_is_not_said_again():
    relative = RelativePoses(np.array([10, 12, 3]), np.zeros((3, 3)), np.broadcast_to(np.eye(3), (3, 3, 3)))
    recording = pushed()
    feelings = tuple(Feeling(relative) for _ in recording.time)
    remembered: Any = _Remembered(recording.time, feelings)
    back = [remembered.feel(frame).relative.back.tolist() for frame in recording]
    assert (back[0], back[3], back[10], back[12]) == ([], [3], [10, 3], [10, 12, 3])
    remembered.lift()
    assert remembered.feel(recording[14]).relative.back.tolist() == []


def test_recordings_that_cannot_be_tuned_on(tmp_path):
    good = pushed()
    lacking = {
        "blind": replace(good, object_pose=None),
        "flagless": replace(good, contact=None),
        "apart": replace(good, contact=np.zeros(40, np.bool_)),
    }
    for name, recording in {"good": good, **lacking}.items():
        write_recording(recording, tmp_path / f"{name}.h5")
    (tmp_path / "broken.h5").write_text("no")
    names = ["broken", "blind", "good", "flagless", "apart"]
    done: list[int] = []
    found, left_out = record_touch_of_files(
        {name: tmp_path / f"{name}.h5" for name in names}, "none", progress=done.append
    )
    assert list(found) == ["good"] and list(left_out) == ["broken", "blind", "flagless", "apart"]
    assert done == [1, 2, 3, 4, 5]
    for name, why in left_out.items():
        assert why.startswith(f"{tmp_path / name}.h5: ") and why.count(f"{name}.h5") == 1
    assert "no ground truth" in left_out["blind"]
    assert "neither images nor contact flags" in left_out["flagless"]
    assert "never in contact" in left_out["apart"]
    with pytest.raises(FileError, match=r"can be tuned on; the first: .*good.h5: has no images, which tactile learnt"):
        record_touch_of_files({"good": tmp_path / "good.h5"}, "learnt")
