"""Sensor profiles in files, made by `palpate calibrate --new-sensor` and taken by what takes a sensor's name."""

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import palpate
from palpate import DIGIT, GELSIGHT_MINI
from palpate_lab.simulate.gel import ball_overlap, touch_image
from palpate_lab.simulate.unit import SensorUnit, draw_unit

WHOLE = {
    "name": '"my pad"',
    "radius": "0.002",
    "flat_width": "0.014",
    "half_width": "0.009",
    "image_height": "240",
    "image_width": "320",
    "pixel_pitch": "5.6e-5",
    "rate": "25.0",
    "orientation": '"180"',
}


def write(path: str = "my_pad.toml", /, **fields: str | None) -> str:
    lines = [f"{key} = {value}" for key, value in (WHOLE | fields).items() if value is not None]
    Path(path).write_text("\n".join(lines))
    return path


def save(name: str, image: Any) -> str:
    assert cv2.imwrite(name, np.asarray(image)[..., ::-1])
    return name


def balls(unit: SensorUnit, *places: float) -> Any:
    overlaps = [ball_overlap(unit, 0.003, (1e-3 * y, 0.0), 7e-4) for y in places]
    return touch_image(unit, np.max(overlaps, axis=0), rng=np.random.default_rng(0))


def test_a_profile_is_a_file(folder, json_of):
    palpate.Tracker(palpate.Disc(0.05), write(), (0.0, 0.0, 0.0))  # whatever takes a name takes it
    told = json_of("info", "my_pad.toml")
    assert told["name"] == "my pad" and told["pixel_pitch"] == 5.6e-5 and told["touch_model"] == "none of its own"
    assert json_of("info", "digit")["touch_model"] == "digit"
    model = json_of("info", Path(palpate.__file__).parent / "data/gelsight_mini")
    assert model["format"] == "touch model" and model["measures"] == ["direction", "turn", "place"]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"image_width": None}, "my_pad.toml: image_width: is missing; needed are name, radius"),
        (
            {"pixel_pitch": "17.9"},
            "my_pad.toml: pixel_pitch: found 17.9; expected the width of a pixel on the gel in me",
        ),
        ({"pixel_pitch": "0.056"}, "my_pad.toml: pixel_pitch: found 0.056; expected the width of a pixel"),
        ({"radius": "21"}, "my_pad.toml: radius: found 21; expected a length of at most 0.3 m: are these milli"),
        ({"rate": '"fast"'}, "my_pad.toml: sensor 'my pad' has rate 'fast'; it must be a rate"),
        ({"pitch": "1"}, "my_pad.toml: pitch: is no field of a sensor; allowed are name"),
        ({"name": '"DIGIT"'}, "my_pad.toml: name: found 'DIGIT', which is palpate's own profile"),
        ({"name": "my pad"}, "my_pad.toml: is not valid TOML"),
    ],
)
def test_bad_profiles_are_refused_in_one_line(folder, fails, fields, message):
    assert message in fails("info", write(**fields))


def test_a_new_flat_sensor_is_measured_by_a_ruler_and_read(folder, json_of, fails):
    seeds = range(103, 140)
    units = (draw_unit(dataclasses.replace(GELSIGHT_MINI, pixel_pitch=5.2e-5, pixel_pitch_sigma=0.0), k) for k in seeds)
    unit = next(each for each in units if each.markers is None)
    unit = dataclasses.replace(unit, offset=(0.0, 0.0), roll=0.0)
    turned = [np.ascontiguousarray(image[::-1, ::-1]) for image in (unit.no_contact, balls(unit, -3.5, 3.5))]
    save("still.png", turned[0])
    save("ruler.png", turned[1])
    words = ("calibrate", "--untouched", "still.png", "--ruler", "7mm", "ruler.png", "--orientation", "180")
    new = ("--new-sensor", "mine.toml", "--out", "unit.npz")
    told = json_of(*words, *new, "--gel", "flat")
    assert told["pixel_pitch_mm"] == pytest.approx(0.052, rel=0.07)
    about = json_of("info", "mine.toml")
    assert (about["image_height"], about["image_width"], about["orientation"]) == (240, 320, "180")
    assert about["flat_width"] > 0.01 and about["pixel_pitch"] == pytest.approx(1e-3 * told["pixel_pitch_mm"], rel=1e-4)
    save("press.png", np.ascontiguousarray(balls(unit, 2.0)[::-1, ::-1]))
    (read,) = json_of("read", "press.png", "--calibration", "unit.npz", "--sensor", "mine.toml")
    assert read["place_mm"] == pytest.approx(2.0, abs=0.4)
    # Whole imprints at known places need no network, and none is taken for it without a word.
    push = ("calibrate", "--untouched", "still.png", "--sensor", "mine.toml", "--out", "other.npz", "--presses")
    places = (-5.0, -2.5, 0.0, 2.0, 4.5)
    names = [save(f"{y}.png", np.ascontiguousarray(balls(unit, y)[::-1, ::-1])) for y in places]
    rows = [f"{name},{y}" for name, y in zip(names, places, strict=True)]
    Path("presses.csv").write_text("\n".join(["file,place_mm", *rows]))
    assert json_of(*push, "presses.csv")["pixel_pitch_mm"] == pytest.approx(0.052, rel=0.03)
    (read,) = json_of("read", "press.png", "--calibration", "other.npz", "--sensor", "mine.toml")
    assert read["place_mm"] == pytest.approx(2.0, abs=0.2) and read["place_sigma_mm"] < 0.2
    Path("angles.csv").write_text("\n".join(["file,angle_deg", *rows]))
    other = (*push[:-2], "angles.npz", "--presses", "angles.csv")
    assert "no touch model comes with palpate for sensor 'mine'" in fails(*other)
    assert "the touch model is of 'DIGIT', with 320 x 240" in fails(
        "read", "press.png", "--untouched", "still.png", "--sensor", "mine.toml", "--model", "digit"
    )
    for more, message in (
        (new, "--gel is None; --new-sensor needs flat, or the radius"),
        ((*new, "--gel", "21"), "--gel is '21'"),
        (("--new-sensor", "mine.txt", "--out", "unit.npz", "--gel", "flat"), "'.txt' is of no sensor profile"),
        (("--out", "unit.npz", "--gel", "flat"), "give --new-sensor SENSOR.toml, too"),
    ):
        assert message in fails(*words, *more, "--force")
    assert "mine.toml: already exists" in fails(*words, "--new-sensor", "mine.toml", "--out", "2.npz", "--gel", "flat")
    assert not Path("2.npz").exists()


def test_a_dome_without_a_model_is_read_by_its_imprints(folder, json_of):
    dome = dataclasses.replace(DIGIT, radius=0.016, half_width=0.0075, pixel_pitch_sigma=0.0)
    unit = dataclasses.replace(draw_unit(dome, 5), offset=(0.0, 0.0), roll=0.0)
    fields = {
        "radius": "0.016",
        "flat_width": None,
        "half_width": "0.0075",
        "image_height": "320",
        "image_width": "240",
    }
    write("dome.toml", name='"dome"', pixel_pitch="6.25e-5", orientation=None, **fields)
    save("still.png", touch_image(unit, None))
    angles = np.array([-12.0, 0.0, 10.0])
    names = [save(f"{a:g}.png", balls(unit, 16.0 * np.sin(np.radians(a)))) for a in angles]
    told = json_of("read", *names, "--untouched", "still.png", "--sensor", "dome.toml")
    errors = np.array([each["direction_deg"] for each in told]) - angles
    assert (np.abs(errors) < 3.0).all()
