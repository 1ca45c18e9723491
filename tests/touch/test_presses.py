"""A unit that learns itself from presses: how its images lie, and what is off in directions."""

import csv
import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from palpate.cli import main
from palpate.config import TrackerSettings
from palpate.errors import FileError
from palpate.geometry import se2
from palpate.geometry.shapes import Rectangle
from palpate.io.recording_mcap import write_recording
from palpate.lab.simulate.gel import ball_overlap, render, touch_image
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.lab.train.presses_of import presses_of
from palpate.touch import press_figure
from palpate.touch.background import background_of
from palpate.touch.calibration import Calibration, DirectionCorrection, load_calibration
from palpate.touch.camera_view import AS_IT_IS, CameraView, views
from palpate.touch.model import shipped_model
from palpate.touch.press_calibration import Presses, PressFit, learn_from_presses
from palpate.touch.press_files import read_presses
from palpate.tracker import Tracker
from palpate.types.frame import Frame
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT

ANGLES = np.radians([-14.0, -9.0, -4.0, 1.0, 6.0, 13.0])
MOUNTED = [AS_IT_IS, CameraView(2), CameraView(1), CameraView(0, True), CameraView(3, True)]
"""How cameras may lie; each is what has to be done to their images."""


@pytest.fixture(scope="module")
def unit() -> SensorUnit:
    return draw_unit(DIGIT, 6)


@pytest.fixture(scope="module")
def presses(unit: SensorUnit) -> Presses:
    return balls_on(unit, np.random.default_rng(0))


def balls_on(unit: SensorUnit, rng: np.random.Generator) -> Presses:
    places = [(unit.radius * np.sin(angle), 0.002 * np.cos(9.0 * angle)) for angle in ANGLES]
    images = tuple(touch_image(unit, ball_overlap(unit, 0.004, place, 8e-4), rng=rng) for place in places)
    return Presses(images, ANGLES, tuple(f"{number}.png" for number in range(len(images))))


def as_camera(image: np.ndarray, view: CameraView) -> np.ndarray:
    """The image that a view makes this one of."""
    shown = image[..., np.argsort(view.channels)]
    return np.ascontiguousarray(np.rot90(shown[:, ::-1] if view.mirrored else shown, -view.quarter_turns))


def of_camera(presses: Presses, view: CameraView) -> Presses:
    return Presses(tuple(as_camera(image, view) for image in presses.images), presses.angle, presses.names)


class Reader:
    """Stands for a touch model: the middle of what changed, over the width of a gel of 21 mm, plus what is off."""

    settings = SimpleNamespace(spread={"direction": SimpleNamespace(scale=1.0)})

    def __init__(self, offset: float = 0.0, scale: float = 1.0) -> None:
        self.offset, self.scale = offset, scale

    def look(self, difference: np.ndarray) -> Any:
        change = np.maximum(np.abs(difference).sum(axis=(0, 2)) - 2.0, 0.0)
        right = ((np.arange(128) + 0.5) / 128.0 - 0.5) @ change / change.sum()
        angle = np.arcsin(right * 2.0 * 0.0092 / 0.021)
        return SimpleNamespace(direction=(self.offset + self.scale * angle, np.radians(0.5) ** 2))


def learn(presses: Presses, untouched: np.ndarray, reader: Reader | None = None) -> PressFit:
    return learn_from_presses(presses, [untouched], DIGIT, reader or Reader())  # pyright: ignore[reportArgumentType]


def test_a_view_undoes_what_a_camera_does():
    image = np.random.default_rng(0).integers(0, 255, (320, 240, 3)).astype(np.uint8)
    for view in (*MOUNTED, CameraView(1, True, (2, 0, 1)), CameraView(3, False, (1, 2, 0))):
        np.testing.assert_array_equal(view.of(as_camera(image, view)), image)
    assert AS_IT_IS.of(image) is image
    assert str(CameraView(1, True, (2, 1, 0))) == "turned by 90 degrees, mirrored, channels BGR"
    assert str(AS_IT_IS) == "as they come"
    # Of an image that stands, half of the turns fit; of one that lies the other half; of a square one all.
    assert {view.quarter_turns for view in views(image, 320, 240)} == {0, 2}
    assert {view.quarter_turns for view in views(image, 240, 320)} == {1, 3}
    assert len(set(views(image[:240], 240, 240))) == 48


@pytest.mark.parametrize("view", MOUNTED, ids=str)
def test_presses_tell_left_from_right_however_the_camera_is_mounted(unit, presses, view):
    fit = learn(of_camera(presses, view), as_camera(unit.no_contact, view))
    # Up and down do not show in angles; left and right do.
    found = fit.calibration.view.of(as_camera(unit.no_contact, view))
    assert any((found == each).all() for each in (unit.no_contact, unit.no_contact[::-1]))
    np.testing.assert_allclose(fit.measured, ANGLES, atol=np.radians(1.5))
    assert fit.calibration.background.mean.shape == (320, 240, 3)


@pytest.mark.parametrize("seed", [6, 11])
def test_what_the_shipped_model_reads_does_not_depend_on_how_the_camera_delivers_it(seed):
    """Not even where a simpler way to read the images would be nearly as likely."""
    unit, rng = draw_unit(DIGIT, seed), np.random.default_rng(seed)
    given, still = balls_on(unit, rng), touch_image(unit, None, rng=rng)
    first = learn_from_presses(given, [still], DIGIT, shipped_model())
    assert first.calibration.view.keeps_left_and_right
    np.testing.assert_allclose(first.measured, ANGLES, atol=np.radians(4.0))
    for camera in (CameraView(0, True), CameraView(2), CameraView(channels=(2, 1, 0)), CameraView(2, True, (1, 2, 0))):
        fit = learn_from_presses(of_camera(given, camera), [as_camera(still, camera)], DIGIT, shipped_model())
        np.testing.assert_array_equal(fit.measured, first.measured, err_msg=str(camera))
        assert fit.calibration.view.keeps_left_and_right == camera.keeps_left_and_right


def test_presses_tell_offset_and_scale(unit, presses):
    fit = learn(presses, unit.no_contact)
    other = learn(presses, unit.no_contact, Reader(np.radians(1.5), 0.93))
    direction, plain = other.calibration.direction, fit.calibration.direction
    # The priors of 2 degrees and 10 % hold back a little.
    assert direction.offset - 0.93 * plain.offset == pytest.approx(np.radians(1.5), abs=np.radians(0.1))
    assert direction.scale / plain.scale == pytest.approx(0.93, abs=0.01)
    true = np.array([direction.true(angle) for angle in other.measured])
    np.testing.assert_allclose(true, ANGLES, atol=3.0 * other.scatter)
    assert abs(np.mean(true - ANGLES)) < np.radians(0.1)
    # 6 images of 0.5 degrees and angles good to 0.3: 0.24 degrees, or more where they lie worse about the line.
    least = np.radians(np.hypot(0.5, 0.3)) / np.sqrt(6)
    assert 0.9 * least < direction.offset_sigma < 3.0 * least
    # Of the scale it is that over the scatter of the angles, and six hundredths between ball and object.
    of_scale = np.hypot(np.radians(0.5), np.radians(0.3)) / np.sqrt(np.sum(np.square(ANGLES - ANGLES.mean())))
    assert 0.9 * np.hypot(of_scale, 0.06) < direction.scale_sigma < 3.0 * np.hypot(of_scale, 0.06)


def test_images_of_the_untouched_gel_have_to_be_there_and_alike(unit, presses):
    reader: Any = Reader()
    with pytest.raises(FileError, match=r"image 2 of the untouched gel: image is \(300, 240\), the untouched gel"):
        learn_from_presses(presses, [unit.no_contact, unit.no_contact[:300]], DIGIT, reader)
    with pytest.raises(FileError, match="found no image of the untouched gel"):
        learn_from_presses(presses, [], DIGIT, reader)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda given: Presses(given.images[:4], given.angle[:4], given.names[:4]), "found 4 presses; at least 5"),
        (lambda given: Presses(given.images, 0.2 * given.angle, given.names), "spread over 8 degrees"),
        (lambda given: Presses(given.images, given.angle[[3, 0, 5, 1, 4, 2]], given.names), "about a line"),
        (
            lambda given: Presses((given.images[0][:300], *given.images[1:]), given.angle, given.names),
            r"0\.png: image is",
        ),
    ],
)
def test_presses_that_tell_nothing_are_refused(unit, presses, change, words):
    with pytest.raises(FileError, match=words):
        learn(change(presses), unit.no_contact)


def test_images_of_another_sensor_and_a_press_without_touch_are_refused(unit, presses):
    small = Presses(tuple(image[:200] for image in presses.images), ANGLES, presses.names)
    with pytest.raises(FileError, match="200 x 240 px are not those of 'DIGIT', 320 x 240 px, in any turn"):
        learn(small, unit.no_contact[:200])
    blank = unit.no_contact.copy()
    blank[150:154, 118:122] += 60  # less than a touch, and where the reader expects one
    images = (*presses.images[:3], blank, *presses.images[4:])
    with pytest.raises(FileError, match=r"3\.png: shows no touch"):
        learn(Presses(images, ANGLES, presses.names), unit.no_contact)


def test_a_tracker_takes_images_as_the_calibration_says(unit, presses):
    """A camera that lies on its side and is mirrored gives what one as of the profile gives."""
    view = CameraView(1, True)
    correction = DirectionCorrection(0.02, 0.9, 0.004)
    estimates = []
    for mounted in (AS_IT_IS, view):
        calibration = Calibration(background_of([unit.no_contact] * 2), mounted, correction)
        tracker = Tracker(
            Rectangle(0.1, 0.1),
            DIGIT,
            (0.05, 0.0, 0.0),
            TrackerSettings(tactile="learnt-direction", hypotheses=1),
            calibration=calibration,
        )
        for step, image in enumerate((unit.no_contact, presses.images[2])):
            tracker.update(Frame(step / 30.0, np.zeros(3), image=as_camera(image, mounted)))
        last = tracker.update(Frame(2.0 / 30.0, np.zeros(3), image=as_camera(presses.images[3], mounted)))
        assert last.contact
        np.testing.assert_array_equal(tracker.frame.image, presses.images[3])
        estimates.append(last.pose)
    np.testing.assert_array_equal(*estimates)


# --- the command ---


def write(folder: Path, images: dict[str, np.ndarray], rows: list[tuple[str, Any]]) -> None:
    for name, image in images.items():
        assert cv2.imwrite(str(folder / name), image[..., ::-1])
    with (folder / "presses.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("file", "angle_deg"), *rows])


def palpate(*words: Any) -> int:
    return main.main([str(word) for word in words])


def test_the_command_finds_a_mirrored_camera_and_draws_it(tmp_path, unit, presses, capsys, monkeypatch):
    mirrored = of_camera(presses, CameraView(0, True))
    files = dict(zip(presses.names, mirrored.images, strict=True)) | {"still.png": unit.no_contact[:, ::-1]}
    write(tmp_path, files, list(zip(presses.names, np.degrees(ANGLES), strict=True)))
    out = tmp_path / "unit.npz"
    words = ("calibrate", "--presses", tmp_path / "presses.csv", "--untouched", tmp_path / "still.png", "--out", out)
    assert palpate(*words) == 0
    told = capsys.readouterr().out
    assert "noise unknown of a single image" in told
    assert "6 presses: directions are off by" in told and ("mirrored" in told or "turned by 180" in told)
    assert "Angles of the wrong sign look the same" in told
    assert (tmp_path / "unit.png").stat().st_size > 10_000
    picture = (tmp_path / "unit.png").read_bytes()
    calibration = load_calibration(out)
    assert calibration.view.mirrored != (calibration.view.quarter_turns == 2)
    assert palpate("info", out, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["height"], said["width"], said["noise_levels"]) == (320, 240, None)
    assert said["view"] == str(calibration.view) and said["scale"] == calibration.direction.scale
    assert said["offset_sigma_deg"] == pytest.approx(np.degrees(calibration.direction.offset_sigma or 0.0))
    assert palpate(*words) == 2
    assert "--force replaces it" in capsys.readouterr().err
    monkeypatch.setattr(press_figure, "press_figure", lambda *_: Torn())
    assert palpate(*words, "--force") == 2
    assert (tmp_path / "unit.png").read_bytes() == picture


class Torn:
    """A figure that cannot be written to its end."""

    def savefig(self, file: Any, **_: Any) -> None:
        Path(file).write_bytes(b"half")
        raise OSError("no space left on device")


def test_the_command_names_what_is_wrong_in_one_line(tmp_path, unit, capsys):
    write(tmp_path, {"a.png": unit.no_contact}, [("a.png", "left")])
    still = ("--untouched", tmp_path / "a.png", "--out", tmp_path / "unit.npz")
    assert cv2.imwrite(str(tmp_path / "grey.png"), unit.no_contact[..., 0])
    cases = [
        (("--presses", tmp_path / "presses.csv", *still), "row 1: angle_deg is 'left'"),
        (("--presses", tmp_path / "no.csv", *still), "no such file"),
        (("--presses", tmp_path / "grey.png", *still), "grey.png"),
        (("--presses", tmp_path / "presses.csv", *still[2:]), "name a recording or --untouched images, one of the two"),
        (("--out", tmp_path / "unit.npz"), "name a recording"),
        ((tmp_path / "rest.mcap", *still[2:], "--model", tmp_path / "gone"), "--model reads presses"),
        (("--presses", "a.csv", *still[:2], "--out", tmp_path / "a.png", "--force"), "is where the figure of presses"),
    ]
    (tmp_path / "grey.csv").write_text("file,angle_deg\ngrey.png,3\n")
    (tmp_path / "one.csv").write_text("file,angle_deg\na.png,3\n")
    (tmp_path / "alike.csv").write_text("file,angle_deg\nalike.png,3\n")
    assert cv2.imwrite(str(tmp_path / "alike.png"), np.repeat(unit.no_contact[..., :1], 3, axis=2))
    (tmp_path / "columns.csv").write_text("image,angle\ngrey.png,3\n")
    cases += [
        (("--presses", tmp_path / "grey.csv", *still), "grey.png: is a grey image"),
        (("--presses", tmp_path / "one.csv", *still), "one.csv: found 1 presses; at least 5 are needed"),
        (("--presses", tmp_path / "alike.csv", *still), "alike.png: is a grey image"),
        (("--presses", tmp_path / "columns.csv", *still), "found image, angle; expected a CSV with columns file and"),
    ]
    for words, said in cases:
        assert palpate("calibrate", *words) == 2
        out, err = capsys.readouterr()
        assert out == "" and said in err and err.count("\n") == 1, err
    assert not (tmp_path / "unit.npz").exists()


def test_the_command_takes_a_recording_of_presses_on_an_edge(tmp_path, unit, capsys):
    """A mirrored camera; the robot leans the sensor against the side of a fixed rectangle."""
    shape, yaw, depth = Rectangle(0.1, 0.1), -ANGLES, 6e-4
    object_pose = np.array([0.3, -0.2, 0.7])
    # The tip's centre stays behind the middle of the left side.
    left = np.column_stack([-0.05 - unit.radius * (1.0 - np.cos(yaw)), unit.radius * np.sin(yaw), yaw])
    touched = render(unit, shape, left, depth, rng=np.random.default_rng(0))
    poses, images = [], []
    for pose, image in zip(left, touched, strict=True):
        away = pose - (0.05, 0.0, 0.0)
        poses += [away] * 10 + [pose] * 9
        images += [unit.no_contact] * 10 + [image] * 9
    count = len(poses)
    recording = Recording(
        np.arange(count) / 30.0,
        se2.compose(object_pose, np.array(poses)),
        shape,
        DIGIT,
        np.tile(object_pose, (count, 1)),
        np.tile(np.arange(19) >= 10, len(left)),
        image=[encode_image(np.ascontiguousarray(image[:, ::-1])) for image in images],
    )
    presses = presses_of(recording)
    assert presses.names[0] == "the recording: frame 14"
    np.testing.assert_allclose(presses.angle, ANGLES, atol=1e-3)
    write_recording(recording, tmp_path / "presses.mcap")
    out = tmp_path / "unit.npz"
    assert palpate("calibrate", "--presses", tmp_path / "presses.mcap", "--out", out) == 0
    assert "6 presses: directions are off by" in capsys.readouterr().out
    calibration = load_calibration(out)
    assert calibration.view.mirrored != (calibration.view.quarter_turns == 2)
    np.testing.assert_allclose(calibration.background.mean, calibration.view.of(unit.no_contact[:, ::-1]), atol=8.0)
    alike = [encode_image(np.repeat(image[..., :1], 3, axis=2)) for image in images]
    write_recording(dataclasses.replace(recording, image=alike), tmp_path / "grey.mcap")
    assert palpate("calibrate", "--presses", tmp_path / "grey.mcap", "--out", out, "--force") == 2
    assert "grey.mcap: images are grey, and the touch model reads colours" in capsys.readouterr().err
    assert palpate("info", tmp_path / "grey.mcap") == 0
    assert "px, grey" in capsys.readouterr().out
    without = dataclasses.replace(recording, object_pose=None)
    with pytest.raises(FileError, match="the recording: has no object_pose; presses need them"):
        presses_of(without)


@pytest.mark.parametrize(
    ("table", "found"), [("angle_deg,file\n10\n", "''"), ('file,angle_deg\n"a\nb",10\n', "'a\\\\nb'")]
)
def test_a_press_without_the_name_of_an_image_is_refused(tmp_path, table, found):
    (tmp_path / "presses.csv").write_text(table)
    with pytest.raises(FileError, match=rf"presses\.csv: row 1: file is {found}; expected the name of an image"):
        read_presses(tmp_path / "presses.csv")
