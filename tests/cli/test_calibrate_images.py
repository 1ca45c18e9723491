"""`palpate calibrate` on files of images: of the untouched gel alone, and of which sensor they are."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from recording_samples import pushed

from palpate.cli import main
from palpate.errors import FileError
from palpate.geometry.shapes import Rectangle
from palpate.io.recording_mcap import write_recording
from palpate.lab.simulate.gel import render, touch_image
from palpate.lab.simulate.unit import draw_unit
from palpate.touch.calibration import load_calibration
from palpate.touch.press_calibration import Presses
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, GELSIGHT_MINI, SensorProfile


def palpate(*words: Any) -> int:
    return main.main([str(word) for word in words])


def written(path: Path, image: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), image[..., ::-1])
    return path


@pytest.fixture
def stills(tmp_path: Path) -> list[Path]:
    """Images of an untouched DIGIT, with noise of 2 levels."""
    rng, gel = np.random.default_rng(0), draw_unit(DIGIT, 6).no_contact
    images = [np.clip(np.rint(gel + rng.normal(0.0, 2.0, gel.shape)), 0, 255).astype(np.uint8) for _ in range(4)]
    return [written(tmp_path / f"{name}.png", image) for name, image in zip("abcd", images, strict=True)]


def test_untouched_images_alone_are_a_calibration(tmp_path, stills, capsys):
    out = tmp_path / "unit.npz"
    assert palpate("calibrate", "--untouched", *stills, "--out", out) == 0
    assert capsys.readouterr() == (f"{out}: 320 x 240 px, noise 1.7 grey levels, from 4 images\n", "")
    found = load_calibration(out)
    images = np.array([cv2.imread(str(file)) for file in stills], np.float32)[..., ::-1]
    np.testing.assert_allclose(found.background.mean, images.mean(axis=0), atol=1e-3)
    assert not (tmp_path / "unit.png").exists()
    one = ("--untouched", stills[0], "--sensor", "digit", "--out", out, "--force", "--json")
    assert palpate("calibrate", *one) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {"file": None, "out": str(out), "height": 320, "width": 240, "noise_levels": None, "images": 1}


def test_images_that_are_no_calibration_are_refused_in_one_sentence(tmp_path, stills, capsys):
    small = written(tmp_path / "small.png", np.zeros((240, 320, 3), np.uint8))
    cases = [
        ((stills[0], small), f"{small}: is an image of 240 x 320 px, and {stills[0]} of 320 x 240"),
        (
            (*stills, "--sensor", "gelsight-mini"),
            "a.png: is of images of 320 x 240 px; those of sensor 'GelSight Mini'",
        ),
        ((*stills, "--sensor", "nose"), "sensor is 'nose'; allowed are digit, gelsight-mini"),
        ((tmp_path / "gone.png",), "gone.png: no such file"),
    ]
    for words, said in cases:
        assert palpate("calibrate", "--untouched", *words, "--out", tmp_path / "unit.npz") == 2
        out, err = capsys.readouterr()
        assert out == "" and said in err and err.count("\n") == 1, err
    assert not (tmp_path / "unit.npz").exists()


def test_presses_in_files_are_of_the_sensor_that_is_named(tmp_path, capsys):
    unit, rng = draw_unit(GELSIGHT_MINI, 100_001), np.random.default_rng(0)
    degrees = np.array([-8.0, -5.0, -2.0, 2.0, 5.0, 8.0])
    tilt = -np.radians(degrees)
    center = np.array([-0.045 - unit.radius, 0.0])
    apex = center + unit.radius * np.column_stack([np.cos(tilt), np.sin(tilt)])
    touched = render(unit, Rectangle(0.09, 0.2), np.column_stack([apex, tilt]), 6e-4, rng=rng)
    for number, image in enumerate(touched):
        written(tmp_path / f"{number}.png", image)
    with (tmp_path / "presses.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("file", "angle_deg"), *((f"{k}.png", each) for k, each in enumerate(degrees))])
    still = written(tmp_path / "still.png", touch_image(unit, None, rng=rng))
    words = ("--presses", tmp_path / "presses.csv", "--untouched", still, "--sensor", "gelsight-mini")
    assert palpate("calibrate", *words, "--out", tmp_path / "unit.npz") == 0
    found = load_calibration(tmp_path / "unit.npz")
    assert found.background.mean.shape == (240, 320, 3) and found.view.keeps_left_and_right


def of_sensor(path: Path, sensor: SensorProfile) -> Path:
    """A recording of this sensor with images of noise."""
    rng, size = np.random.default_rng(0), (sensor.image_height, sensor.image_width, 3)
    image = [encode_image(rng.integers(97, 104, size).astype(np.uint8), "png") for _ in range(40)]
    given = pushed()
    write_recording(
        Recording(np.arange(40) / 30.0, np.zeros((40, 3)), given.shape, sensor, image=image, codec="png"), path
    )
    return path


def test_the_sensor_of_a_recording_counts_and_is_not_contradicted(tmp_path, stills, capsys, monkeypatch):
    small = replace(GELSIGHT_MINI, image_height=24, image_width=32)
    mini, digit = of_sensor(tmp_path / "mini.mcap", small), of_sensor(tmp_path / "digit.mcap", DIGIT)
    out = ("--out", tmp_path / "unit.npz")
    cases = [
        ((mini, "--sensor", "digit"), f"{mini}: is of sensor 'GelSight Mini', and --sensor digit is 'DIGIT'"),
        ((digit, "--presses", mini), f"{digit}: is of sensor 'DIGIT', and {mini} is 'GelSight Mini'"),
        (
            ("--presses", mini, "--untouched", *stills, "--sensor", "digit"),
            f"{mini}: is of sensor 'GelSight Mini', and",
        ),
    ]
    for words, said in cases:
        assert palpate("calibrate", *words, *out) == 2
        printed, err = capsys.readouterr()
        assert printed == "" and said in err and err.count("\n") == 1, err
    assert palpate("calibrate", mini, "--sensor", "GelSight-Mini", *out) == 0

    def learn(presses, untouched, sensor, model):
        raise FileError(f"learns {sensor.image_height} rows by the model of {model.settings.sensor}")

    monkeypatch.setattr("palpate.touch.press_calibration.learn_from_presses", learn)
    monkeypatch.setattr("palpate.lab.train.presses_of.presses_of", lambda _: Presses((), np.empty(0), ()))
    assert palpate("calibrate", "--presses", mini, "--untouched", *stills, *out, "--force") == 2
    assert "learns 24 rows by the model of GelSight Mini" in capsys.readouterr().err
