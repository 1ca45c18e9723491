"""Calibration by presses: camera view, errors of directions, presses in order, and presses in a recording."""

import csv
import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

import palpate
from palpate import DIGIT, FileError, Frame, Rectangle, Tracker, load_calibration
from palpate.touch.background import background_of
from palpate.touch.calibration import AS_IT_IS, VIEWS, CameraView, DirectionCorrection
from palpate.touch.press_calibration import Presses, learn_from_presses, read_image, read_presses
from palpate.touch.reader import angle_factor
from palpate.touch.touch_model import shipped_model
from palpate_lab.simulate.gel import ball_overlap, touch_image
from palpate_lab.simulate.unit import SensorUnit, draw_unit

Array = np.ndarray
ANGLES = np.radians([-14.0, -9.0, -4.0, 1.0, 6.0, 13.0])
MOUNTED = [AS_IT_IS, CameraView(2), CameraView(0, True), CameraView(2, True)]


@pytest.fixture(scope="module")
def unit() -> SensorUnit:
    return draw_unit(dataclasses.replace(DIGIT, pixel_pitch_sigma=0.0), 4)  # with its colours as usual


@pytest.fixture(scope="module")
def presses(unit: SensorUnit) -> Presses:
    rng = np.random.default_rng(0)
    places = [(unit.radius * np.sin(angle), 0.002 * np.cos(9.0 * angle)) for angle in ANGLES]
    images = tuple(touch_image(unit, ball_overlap(unit, 0.004, place, 8e-4), rng=rng) for place in places)
    return Presses(images, ANGLES, tuple(f"{number}.png" for number in range(len(images))))


def as_camera(image: Array, view: CameraView) -> Array:
    """Return the camera's image that a view turns into this one."""
    shown = image[..., np.argsort(view.channels)]
    return np.ascontiguousarray(np.rot90(shown[:, ::-1] if view.mirrored else shown, -view.quarter_turns))


def of_camera(presses: Presses, view: CameraView, in_order: bool = False) -> Presses:
    angle = np.full_like(presses.angle, np.nan) if in_order else presses.angle
    return Presses(tuple(as_camera(image, view) for image in presses.images), angle, presses.names)


class Reader:
    """Stand-in for a touch model: the middle of the change over a gel's width, with an error."""

    settings = SimpleNamespace(spread=dict.fromkeys(("direction", "turn"), SimpleNamespace(scale=1.0)))

    def __init__(self, offset: float = 0.0, scale: float = 1.0) -> None:
        self.offset, self.scale = offset, scale

    def read(self, difference: Array) -> Any:
        change = np.maximum(np.abs(difference).sum(axis=(0, 2)) - 2.0, 0.0)
        right = ((np.arange(128) + 0.5) / 128.0 - 0.5) @ change / change.sum()
        angle = np.arcsin(right * 2.0 * 0.0092 / 0.021)
        return {"direction": (self.offset + self.scale * angle, np.radians(0.5) ** 2)}


def learn(presses: Presses, untouched: Array, model: Any = None) -> tuple[palpate.Calibration, float]:
    model = model or Reader()
    return learn_from_presses(presses, palpate.Calibration(background_of([untouched])), DIGIT, model)


def test_a_view_undoes_what_a_camera_does():
    image = np.random.default_rng(0).integers(0, 255, (320, 240, 3)).astype(np.uint8)
    for view in (*MOUNTED, CameraView(1, True, (2, 0, 1)), CameraView(3, False, (1, 2, 0))):
        np.testing.assert_array_equal(view.of(as_camera(image, view)), image)
    assert str(CameraView(1, True, (2, 1, 0))) == "turned by 90 degrees, mirrored, channels BGR"
    assert len(set(VIEWS)) == 24


@pytest.mark.parametrize("view", MOUNTED, ids=str)
def test_measured_presses_show_left_and_right_however_the_camera_is_mounted(unit, presses, view):
    calibration, scatter = learn(of_camera(presses, view), as_camera(unit.no_contact, view))
    found = calibration.view.of(as_camera(unit.no_contact, view))
    assert any((found == each).all() for each in (unit.no_contact, unit.no_contact[::-1]))  # up and down do not show
    line = calibration.direction.offset + calibration.direction.scale * ANGLES
    np.testing.assert_allclose(line, ANGLES, atol=np.radians(1.5))
    assert scatter < np.radians(1.0)


def test_presses_measure_offset_and_scale(unit, presses):
    fit, _ = learn(presses, unit.no_contact)
    other_model: Any = Reader(np.radians(1.5), 0.93)
    other, scatter = learn(presses, unit.no_contact, other_model)
    direction, plain = other.direction, fit.direction
    assert scatter < np.radians(1.0)
    # The priors of 2 degrees and 10 % hold back a little.
    offset = angle_factor(other_model, DIGIT) * np.radians(1.5)  # of images that are narrower than the pad
    assert direction.offset - 0.93 * plain.offset == pytest.approx(offset, abs=np.radians(0.1))
    assert direction.scale / plain.scale == pytest.approx(0.93, abs=0.01)
    # 6 images of 0.5 degrees and angles good to 0.3; of the scale also six hundredths between ball and object.
    one = np.hypot(np.radians(0.5), np.radians(0.3))
    of_scale = np.hypot(one / np.sqrt(np.sum(np.square(ANGLES - ANGLES.mean()))), 0.06)
    assert 0.9 * one / np.sqrt(6) < direction.offset_sigma < 3.0 * one / np.sqrt(6)
    assert 0.9 * of_scale < direction.scale_sigma < 3.0 * of_scale


def chosen(presses: Presses, places: Any) -> Presses:
    return Presses(tuple(presses.images[at] for at in places), presses.angle[places], presses.names[: len(places)])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda given: chosen(given, [0, 1]), "found 2 presses; at least 3"),
        (lambda given: chosen(given, [3, 3, 3, 3, 3]), "within 0.0 degrees, less than noise can tell left from right"),
        (lambda given: dataclasses.replace(given, angle=0.5 * given.angle), "are angles right"),
        (lambda given: dataclasses.replace(given, angle=given.angle[[3, 0, 5, 1, 4, 2]]), "27 degrees in all"),
        (lambda given: of_camera(chosen(given, [2, 0, 4, 1, 3, 5]), AS_IT_IS, True), "presses in no view"),
        (lambda given: of_camera(chosen(given, [0, 0, 0, 1, 1]), AS_IT_IS, True), "spread over 8 degrees"),
    ],
)
def test_presses_that_show_nothing_are_refused(unit, presses, change, words):
    with pytest.raises(FileError, match=words):
        learn(change(presses), unit.no_contact)


def test_other_images_are_refused(unit, presses):
    reader: Any = Reader()
    known = palpate.Calibration(background_of([unit.no_contact]))
    dome = palpate.SensorProfile("my finger", radius=0.02, image_height=320, image_width=240)
    for sensor in (palpate.GELSIGHT_MINI, dome):
        with pytest.raises(FileError, match=f"are of round gels of known width, and '{sensor.name}' has none"):
            learn_from_presses(of_camera(presses, AS_IT_IS, True), known, sensor, reader)
    blank = unit.no_contact.copy()
    blank[150:154, 118:122] += 60  # less than a touch, at the expected place
    with pytest.raises(FileError, match=r"3\.png: shows no touch"):
        learn(dataclasses.replace(presses, images=(*presses.images[:3], blank, *presses.images[4:])), unit.no_contact)


def test_a_real_gel_finds_its_view(shared_data):
    balls = shared_data / "digit_balls"
    given = read_presses(balls / "truth.csv")
    order = np.argsort(given.angle)[:: len(given.angle) // 6]
    pressed, untouched = chosen(given, order), read_image(balls / "untouched.png")
    for view in (AS_IT_IS, CameraView(0, True)):
        found, _ = learn(of_camera(pressed, view, in_order=True), as_camera(untouched, view), shipped_model())
        assert found.view == view


def test_a_tracker_reads_images_in_the_calibrations_view(unit, presses):
    view, correction, estimates = CameraView(2, True), DirectionCorrection(0.02, 0.9, 0.004), []
    for mounted in (AS_IT_IS, view):
        calibration = palpate.Calibration(background_of([unit.no_contact] * 2), mounted, correction)
        how = palpate.TrackerSettings(tactile="learnt", hypotheses=1)
        tracker = Tracker(Rectangle(0.1, 0.1), DIGIT, (0.05, 0.0, 0.0), how, calibration=calibration)
        images = unit.no_contact, presses.images[2], presses.images[3]
        seen = [Frame(k / 30.0, np.zeros(3), image=as_camera(image, mounted)) for k, image in enumerate(images)]
        last = [tracker.update(frame) for frame in seen][-1]
        assert last.contact
        np.testing.assert_array_equal(tracker.frame.image, presses.images[3])
        estimates.append(last.pose)
    np.testing.assert_array_equal(*estimates)


def write(folder: Path, presses: Presses, untouched: Array) -> tuple[Any, ...]:
    """Write presses, their table and the untouched gel; return the options that calibrate on them."""
    for name, image in (*zip(presses.names, presses.images, strict=True), ("still.png", untouched)):
        assert cv2.imwrite(str(folder / name), image[..., ::-1])
    rows = (
        zip(presses.names, np.degrees(presses.angle), strict=True)
        if np.isfinite(presses.angle).all()
        else zip(presses.names)
    )
    with (folder / "presses.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("file", "angle_deg") if np.isfinite(presses.angle).all() else ("file",), *rows])
    return "calibrate", "--presses", folder / "presses.csv", "--untouched", folder / "still.png"


@pytest.mark.parametrize(
    "header",
    [
        "file, angle_deg",
        "\ufeffNote;File ;Angle (deg)",
        "sep=\t\nangle_deg\tFILE",
        "# a ball; 5 mm\n\n# file,angle_deg",
    ],
)
def test_tables_of_presses_as_people_write_them(tmp_path, unit, header):
    assert cv2.imwrite(str(tmp_path / "a.png"), unit.no_contact)
    names = header.splitlines()[-1]
    cells = {"note": "by hand", "file": "a.png", "angle": "-2.5" if "," in names else "-2,5"}
    mark = next(each for each in ";\t," if each in names)
    row = mark.join(next(cells[key] for key in cells if key in name.lower()) for name in names.split(mark))
    (tmp_path / "presses.csv").write_text(f"{header}\n{row}\n\n# the end\n", encoding="utf-8")
    found = read_presses(tmp_path / "presses.csv", sensor=DIGIT)
    assert np.degrees(found.angle).tolist() == [pytest.approx(-2.5)] and found.names == ("a.png",)


def with_ball(unit: SensorUnit, *places: float) -> Array:
    """Return the image of a unit on which balls press at places along y [m]."""
    overlaps = [ball_overlap(unit, 0.003, (place, 0.0), 7e-4) for place in places]
    return touch_image(unit, np.max(overlaps, axis=0), rng=np.random.default_rng(0))


@pytest.fixture
def narrow(tmp_path) -> SensorUnit:
    """Return a unit whose image shows 13.3 mm, and write its untouched gel and images of rulers of 6 mm and of none."""
    found = draw_unit(dataclasses.replace(DIGIT, pixel_pitch=1e-3 / 18.0, pixel_pitch_sigma=0.0), 4)
    two, one = with_ball(found, -0.003, 0.003), with_ball(found, 0.001)
    for name, image in (("still", found.no_contact), ("two", two), ("one", one), ("small", two[:240])):
        assert cv2.imwrite(str(tmp_path / f"{name}.png"), image[..., ::-1])
    return found


def test_a_ruler_measures_the_pixel_pitch(tmp_path, narrow, run_palpate, fails):
    out = tmp_path / "unit.npz"
    words = "calibrate", "--untouched", tmp_path / "still.png", "--out", out, "--ruler"
    numbers = json.loads(run_palpate(*words, "6mm", tmp_path / "two.png", "--json")[1])
    assert numbers["pixel_pitch_mm"] == pytest.approx(1.0 / 18.0, rel=0.06)
    assert 0.03 / 18.0 < numbers["pixel_pitch_sigma_mm"] < 0.06 / 18.0
    found = load_calibration(out)
    assert found.pixel_pitch == pytest.approx(narrow.pitch, rel=0.06)
    # With 6 % from a ball to other objects.
    assert found.direction.scale_sigma == pytest.approx(np.hypot(0.06, found.pixel_pitch_sigma))
    for length, image, said in (
        ("6mm", "one.png", "one.png: found no two imprints of the ruler side by side 6 mm apart"),
        ("13 mm", "two.png", "no two imprints of the ruler side by side 13 mm apart: are they one, or is the length"),
        ("19mm", "two.png", "a ruler of 19 mm is not what an image of 'DIGIT' shows, some 15 mm"),
        ("6", "two.png", "two.png'; expected words such as 8mm caliper.png"),
        ("6mm", "small.png", "small.png: "),
    ):
        assert said in fails(*words, length, tmp_path / image, "--force")
    strange = palpate.Calibration(found.background, pixel_pitch=2e-4)
    with pytest.raises(palpate.SettingError, match=r"as if an image showed 3\.2 times what one of 'DIGIT' does"):
        Tracker(Rectangle(0.1, 0.1), DIGIT, None, calibration=strange)


def test_places_measure_the_scale_however_narrow_and_a_ruler_goes_with_them(tmp_path, narrow, run_palpate):
    offset, names = 0.0213, [f"{number}.png" for number in range(8)]  # [m] of a machine's zero
    places = np.repeat([-0.0012, 0.0, 0.0008, 0.0018], 2)
    for name, place in zip(names, places, strict=True):
        assert cv2.imwrite(str(tmp_path / name), with_ball(narrow, place)[..., ::-1])
    rows = [f"{name},{1e3 * (place + offset - 0.02):.2f}" for name, place in zip(names, places, strict=True)]
    (tmp_path / "presses.csv").write_text("\n".join(["file,place_mm", *rows]))
    words = "calibrate", "--presses", tmp_path / "presses.csv", "--untouched", tmp_path / "still.png", "--force"
    plain = json.loads(run_palpate(*words, "--out", tmp_path / "a.npz", "--json")[1])
    assert plain["scale"] == pytest.approx(18.0 / 16.0, abs=0.1) and plain["pixel_pitch_mm"] is None
    assert plain["offset_sigma_deg"] is None and 0.06 < plain["scale_sigma"] < 0.2
    said = " ".join(run_palpate(*words, "--out", tmp_path / "a.npz")[1].split())
    assert "the view and the scale of directions are known; angles would tell their offset" in said
    ruled = json.loads(
        run_palpate(*words, "--out", tmp_path / "b.npz", "--ruler", "6mm", tmp_path / "two.png", "--json")[1]
    )
    assert ruled["scale"] == pytest.approx(1.05, abs=0.1) and ruled["pixel_pitch_mm"] == pytest.approx(
        1.0 / 18.0, rel=0.06
    )


@pytest.mark.parametrize("in_order", [False, True])
def test_the_command_finds_a_mirrored_camera(tmp_path, unit, presses, run_palpate, in_order):
    view, out = CameraView(0, True), tmp_path / "unit.npz"
    words = *write(tmp_path, of_camera(presses, view, in_order), as_camera(unit.no_contact, view)), "--out", out
    code, said, _ = run_palpate(*words)
    said = " ".join(said.split())
    assert code == 0 and "noise_levels" not in said and "Left and right are exchanged" in said
    assert ("offset_sigma_deg" not in said) == in_order
    calibration = load_calibration(out)
    assert calibration.is_view_known and not calibration.view.keeps_left_and_right
    info = json.loads(run_palpate("info", out, "--json")[1])
    assert (info["height"], info["width"], info["noise_levels"]) == (320, 240, None)
    assert info["view"] == str(calibration.view)
    assert run_palpate(*words)[0] == 2
    numbers = json.loads(run_palpate(*words, "--force", "--json")[1])
    assert numbers["presses"] == 6 and (numbers["offset_sigma_deg"] is None) == in_order


def test_the_command_names_what_is_wrong_in_one_line(tmp_path, unit, fails):
    assert cv2.imwrite(str(tmp_path / "a.png"), unit.no_contact)
    assert cv2.imwrite(str(tmp_path / "grey.png"), np.repeat(unit.no_contact[..., :1], 3, axis=2))
    table, out = tmp_path / "table.csv", ("--out", tmp_path / "unit.npz")

    for text, words in {
        "file,angle_deg\na.png,left\n": "line 2: angle_deg is 'left'",
        "file,place_mm\na.png,21.5\n": "line 2: place_mm is '21.5'; expected -21 to 21 mm on a round gel",
        "file,place_mm,angle_deg\na.png,1,2\n": "found the columns angle_deg and place_mm; one of them is needed",
        "file,angle_deg\ngrey.png,3\n": "grey.png: images are grey",
        "file,angle_deg\na.png,3\na.png,4\n": "line 3: file is 'a.png'; expected the name of an image, each once",
        "file,angle_deg\ngone.png,3\n": "table.csv: line 2: ",
        "file,angle\na.png,3\n": "found the columns file, angle; expected file and angle_deg or place_mm, which may",
        "angle_deg,file\n10\n": "line 2: found '10', expected 2 columns",
        "angle_deg,file\n10,\n": "line 2: file is ''; expected the name of an image",
        'file,angle_deg\n"a\nb",10\n': "expected the name of an image",
    }.items():
        table.write_text(text)
        assert words in fails("calibrate", "--presses", table, "--untouched", tmp_path / "a.png", *out)
    no_table = ("--presses", tmp_path / "no.csv", "--untouched", tmp_path / "a.png")
    assert "no such file" in fails("calibrate", *no_table, *out)
    assert "give either a recording or --untouched images" in fails("calibrate", "--presses", table, *out)
    assert not (tmp_path / "unit.npz").exists()
