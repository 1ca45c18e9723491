"""The tracker on simulated touch images: contact from what they show, and the model that comes with palpate."""

import dataclasses
import shutil
import subprocess
import sys
from typing import Any

import numpy as np
import planar
import pytest
from push_samples import with_settings

import palpate
from palpate import Frame, FrameError, Recording, Run, SettingError, Tracker, TrackerSettings, track


@pytest.fixture(scope="module")
def recording(tmp_path_factory, command) -> Recording:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")
    folder = tmp_path_factory.mktemp("images") / "simulated"
    options = ("--shape", "rectangle", "--count", 1, "--seconds", 6, "--seed", 79, "--ideal")
    assert command("simulate", folder, *options) == 0
    (path,) = folder.iterdir()
    return palpate.load_recording(path)


@pytest.fixture(scope="module")
def blind(recording) -> Run:
    return track(recording, TrackerSettings(tactile="none"))


@pytest.fixture(scope="module")
def learnt(recording) -> Run:
    return track(recording)


def yaw_deviation(run: Run) -> float:
    assert run.online.covariance is not None
    return float(np.sqrt(run.online.covariance[-1, 2, 2]))


def test_contact_is_what_images_show_whatever_the_flags_say(recording):
    touched = recording.contact
    assert touched is not None and touched.any()
    for flags in (None, np.zeros(len(recording), bool), ~touched):
        found = track(dataclasses.replace(recording, contact=flags)).online.contact
        assert found is not None
        assert np.mean(found != touched) < 0.02
        assert np.sum(found & ~touched) <= 1  # at the rim, until the sensor has moved out


@pytest.mark.parametrize("degrees", [0.0, 45.0, -90.0, 180.0])
@pytest.mark.parametrize("view", ["upright", "180"])
def test_a_turned_sensor_frame_is_named_with_the_option_that_mends_it(recording, degrees, view):
    turned = recording.moved_onto_gel((0.0, 0.0, np.radians(degrees)))
    given = dataclasses.replace(turned.oriented(view), is_view_known=False)
    said = " ".join(track(given).summary["warnings"])
    options = [option.split()[:7] for option in said.split("--sensor-T-gel ")[1:]]
    if degrees == 0.0:
        assert ("--orientation" in said) == (view == "180")
        assert view == "180" or options == []  # images that lie the other way are like a frame turned a little
        return
    assert len(options) == 1 and "confirm by --orientation" not in said
    mended = given.moved_onto_gel([float(number.strip(",)")) for number in options[0]])
    off = np.angle(np.exp(1j * (mended.sensor_pose - recording.sensor_pose)[:, 2]))
    assert np.abs(off).max() < np.radians(8.0 if view == "upright" else 30.0)


def test_how_images_lie_is_doubted_unless_it_is_stated(recording, tmp_path):
    upside_down = recording.oriented("180")
    doubted = track(dataclasses.replace(upside_down, is_view_known=False))
    assert doubted.summary["mirrored"] and not track(upside_down).summary["mirrored"]
    palpate.write_recording(recording.oriented("upright"), tmp_path / "a.mcap")
    assert palpate.load_recording(tmp_path / "a.mcap").is_view_known
    assert not recording.oriented("bgr").is_view_known  # says nothing of left and right


def test_what_touches_from_the_first_frame_on_is_told_until_the_sensor_lets_go(recording):
    """A tracker cannot look ahead: it takes the contact from where the sensor is, and touch tells nothing."""
    frames = late_frames(recording)
    tracker = Tracker(recording.shape, recording.sensor, frames[0].object_pose)
    found = [tracker.update(frame) for frame in frames]
    lifted = next(index for index, frame in enumerate(frames) if not frame.contact)
    begun = next(index for index, estimate in enumerate(found) if estimate.contact)
    unfelt = [estimate.reason.startswith("in contact since before") for estimate in found]
    assert begun < 15 and all(unfelt[begun:lifted]) and not any(unfelt[:begun])
    assert {estimate.status for estimate in found[begun:lifted]} == {"uncertain"}
    known = unfelt.index(False, begun)
    assert not found[known].contact and not any(unfelt[known:])
    assert distance(frames[lifted - 1].object_pose, found[lifted - 1].pose) < 0.01  # pushed by several times that


@pytest.mark.parametrize("light", [lambda ahead: 0.0, lambda ahead: 1.0 - 0.04 * ahead], ids=["off", "rising"])
def test_light_that_is_steady_only_from_the_first_touch_on(recording, light):
    """The gel is first known while it is touched, so the contact is taken from where the sensor is until a release."""
    touched = int(np.argmax(np.asarray(recording.contact)))
    tracker, found = Tracker(recording.shape, recording.sensor, recording.first_pose), []
    for index, frame in enumerate(recording):
        level = max(light(touched - index), 0.0) if index < touched else 1.0
        assert frame.image is not None
        dimmed = dataclasses.replace(frame, image=(level * frame.image).astype(np.uint8))
        found.append(tracker.update(dimmed))
    lifted = touched + int(np.argmin(np.asarray(recording.contact)[touched:])) - 1
    assert found[lifted].contact and found[lifted].status == "uncertain"
    assert distance(recording.truth[lifted], found[lifted].pose) < 0.01  # pushed by several times that


def test_a_recording_that_begins_in_contact_is_compared_with_the_gel_after_it(recording):
    there_and_back = [*range(len(recording)), *range(len(recording) - 2, len(recording) - 22, -1)]  # to rest for longer
    whole, late = (of_frames(recording, there_and_back[first:]) for first in (0, begun_at(recording)))
    run, unbroken = track(late), track(whole)
    lifted = int(np.argmin(np.asarray(late.contact)))
    (warning,) = [each for each in run.summary["warnings"] if "untouched gel is taken" in each]
    assert lifted - 2 <= 30 * float(warning.split()[-3]) < lifted + 30
    assert not any("untouched gel" in each for each in unbroken.summary["warnings"])
    assert run.calibration is not None and unbroken.calibration is None
    assert np.mean(np.asarray(run.online.contact) != late.contact) < 0.02
    assert distance(run.online.pose[-1], unbroken.online.pose[-1]) < 3e-3


def begun_at(recording: Recording) -> int:
    """A frame at which the first contact has begun."""
    return int(np.argmax(np.asarray(recording.contact))) + 3


def late_frames(recording: Recording) -> list[Frame]:
    return list(recording)[begun_at(recording) :]


def of_frames(recording: Recording, chosen: list[int]) -> Recording:
    assert recording.object_pose is not None and recording.contact is not None and recording.image is not None
    return dataclasses.replace(
        recording,
        time=np.arange(len(chosen)) / 30,
        sensor_pose=recording.sensor_pose[chosen],
        object_pose=recording.object_pose[chosen],
        contact=recording.contact[chosen],
        image=tuple(recording.image[index] for index in chosen),
        extra={},
    )


def distance(one: Any, other: Any) -> float:
    return float(np.hypot(*planar.between(one, other)[:2]))


def test_touch_that_is_learnt_tracks(recording, blind):
    # The default hardly believes turns.
    run = track(
        recording, TrackerSettings(tactile="learnt", noise=with_settings(palpate.NoiseSettings(), turn={"share": 4.0}))
    )
    # On one short push the blind tracker may be lucky; it does not know that it is.
    assert yaw_deviation(run) < 0.9 * yaw_deviation(blind)
    assert run.summary["rotation_rmse_deg"] < 1.2
    assert run.summary["nees_mean"] < 3.0
    assert set(run.summary["statuses"]) <= {"resting", "tracking", "strained", "uncertain", "ambiguous"}


def test_why_touch_is_learnt_or_not(recording):
    first, sensor = recording[0], recording.sensor
    grey = np.repeat(first.image.mean(axis=2, keepdims=True), 3, axis=2).astype(np.uint8)
    small, two = {"image_height": 240, "image_width": 320}, {"tips": ((0.0, 0.02), (0.0, -0.02))}
    for image, profile, tactile, reason in (
        (first.image, {}, "learnt", "images fit the touch model of the DIGIT"),
        (None, {}, "none", "there are no images"),
        (grey, {}, "none", "images are grey, and the touch model reads colours"),
        (
            np.rot90(first.image).copy(),
            small,
            "none",
            "sensor 'DIGIT' has images of 240 x 320 px, and the touch model is",
        ),
        (first.image, two, "none", "the sensor has 2 tips, and the touch model reads images of one"),
    ):
        tracker = Tracker(recording.shape, dataclasses.replace(sensor, **profile), np.zeros(3))
        assert (tracker.tactile, tracker.tactile_reason) == ("auto", "")
        for begin in (np.zeros_like(grey), grey, np.full_like(grey, 255)):  # before light and camera are set up
            if image is first.image:
                tracker.update(dataclasses.replace(first, image=begin))
                tracker.reset()
        for count in range(15):
            tracker.update(dataclasses.replace(first, time=count / 30, image=image))
        tracker.reset()  # it is the stream that was looked at
        assert tracker.tactile == tactile and tracker.tactile_reason.startswith(reason)
    with pytest.raises(SettingError, match="the touch model reads images of one"):
        Tracker(recording.shape, dataclasses.replace(sensor, **two), np.zeros(3), TrackerSettings("learnt"))


def test_what_learnt_touch_needs(recording):
    with pytest.raises(SettingError, match="has no images, which tactile learnt needs"):
        track(dataclasses.replace(recording, image=None), TrackerSettings(tactile="learnt"))
    small = dataclasses.replace(recording.sensor, image_height=240, image_width=320)
    with pytest.raises(SettingError, match="'DIGIT' has images of 240 x 320 px, and the touch model is of 'DIGIT'"):
        Tracker(recording.shape, small, np.zeros(3), TrackerSettings(tactile="learnt"))
    tracker = Tracker(recording.shape, recording.sensor, np.zeros(3), TrackerSettings(tactile="learnt"))
    frame = dataclasses.replace(recording[0], image=None, contact=True)
    with pytest.raises(palpate.EstimationError, match="has no image"):
        tracker.update(frame)


def test_learnt_touch_that_is_asked_for_takes_no_grey_images_but_by_a_model_of_ones_own(recording, learnt, tmp_path):
    grey = np.repeat(recording[0].image[..., :1], 3, axis=2)
    frame = dataclasses.replace(recording[0], image=grey)
    tracker = Tracker(recording.shape, recording.sensor, np.zeros(3), TrackerSettings("learnt"))
    for _ in range(2):
        with pytest.raises(FrameError, match=r"frame at 0\.000 s: images are grey, and the touch model reads colours"):
            tracker.update(frame)
    assert tracker.update(recording[0]).status == "resting"
    shutil.copytree(learnt.model.folder, tmp_path / "model")
    model = palpate.TouchModel(tmp_path / "model")
    own = Tracker(recording.shape, recording.sensor, np.zeros(3), TrackerSettings("learnt"), model)
    assert own.update(frame).status == "resting"


WITHOUT_OPENCV = """
import sys
import numpy as np
import palpate

gel = np.random.default_rng(0).integers(98, 103, (60, 320, 240, 3), np.uint8) + np.uint8([20, 0, 10])
gel[30:, 100:140, 90:110] += 60
gel[30:, 102:138, 110:130] -= 50
gel[40:, 250:256, 30:36] -= 60  # a grain, which is taken into the untouched gel
tracker = palpate.Tracker(palpate.Rectangle(0.2, 0.15), palpate.DIGIT, (0.12, 0.0, 0.0))
for k, image in enumerate(gel):
    estimate = tracker.update(palpate.Frame(k / 30.0, np.array([5e-4 * k, 0.0, 0.0]), image=image))
assert estimate.contact
assert abs(tracker.background.mean[253, 33, 0] - 60.0) < 5.0
heavy = {"cv2", "matplotlib", "shapely"}
heavy |= {"scipy.linalg", "scipy.spatial", "scipy.ndimage", "scipy.special", "scipy.optimize"}
print(*sorted(heavy & set(sys.modules)))
"""


def test_a_rectangle_and_images_in_arrays_need_no_opencv_scipy_matplotlib_or_shapely():
    done = subprocess.run([sys.executable, "-c", WITHOUT_OPENCV], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "\n"), done.stderr


def test_no_tip_is_said_to_have_sunk_in_at_an_object_of_a_kilogram(learnt):
    assert not any("sunk in" in reason for reason in learnt.online.reason)
