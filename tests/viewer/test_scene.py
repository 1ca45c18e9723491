import json
import shutil

import numpy as np
import pytest
from view_samples import FRAMES, LAST, LEARNT, imaged_push, scene_of, tracked_push, write_run

from palpate import io as formats
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.shapes import Rectangle
from palpate.pipeline.first_release import Release
from palpate.pipeline.run_folder import RECORDING
from palpate.touch.background import background_of
from palpate.types.sensor import SensorProfile
from palpate.viewer import scene
from palpate.viewer.scene import Scene, contact_points, jpeg, load_scene
from palpate.viewer.scene import touch_images as views


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("written") / "run"
    write_run(tracked_push(), folder)
    return folder


@pytest.fixture
def run_folder(written, tmp_path):
    return shutil.copytree(written, tmp_path / "run")


def assert_same(found: Scene, made: Scene):
    assert found.estimate is not None and made.estimate is not None
    for name in ("time", "pose", "contact", "status"):
        np.testing.assert_array_equal(getattr(found.estimate, name), getattr(made.estimate, name))
    np.testing.assert_array_equal(found.truth, made.truth)
    np.testing.assert_array_equal(found.friction, made.friction)
    assert [len(several) for several in found.answers] == [len(several) for several in made.answers]
    for one, other in zip(found.answers[30], made.answers[30], strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-12)
        assert one.weight == other.weight


def test_a_run_folder_shows_what_the_run_did(run_folder):
    made = scene_of(tracked_push(), "run")
    found = load_scene(run_folder)
    assert_same(found, made)
    assert found.recording.image == made.recording.image  # it was in no file, so the folder has it
    assert found.name == "run"


def test_friction_is_as_believed_until_something_tells(run_folder):
    friction = load_scene(run_folder).friction
    assert friction is not None and friction.shape == (FRAMES, 2)
    # A straight push says nothing of the friction cone's edge.
    np.testing.assert_array_equal(friction[:LAST], [tracked_push().settings.noise.priors.grip] * LAST)
    np.testing.assert_array_equal(friction[LAST:], [LEARNT] * (FRAMES - LAST))


def test_a_recording_shows_itself(tmp_path):
    formats.write(imaged_push(), tmp_path / "push.mcap")
    found = load_scene(tmp_path / "push.mcap")
    assert found.estimate is None and found.name == "push.mcap"
    np.testing.assert_array_equal(found.contact, imaged_push().contact)


def test_a_run_that_began_in_contact_shows_the_gel_after_it(run_folder, monkeypatch):
    assert load_scene(run_folder).calibration is None
    gel = background_of([np.full((40, 30, 3), level, np.uint8) for level in (90, 91)])
    monkeypatch.setattr(scene, "first_release", lambda recording: Release(gel, 0.5))
    summary = json.loads((run_folder / "summary.json").read_text())
    (run_folder / "summary.json").write_text(json.dumps({**summary, "untouched_from_s": 0.5}))
    calibration = load_scene(run_folder).calibration
    assert calibration is not None and calibration.background is gel


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("settings.json", None, "is no run of palpate track"),
        ("settings.json", "{}", r"settings.json: recording is null, expected the name of a file"),
        ("settings.json", '{"recording": "gone.mcap"}', "gone.mcap: no such file"),
        ("friction.csv", "time,friction,deviation\n0.0,0.4,0.1\n", "has 1 times that are not those of the run's 50"),
        ("friction.csv", "time,friction\n", "line 1: expected the header time,friction,deviation"),
        ("answers.csv", None, "answers.csv: no such file"),
    ],
)
def test_a_run_folder_that_cannot_be_shown(run_folder, file, text, message):
    (run_folder / file).unlink()
    if text is not None:
        (run_folder / file).write_text(text)
    with pytest.raises(FileError, match=message):
        load_scene(run_folder)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("9.0,1,0,0,0,1,0,0,1,0,1", "has an answer at 9 s, at which there is no estimate"),
        ("0.0,1,0,0,0,1,0,0,1,0", "expected rows of 11 numbers"),
        ("0.0,1,0,0,0,1,0,0,1,0,one", "expected rows of 11 numbers"),
    ],
)
def test_answers_that_cannot_be_read(run_folder, row, message):
    header = (run_folder / "answers.csv").read_text().splitlines()[0]
    (run_folder / "answers.csv").write_text(f"{header}\n{row}\n")
    with pytest.raises(FileError, match=message):
        load_scene(run_folder)


def test_a_recording_that_has_changed_since(run_folder):
    formats.write(imaged_push(), run_folder / "shorter.mcap")
    settings = json.loads((run_folder / "settings.json").read_text())
    lines = (run_folder / "estimates.csv").read_text().splitlines(keepends=True)
    (run_folder / "estimates.csv").write_text("".join(lines[:-1]))
    with pytest.raises(FileError, match="49 estimates are not of the 50 frames"):
        load_scene(run_folder)
    assert settings["recording"] == RECORDING


def test_the_contact_point_is_the_nearest_of_the_outline():
    sensor = SensorProfile(name="two", radius=0.01, tips=((0.0, -0.02), (0.0, 0.02)))
    field = DistanceField.of(Rectangle(0.1, 0.06))
    poses = np.array([[0.5, 0.1, np.pi / 2]] * 2)
    # At the object's left side, turned a little so that the one tip is nearer, and then the other.
    object_T_sensor = np.array([[-0.055, 0.0, -0.05], [-0.055, 0.0, 0.05]])
    points = contact_points(se2.compose(poses, object_T_sensor), poses, sensor, field)
    local = se2.transform(se2.inverse(poses), points)
    centers = se2.transform(object_T_sensor[:, None], sensor.centers)
    nearest = [centers[0, 1], centers[1, 0]]
    np.testing.assert_allclose(local, [[-0.05, each[1]] for each in nearest], atol=2e-4)


def test_the_model_sees_grey_where_nothing_touches():
    recording = imaged_push()
    pairs = list(views(recording, None))
    assert len(pairs) == FRAMES
    assert all(model is None for _, model in pairs[:14])  # the untouched gel is not known yet
    untouched, touched = pairs[16][1], pairs[30][1]
    assert untouched is not None and touched is not None and touched.shape == (40, 30, 3)
    assert np.abs(untouched.astype(int) - 128).max() < 12
    assert touched[20, 15].min() > 220 and np.abs(touched[3, 3].astype(int) - 128).max() < 12


def test_pictures_are_made_smaller_and_never_larger():
    import cv2

    image = np.zeros((40, 30, 3), np.uint8)
    image[..., 0] = 200
    for width, expected in ((15, (20, 15, 3)), (60, (40, 30, 3)), (None, (40, 30, 3))):
        found = cv2.imdecode(np.frombuffer(jpeg(image, width), np.uint8), cv2.IMREAD_COLOR)
        assert found is not None and found.shape == expected
        assert found[5, 5, 2] > 180 and found[5, 5, 0] < 20  # still RGB
