"""Touch model on disk, and touch measurements made of its readings."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import palpate
from palpate import (
    GELSIGHT_MINI,
    POINT,
    Background,
    Calibration,
    ContactCorner,
    ContactDirection,
    FileError,
    Frame,
    TouchModel,
    Turn,
)
from palpate.touch.calibration import DirectionCorrection
from palpate.touch.reader import TouchReader
from palpate.touch.touch_model import (
    COLUMNS,
    ROWS,
    SHIPPED_OF,
    Reading,
    Spread,
    fingerprint,
    reduced,
    shipped_model,
)
from palpate_lab.simulate.gel import render
from palpate_lab.simulate.unit import draw_unit
from palpate_lab.train.samples import difference


@pytest.fixture
def changed(tmp_path):
    """Return a function that writes the shipped model with changes and a right hash."""

    def change(network: bytes | None = None, **settings: object):
        network = (SHIPPED_OF["DIGIT"] / "touch.onnx").read_bytes() if network is None else network
        written = json.loads((SHIPPED_OF["DIGIT"] / "model.json").read_text())
        written["settings"] |= settings
        written["hash"] = fingerprint(written["settings"], network)
        (tmp_path / "model.json").write_text(json.dumps(written))
        (tmp_path / "touch.onnx").write_bytes(network)
        return tmp_path

    return change


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "palpate-recording"}, "format is 'palpate-recording', expected 'palpate-touch-model'"),
        ({"version": 2}, "version is 2, expected 3; train the model anew"),
        ({"hash": None}, "altered"),
        ({"settings": {"sensor": "small"}}, "altered"),
    ],
)
def test_an_altered_model_is_refused(changed, changes, message):
    file = changed() / "model.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    with pytest.raises(FileError, match=message):
        TouchModel(file.parent)


def test_files_that_are_missing_or_hold_no_model_are_named(changed):
    folder = changed()
    (folder / "touch.onnx").write_bytes(b"another")
    with pytest.raises(FileError, match="altered"):
        TouchModel(folder)
    (folder / "touch.onnx").unlink()
    with pytest.raises(FileError, match=r"touch\.onnx: no such file"):
        TouchModel(folder)
    (folder / "model.json").write_text("[1]")
    with pytest.raises(FileError, match="found a JSON list"):
        TouchModel(folder)
    (folder / "model.json").unlink()
    with pytest.raises(FileError, match=r"model\.json: no such file"):
        TouchModel(folder)
    with pytest.raises(FileError, match=r"no such folder; a touch model is a folder with model\.json in it"):
        TouchModel(folder / "nothing")


@pytest.mark.parametrize(
    "settings",
    [
        {"spread": []},
        {"spread": {"turn": {"scale": 1.0, "together": 1.0}}},
        {"spread": {name: {"scale": "x", "together": 1.0} for name in ("direction", "turn")}},
        {"image_height": None},
        {"sensor": 3},
        {"colour": "red"},
    ],
)
def test_settings_with_a_right_hash_are_checked(changed, settings):
    with pytest.raises(FileError, match=r"model\.json: settings do not fit this version"):
        TouchModel(changed(**settings))


@pytest.mark.parametrize(
    "network", [b"\x08\x07garbage", b"", (SHIPPED_OF["GelSight Mini"] / "touch.onnx").read_bytes()]
)
def test_another_network_is_refused(changed, network):
    with pytest.raises(FileError, match=r"touch\.onnx: (is no network|is empty)"):
        TouchModel(changed(network)).read(np.zeros((32, 128, 3), np.float32))


def test_a_network_that_keeps_its_numbers_elsewhere_is_refused(changed, tmp_path):
    onnx = pytest.importorskip("onnx")
    network = onnx.load_from_string((SHIPPED_OF["DIGIT"] / "touch.onnx").read_bytes())
    onnx.external_data_helper.convert_model_to_external_data(network, location="other.bin", size_threshold=0)
    onnx.save(network, str(tmp_path / "elsewhere.onnx"))
    with pytest.raises(FileError, match=r"touch\.onnx: keeps its numbers in another file"):
        TouchModel(changed((tmp_path / "elsewhere.onnx").read_bytes()))


def test_a_difference_is_of_area_means_in_units_of_32_levels():
    mean = reduced(np.full((320, 240, 3), (90.0, 100.0, 110.0), np.float32))
    image = np.full((320, 240, 3), (90, 100, 110), np.uint8)
    image[:160, :, 0] += 32
    found = difference(image, mean)
    assert found.shape == (ROWS, COLUMNS, 3) and found.dtype == np.float32
    np.testing.assert_allclose(found[:16], np.broadcast_to((1.0, 0.0, 0.0), (16, COLUMNS, 3)), atol=1e-6)
    np.testing.assert_allclose(found[16:], 0.0, atol=1e-6)
    corner = np.zeros((64, 256, 3), np.float32)
    corner[0, 0] = 8.0  # one pixel of four
    assert reduced(corner)[0, 0] == pytest.approx(2.0)


# Measurements

LEVELS = np.full((320, 240, 3), 100.0, np.float32)
GEL = Background(LEVELS, np.ones((40, 30, 3), np.float32))
PATCH, SEEN = np.s_[150:160, 120:135], np.s_[15:16, 64:72]  # in images, and in their differences


class StandIn(TouchModel):
    """Model that reads the level of a patch: 100 + k grey levels are k hundredths of everything."""

    def __init__(self, *outputs: str, log_odds: float = 3.0) -> None:
        self.folder = SHIPPED_OF["DIGIT"]
        self.log_odds = log_odds
        spread = {name: Spread(2.0, 3.0) if name == "direction" else Spread(0.5, 4.0) for name in outputs}
        settings: Any = SimpleNamespace(sensor="DIGIT", image_height=320, image_width=240, spread=spread)
        self.settings = settings

    def read(self, difference: Any) -> Reading:
        level = 0.32 * float(difference[SEEN].mean())
        everything = {"direction": (level, 0.01), "turn": (2.0 * level, 0.02), "place": (3.0 * level, 0.03)}
        everything |= {"corner": (4.0 * level, 0.04, 0.5, self.log_odds)}
        return {name: everything[name] for name in self.settings.spread}


WIDE = replace(palpate.DIGIT, pixel_pitch=7.6666667e-5)  # whose directions are what a model reads


def reader(tactile: Any = "learnt", *outputs: str, calibration: Calibration | None = None) -> TouchReader:
    return TouchReader(tactile, WIDE, StandIn(*(outputs or ("direction", "turn"))), calibration)


def frame(k: float, light: float = 1.0) -> Frame:
    image = LEVELS.copy()
    image[PATCH] += k
    return Frame(k / 30, np.zeros(3), image=np.rint(light * image).astype(np.uint8))


def test_an_image_gives_direction_and_turn_with_corrected_variances():
    direction, turn = reader().read(frame(7), GEL)
    assert isinstance(direction, ContactDirection) and isinstance(turn, Turn)
    assert (direction.angle, direction.variance) == pytest.approx((0.07, 0.01 * 2.0 * 3.0), rel=1e-3)
    assert (turn.angle, turn.variance) == pytest.approx((0.14, 0.02 * 0.5 * 4.0), rel=1e-3)


@pytest.mark.parametrize("log_odds", [3.0, 1.0])
def test_a_corner_is_measured_where_the_model_is_sure_of_one(log_odds):
    model = StandIn("direction", "turn", "corner", log_odds=log_odds)
    found = TouchReader("learnt", WIDE, model).read(frame(7), GEL)
    assert [type(one) for one in found[2:]] == ([ContactCorner] if log_odds > 2.0 else [])
    for one in found[2:]:
        assert isinstance(one, ContactCorner) and one.slope == 0.5
        assert (one.angle, one.variance) == pytest.approx((0.28, 0.04 * 0.5 * 4.0), rel=1e-3)


def test_a_flat_pad_gives_its_place_and_a_model_of_presses_the_direction_alone():
    place = reader("learnt", "direction", "turn", "place").read(frame(7), GEL)[1]
    assert isinstance(place, palpate.ContactPlace)
    shown = 18.4 / 15.0  # width of the gel in these images over that in those that the model knows
    assert (place.place, place.variance) == pytest.approx((0.21 * shown, 0.03 * 0.5 * 4.0 * shown**2), rel=1e-3)
    assert [type(one) for one in reader("learnt", "direction").read(frame(7), GEL)] == [ContactDirection]


def test_errors_of_a_unit_are_corrected_in_directions_and_turns():
    unit = Calibration(GEL, direction=DirectionCorrection(offset=0.02, scale=0.8))
    direction, turn = reader(calibration=unit).read(frame(10), GEL)
    assert isinstance(direction, ContactDirection) and isinstance(turn, Turn)
    assert direction.angle == pytest.approx((0.1 - 0.02) / 0.8, rel=1e-3)
    assert turn.angle == pytest.approx(0.2 / 0.8, rel=1e-3)  # its offset is a variable of the contact
    assert direction.variance == pytest.approx(0.01 * 2.0 * 3.0 / 0.8**2, rel=1e-3)
    assert turn.variance == pytest.approx(0.02 * 0.5 * 4.0 / 0.8**2, rel=1e-3)


def test_an_image_that_shows_less_of_the_gel_turns_directions_less():
    direction, turn = TouchReader("learnt", palpate.DIGIT, StandIn("direction", "turn")).read(frame(10), GEL)
    assert isinstance(direction, ContactDirection) and isinstance(turn, Turn)
    assert direction.angle == pytest.approx(0.1 * 15.0 / 18.4, rel=0.07)
    assert turn.angle == pytest.approx(2.0 * direction.angle)
    unit = Calibration(GEL, pixel_pitch=5.5e-5, pixel_pitch_sigma=0.03)
    narrow = reader(calibration=unit).read(frame(10), GEL)[0]
    assert isinstance(narrow, ContactDirection)
    assert narrow.angle == pytest.approx(0.1 * 13.2 / 18.4, rel=1e-2)
    (as_it_is,) = TouchReader("learnt", palpate.DIGIT, StandIn("direction")).read(frame(10), GEL)
    assert isinstance(as_it_is, ContactDirection)
    assert as_it_is.angle == pytest.approx(0.1, rel=1e-3)  # of a model that was trained on presses


def test_a_mark_that_becomes_part_of_the_untouched_gel_in_a_contact_is_not_read():
    images, brighter = reader("learnt", "direction"), LEVELS.copy()
    brighter[PATCH] += 4.0
    angles = []
    for gel in (GEL, Background(brighter, GEL.noise)):
        (direction,) = images.read(frame(5), gel)
        assert isinstance(direction, ContactDirection)
        angles.append(direction.angle)
    assert angles == pytest.approx([0.05, 0.01], rel=1e-2)


@pytest.mark.parametrize("light", [0.6, 1.4])
def test_light_that_changes_in_a_contact_is_corrected(light):
    images = reader("learnt", "direction")
    images.read(frame(20), GEL)
    (direction,) = images.read(frame(20, light), GEL)
    assert isinstance(direction, ContactDirection)
    assert direction.angle == pytest.approx(0.2 * light, rel=1e-2)


def test_the_oracle_measures_the_true_turn():
    oracle = TouchReader("oracle", POINT)
    truth, pose = np.array([1.0, 0.0, np.pi / 2]), np.array([1.0, -0.1, np.pi / 2 + 0.1])
    (turn,) = oracle.read(Frame(0.0, pose, contact=True, object_pose=truth), None)
    assert isinstance(turn, Turn) and turn.angle == pytest.approx(0.1)
    for unknown in (None, np.array([np.nan, 0.0, 0.0])):
        assert not oracle.read(Frame(0.1, pose, contact=True, object_pose=unknown), None)
    assert not TouchReader("none", POINT).read(Frame(0.0, pose, contact=True, object_pose=truth), None)


# Sensors of one's own

FINGER = palpate.SensorProfile("my finger", radius=0.015, half_width=0.008, image_height=320, image_width=240)
COLOURED = Background(np.full((320, 240, 3), (90.0, 120.0, 150.0), np.float32), np.zeros((40, 30, 3), np.float32))
COLOURED_IMAGE = COLOURED.mean.astype(np.uint8)


def test_images_of_an_own_sensor_are_not_read_by_the_model_of_another_one():
    touch = TouchReader("auto", FINGER)
    touch.choose(COLOURED_IMAGE, COLOURED)
    assert (touch.tactile, touch.reads_images) == ("none", False)
    assert "'my finger'" in touch.reason and "--model" in touch.reason and "palpate train" in touch.reason
    with pytest.raises(palpate.SettingError, match=r"tactile is learnt; .*'my finger'.*--model MODEL.*palpate train"):
        palpate.Tracker(palpate.Disc(0.05), FINGER, np.zeros(3), palpate.TrackerSettings("learnt"))
    with pytest.raises(palpate.SettingError, match="'my finger'"):
        shipped_model("my finger")


@pytest.mark.parametrize("tactile", ["auto", "learnt"])
def test_a_model_that_is_asked_for_by_name_reads_an_own_sensor_and_needs_its_colours(tactile: Any):
    touch = TouchReader(tactile, FINGER, palpate.TouchModel("digit"))
    touch.choose(COLOURED_IMAGE, COLOURED)
    assert touch.tactile == "learnt" and touch.needs_colours
    assert touch.read(Frame(0.0, np.zeros(3), image=COLOURED_IMAGE), COLOURED)


def test_a_changed_profile_keeps_the_model_of_its_name_as_long_as_the_images_fit():
    for sensor, tactile in (
        (replace(palpate.DIGIT, rate=60.0, pixel_pitch=5e-5), "learnt"),
        (replace(palpate.DIGIT, image_height=640, image_width=480), "none"),
        (replace(palpate.DIGIT, name="left DIGIT"), "none"),
    ):
        touch = TouchReader("auto", sensor)
        touch.choose(COLOURED_IMAGE, COLOURED)
        assert touch.tactile == tactile, sensor


def test_bad_input_is_named():
    with pytest.raises(palpate.EstimationError, match=r"frame at 0\.100 s has no image"):
        reader().read(Frame(0.1, np.zeros(3)), None)
    with pytest.raises(palpate.SettingError, match="has images of 240 x 320 px, and the touch model is of 'DIGIT'"):
        TouchReader("learnt", GELSIGHT_MINI, StandIn("direction", "turn"))


# The model of the GelSight Mini

MINIS = [draw_unit(GELSIGHT_MINI, seed) for seed in (100_001, 100_002, 100_003, 100_004)]


def mini_readings(shape: Any, front: float, tilt: float, y: float, depth: float) -> tuple[float, float]:
    """Return mean direction [rad] and place [m] of pads that face +x, tilted, and touch a shape at y on the pad."""
    axis, along = np.array([np.cos(tilt), np.sin(tilt)]), np.array([-np.sin(tilt), np.cos(tilt)])
    found = []
    for unit in MINIS:
        pose = np.append([front - unit.radius, 0.0] - y * along + unit.radius * axis, tilt)
        image = render(unit, shape, pose, depth)
        bare = render(unit, shape, np.array([front - 0.05, 0.0, 0.0]), 0.0)
        reading = shipped_model(unit.profile.name).read(difference(image, reduced(bare)))
        found.append((reading["direction"][0], reading["place"][0]))
    direction, place = np.mean(found, axis=0)
    return direction, place


def test_reading_an_image_tells_nobody_of_it(tmp_path):
    """ONNX Runtime reports its use, and keeps in the home what it could not send."""
    read = "palpate.TouchModel('digit').read(numpy.zeros((32, 128, 3), numpy.float32))"
    code = f"import numpy, palpate; print(*{read})"
    home = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("ORT_", "CI"))}
    done = subprocess.run([sys.executable, "-c", code], env=environment | home, capture_output=True, check=True)
    assert done.stdout.startswith(b"direction") and [*tmp_path.iterdir()] == []


def test_the_model_of_the_mini_is_chosen_by_its_name_and_reads_places_and_tilts():
    chosen = TouchReader("auto", GELSIGHT_MINI)
    bare = MINIS[0].no_contact
    chosen.choose(bare, Background(bare.astype(np.float32), np.zeros((30, 40, 3), np.float32)))
    assert (chosen.tactile, chosen.reason) == ("learnt", "images fit the touch model of the GelSight Mini")
    places = [mini_readings(palpate.Disc(0.05), -0.05, 0.0, y, 5e-4)[1] for y in (-0.005, 0.0, 0.005)]
    assert places[0] < places[1] - 0.002 < places[2] - 0.004
    edge = palpate.Rectangle(0.09, 0.2)
    tilts = [np.degrees(mini_readings(edge, -0.045, np.radians(tilt), 0.0, 6e-4)[0]) for tilt in (-5.0, 0.0, 5.0)]
    assert tilts[0] > tilts[1] + 2.0 and tilts[1] > tilts[2] + 2.0
