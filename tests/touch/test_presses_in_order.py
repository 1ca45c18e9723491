"""Presses by hand of which the order alone is known, and what the colours of the untouched gel say beside it."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from palpate.cli import main
from palpate.errors import FileError
from palpate.lab.simulate.gel import ball_overlap, touch_image
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.touch.background import Image
from palpate.touch.calibration import UNCORRECTED, load_calibration
from palpate.touch.camera_view import AS_IT_IS, CameraView
from palpate.touch.model import shipped_model
from palpate.touch.press_calibration import Presses, PressFit, imprint_angle, learn_from_presses
from palpate.touch.press_files import read_image, read_presses
from palpate.types.sensor import DIGIT, GELSIGHT_MINI, SensorProfile

ANGLES = np.radians([-14.0, -8.0, -2.0, 5.0, 12.0])
CAMERAS = {
    "as it is": lambda image: image,
    "mirrored": lambda image: image[:, ::-1],
    "upside down": lambda image: np.rot90(image, 2),
    "on its side": lambda image: np.rot90(image),
    "BGR": lambda image: image[..., ::-1],
}


@pytest.fixture(scope="module")
def unit() -> SensorUnit:
    """A unit whose colours lie as usual."""
    return draw_unit(DIGIT, 4)


@pytest.fixture(scope="module")
def images(unit: SensorUnit) -> list[Image]:
    """Of a ball that is pressed on it, in order."""
    places = [(unit.radius * np.sin(angle), 0.002 * np.cos(9.0 * angle)) for angle in ANGLES]
    rng = np.random.default_rng(0)
    return [touch_image(unit, ball_overlap(unit, 0.004, place, 8e-4), rng=rng) for place in places]


def seen_by(camera: str, images: list[Image]) -> tuple[Image, ...]:
    return tuple(np.ascontiguousarray(CAMERAS[camera](image)) for image in images)


def in_order(images: tuple[Image, ...]) -> Presses:
    return Presses(images, np.full(len(images), np.nan), tuple(f"{number}.png" for number in range(len(images))))


def learn(camera: str, images: list[Image], untouched: Image) -> PressFit:
    return learn_from_presses(in_order(seen_by(camera, images)), seen_by(camera, [untouched]), DIGIT, shipped_model())


def test_the_middle_of_an_imprint_is_where_its_difference_is():
    assert DIGIT.half_width
    seen = np.zeros((32, 128, 3), np.float32)
    seen[10:20, 95:97, 1] = -1.0  # about the middle between columns 95 and 96, 32 of 64 from the image's middle
    wanted = np.arcsin(0.5 * DIGIT.half_width / DIGIT.radius)
    assert imprint_angle(seen, DIGIT) == pytest.approx(wanted)
    assert imprint_angle(seen[:, ::-1], DIGIT) == pytest.approx(-wanted)
    assert np.isnan(imprint_angle(np.zeros_like(seen), DIGIT))


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_order_tells_how_a_camera_is_mounted(unit, images, camera):
    fit = learn(camera, images, unit.no_contact)
    found = fit.calibration.view.of(np.ascontiguousarray(CAMERAS[camera](unit.no_contact)))
    # Up and down show in nothing.
    assert any((found == each).all() for each in (unit.no_contact, unit.no_contact[::-1]))
    assert fit.calibration.direction == UNCORRECTED  # what is off does not show where nothing is measured
    np.testing.assert_allclose(fit.angle, ANGLES, atol=np.radians(4.0))
    np.testing.assert_allclose(fit.measured, fit.angle, atol=np.radians(4.0))


def test_the_other_order_is_a_mirrored_camera(unit, images):
    fit = learn("as it is", images[::-1], unit.no_contact)
    assert not fit.calibration.view.keeps_left_and_right


def test_measured_presses_do_not_tell_the_order_of_colours_and_the_untouched_gel_does(unit, images):
    given = Presses(seen_by("BGR", images), ANGLES, tuple("abcde"))
    fit = learn_from_presses(given, seen_by("BGR", [unit.no_contact]), DIGIT, shipped_model())
    assert fit.calibration.view.channels == (2, 1, 0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda images: [images[at] for at in (2, 0, 4, 1, 3)], "in the order of the presses in no view"),
        (lambda images: [images[0]] * 3 + [images[1]] * 2, "spread over 8 degrees"),
        (lambda images: images[:4], "found 4 presses"),
    ],
)
def test_presses_without_an_order_are_refused(unit, images, change, words):
    with pytest.raises(FileError, match=words):
        learn("as it is", change(images), unit.no_contact)


def test_gels_that_are_not_round_need_angles(images, unit):
    dome = SensorProfile("my finger", radius=0.02, image_height=320, image_width=240)
    for sensor in (GELSIGHT_MINI, dome):
        with pytest.raises(FileError, match=f"are of round gels of known width, and '{sensor.name}' has none"):
            learn_from_presses(in_order(tuple(images)), [unit.no_contact], sensor, shipped_model())


def test_an_image_that_shows_nothing_is_named(images, unit):
    noise = touch_image(unit, None, rng=np.random.default_rng(1))
    for shown in (unit.no_contact, noise):
        with pytest.raises(FileError, match=r"1\.png: shows no touch"):
            learn("as it is", [images[0], shown, *images[2:]], unit.no_contact)


def test_a_real_gel_finds_out_how_it_lies(shared_data):
    balls = shared_data / "digit_balls"
    given = read_presses(balls / "truth.csv")
    order = np.argsort(given.angle)[:: len(given.angle) // 6]
    pressed, untouched = [given.images[at] for at in order], read_image(balls / "untouched.png")
    views = {name: learn(name, pressed, untouched).calibration.view for name in CAMERAS}
    assert views == {
        "as it is": AS_IT_IS,
        "mirrored": CameraView(0, True),
        "upside down": CameraView(2),
        "on its side": CameraView(3),
        "BGR": CameraView(channels=(2, 1, 0)),
    }


# --- the command ---


def palpate(*words: Any) -> int:
    return main.main([str(word) for word in words])


def write(folder: Path, images: tuple[Image, ...], untouched: Image) -> tuple[Any, ...]:
    """Write presses and a table without angles; return the words that calibrate on them."""
    names = [f"{number}.png" for number in range(len(images))]
    for name, image in (*zip(names, images, strict=True), ("still.png", untouched)):
        assert cv2.imwrite(str(folder / name), image[..., ::-1])
    (folder / "presses.csv").write_text("\n".join(["file", *names]))
    return "--presses", folder / "presses.csv", "--untouched", folder / "still.png"


def test_the_command_takes_a_table_without_angles(tmp_path, unit, images, capsys):
    mirrored = seen_by("mirrored", [*images, unit.no_contact])
    words = write(tmp_path, mirrored[:-1], mirrored[-1])
    out = tmp_path / "unit.npz"
    assert palpate("calibrate", *words, "--out", out) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "5 presses: directions are" in said
    assert "degrees about the places of the imprints" in said
    assert "Presses in the wrong order look the same as images that lie like this" in said
    learnt = load_calibration(out)
    assert learnt.is_view_known and not learnt.view.keeps_left_and_right
    assert (tmp_path / "unit.png").stat().st_size > 10_000
    assert palpate("calibrate", *words, "--out", out, "--force", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["offset_deg"], found["scale"], found["presses"]) == (None, None, 5)


def test_training_needs_angles(tmp_path, unit, images, capsys):
    words = write(tmp_path, tuple(images), unit.no_contact)
    assert palpate("train", *words[1:], "--sensor", "DIGIT", "--out", tmp_path / "model") == 2
    assert "found file; expected a CSV with columns file and angle_deg" in capsys.readouterr().err
