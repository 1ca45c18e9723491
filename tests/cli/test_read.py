"""`palpate read`, and the calibration of a flat pad by presses at known places."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import palpate
from palpate import DIGIT, GELSIGHT_MINI
from palpate_lab.simulate.gel import ball_overlap, render, touch_image
from palpate_lab.simulate.unit import SensorUnit, draw_unit

PLACES = (-6.0, -2.5, 1.0, 3.5, 6.5)  # [mm]


def save(name: str, image: Any) -> str:
    assert cv2.imwrite(name, np.asarray(image)[..., ::-1])
    return name


def ball(unit: SensorUnit, y: float, z: float = 1.0) -> Any:
    """Return the image of a ball of 3 mm, pressed in 0.7 mm deep at a place [mm] of a unit."""
    overlap = ball_overlap(unit, 0.003, (1e-3 * y, 1e-3 * z), 7e-4)
    return touch_image(unit, overlap, rng=np.random.default_rng(round(100.0 * y) % 997))


@pytest.fixture
def pad(folder: Path) -> SensorUnit:
    """A drawn GelSight Mini with dots, whose pixels are 2 % smaller than usual; and images of balls on it."""
    usual = dataclasses.replace(GELSIGHT_MINI, pixel_pitch_sigma=0.0)
    drawn = (draw_unit(usual, seed) for seed in range(7, 40))
    unit = next(each for each in drawn if each.markers is not None)
    unit = dataclasses.replace(unit, pitch=0.98 * unit.pitch, offset=(4e-4, 0.0), roll=0.0)
    save("still.png", touch_image(unit, None))
    for y in PLACES:
        save(f"{y:g}.png", ball(unit, y))
    return unit


def table(places: Any, name: str = "presses.csv") -> str:
    rows = [f"{y:g}.png,{place:.3f}" for y, place in zip(PLACES, places, strict=True)]
    Path(name).write_text("\n".join(["file,place_mm", *rows]))
    return name


MINI = ("--sensor", "gelsight-mini")


def test_a_press_on_a_flat_pad_has_a_place(pad, json_of, succeeds):
    names = [save(f"ball{y:g}.png", ball(pad, y, -2.0)) for y in (-5.0, 0.0, 4.0)]
    told = json_of("read", *names, "still.png", "--untouched", "still.png", *MINI)
    assert [each["file"] for each in told] == [*names, "still.png"]
    assert [each["contact"] for each in told] == [True, True, True, False]
    places = [each["place_mm"] for each in told[:3]]
    assert places == pytest.approx([-5.0, 0.0, 4.0], abs=0.7)  # the image's middle is 0.4 mm off the pad's
    assert all(0.2 < each["place_sigma_mm"] < 0.7 for each in told[:3])
    assert told[3]["place_mm"] is None and told[3]["place_sigma_mm"] is None
    assert Path("runs/read.png").read_bytes().startswith(b"\x89PNG")
    said = succeeds("read", names[0], "--untouched", "still.png", *MINI, "--out", "picture.png")
    assert f"place {places[0]:.2f} ±" in said and Path("picture.png").exists()


def test_presses_at_known_places_calibrate_a_flat_pad(pad, json_of):
    words = ("calibrate", "--untouched", "still.png", *MINI, "--force")
    told = json_of(*words, "--presses", table(PLACES), "--out", "unit.npz")
    assert told["presses"] == 5 and told["scatter_mm"] < 0.2 and told["keeps_left_and_right"]
    assert told["pixel_pitch_mm"] == pytest.approx(1e3 * pad.pitch, rel=0.02)
    assert told["place_offset_mm"] == pytest.approx(-0.4, abs=0.15)
    Path("few.csv").write_text("file,place_mm\n" + "".join(f"{y:g}.png,{y}\n" for y in PLACES[1:4]))
    assert json_of(*words, "--presses", "few.csv", "--out", "few.npz")["calibrated_to_mm"] > (told["calibrated_to_mm"])
    save("new.png", ball(pad, -4.0, -1.0))
    (read,) = json_of("read", "new.png", "--calibration", "unit.npz", *MINI)
    # Presses that lie on their line show that middles of imprints are surer on this unit than on any.
    assert 0.1 < json_of("info", "unit.npz")["place_spread"] < 0.9
    assert read["place_mm"] == pytest.approx(-4.0, abs=0.2) and read["place_sigma_mm"] < 0.35
    # From the zero of a machine the scale alone can be told, and the sign of places tells left from right.
    far = json_of(*words, "--presses", table(np.add(PLACES, 80.0)), "--out", "far.npz")
    assert far["place_offset_sigma_mm"] is None and far["pixel_pitch_mm"] == pytest.approx(told["pixel_pitch_mm"])
    mirrored = json_of(*words, "--presses", table(np.negative(PLACES)), "--out", "mirrored.npz")
    assert not mirrored["keeps_left_and_right"]
    assert palpate.load_calibration("unit.npz").place_offset_sigma == pytest.approx(
        1e-3 * told["place_offset_sigma_mm"]
    )


@pytest.mark.parametrize("seed", [15, 18])
def test_a_side_that_covers_the_pad_is_not_read_where_the_pad_ends(folder, json_of, seed):
    unit = draw_unit(dataclasses.replace(GELSIGHT_MINI, pixel_pitch_sigma=0.0), seed)
    unit = dataclasses.replace(unit, offset=(0.0, 0.0), roll=0.0)
    save("still.png", touch_image(unit, None))
    disc = palpate.Disc(0.088)
    save("disc.png", render(unit, disc, (disc.radius, 0.0, np.pi), 8e-4, rng=np.random.default_rng(1)))
    (told,) = json_of("read", "disc.png", "--untouched", "still.png", *MINI)
    assert abs(told["place_mm"]) < 3.0 * told["place_sigma_mm"]


def test_places_are_less_sure_the_wider_the_imprint_and_the_farther_from_what_is_known(pad, json_of):
    disc = palpate.Disc(0.088)
    save("disc.png", render(pad, disc, (disc.radius, 0.0, np.pi), 8e-4, rng=np.random.default_rng(1)))
    calibrate = ("calibrate", "--untouched", "still.png", *MINI, "--presses", table(PLACES), "--out", "unit.npz")
    json_of(*calibrate)
    save("new.png", ball(pad, -4.0, -1.0))
    corner = np.hypot(0.03, 0.03)  # [m] from the middle of the square, which its corner leads
    save("corner.png", render(pad, palpate.Rectangle(0.06, 0.06), (corner, 0.0, 0.75 * np.pi), 8e-4))
    names = ("new.png", "corner.png", "disc.png")
    ball_told, corner_told, side_told = json_of("read", *names, "--calibration", "unit.npz", *MINI)
    # Presses say where this unit shows a ball, little of a corner, and nothing of a side that covers the pad.
    assert ball_told["place_sigma_mm"] < 0.2
    assert corner_told["place_sigma_mm"] > ball_told["place_sigma_mm"]
    assert side_told["place_sigma_mm"] > 1.0


def test_many_presses_make_single_ones_no_surer_than_they_are(pad, json_of):
    places = np.linspace(-6.5, 6.5, 10)
    for y in places:
        save(f"{y:.2f}.png", ball(pad, y))
    # Given to a tenth of a millimetre, so that presses say nothing of smaller errors of middles.
    rows = "".join(f"{y:.2f}.png,{y:.1f}\n" for y in places)
    Path("ten.csv").write_text("file,place_mm\n" + rows)
    json_of("calibrate", "--untouched", "still.png", *MINI, "--presses", "ten.csv", "--out", "ten.npz")
    assert json_of("info", "ten.npz")["place_spread"] > 0.45


def test_presses_tell_the_scale_of_a_pad_of_another_size(folder, json_of):
    unit = next(each for each in (draw_unit(GELSIGHT_MINI, seed) for seed in range(7, 40)) if each.markers is None)
    unit = dataclasses.replace(unit, pitch=1.3 * 6.25e-5, offset=(0.0, 0.0), roll=0.0)
    save("still.png", touch_image(unit, None))
    for y in PLACES:
        save(f"{y:g}.png", ball(unit, y))
    told = json_of("calibrate", "--untouched", "still.png", *MINI, "--presses", table(PLACES), "--out", "unit.npz")
    # A prior that is surer than a pad of another size allows keeps some of its own scale.
    assert told["pixel_pitch_mm"] == pytest.approx(1e3 * unit.pitch, rel=0.03)


def test_a_ball_that_the_border_cuts_off_is_read_by_its_middle(folder, json_of):
    unit = next(each for each in (draw_unit(GELSIGHT_MINI, seed) for seed in range(7, 40)) if each.markers is None)
    unit = dataclasses.replace(unit, pitch=6.25e-5, offset=(0.0, 0.0), roll=0.0)
    save("still.png", touch_image(unit, None))
    save("edge.png", ball(unit, -8.4))
    (told,) = json_of("read", "edge.png", "--untouched", "still.png", *MINI)
    assert told["place_mm"] == pytest.approx(-8.4, abs=0.5)


def test_presses_of_two_units_are_refused_by_name(folder, fails):
    units = [draw_unit(GELSIGHT_MINI, seed) for seed in (8, 11)]  # without dots
    save("still.png", touch_image(units[0], None))
    for y in PLACES:
        save(f"{y:g}.png", ball(units[y == PLACES[3]], y))
    words = ("calibrate", "--untouched", "still.png", *MINI, "--out", "unit.npz", "--presses", table(PLACES))
    assert "3.5.png: image: " in fails(*words) and not Path("unit.npz").exists()


def test_wrong_places_are_refused(pad, fails):
    words = ("calibrate", "--untouched", "still.png", *MINI, "--out", "unit.npz", "--presses")
    assert "are angles right, and the units of angles, places" in fails(*words, table(np.multiply(PLACES, 16.0)))
    assert "place_mm: what the presses show lies" in fails(*words, table([6.0, -6.0, 2.0, -4.0, 5.0]))
    assert not Path("unit.npz").exists()


def test_a_press_on_a_dome_has_a_direction(folder, json_of, fails):
    unit = draw_unit(dataclasses.replace(DIGIT, pixel_pitch_sigma=0.0), 4)
    save("still.png", touch_image(unit, None))
    angles = np.array([-9.0, 0.0, 8.0])
    names = [save(f"{a:g}.png", ball(unit, 1e3 * unit.radius * np.sin(np.radians(a)), 0.0)) for a in angles]
    told = json_of("read", *names, "--untouched", "still.png")
    errors = np.array([each["direction_deg"] for each in told]) - angles
    sigmas = np.array([each["direction_sigma_deg"] for each in told])
    assert (np.abs(errors) < 3.0 * sigmas).all() and (sigmas < 4.0).all() and "place_mm" not in told[0]
    for given, message in (
        ((names[0],), "give either --untouched images or --calibration"),
        ((names[0], "--untouched", "still.png", *MINI), "still.png: found 320 rows and 240 columns"),
        (("gone.png", "--untouched", "still.png"), "gone.png: no such file"),
        (
            (names[0], "--untouched", "still.png", "--model", "mini"),
            "and the touch model is of 'GelSight Mini'",
        ),
        ((names[0], "--untouched", "still.png", "--out", "still.png"), "still.png: already exists"),
    ):
        assert message in fails("read", *given)


def test_images_that_cannot_be_read_are_left_out(folder, run_palpate: Callable[..., tuple[int, str, str]]):
    unit = draw_unit(dataclasses.replace(DIGIT, pixel_pitch_sigma=0.0), 4)
    save("still.png", touch_image(unit, None))
    save("black.png", np.zeros((320, 240, 3), np.uint8))
    code, out, err = run_palpate("read", "black.png", "still.png", "--untouched", "still.png", "--json")
    assert code == 3 and [each["file"] for each in json.loads(out)] == ["still.png"]
    assert "black.png: " in err and len(err.splitlines()) == 1


def test_dots_are_left_out(pad, json_of, fails):
    rows, columns = np.mgrid[18.0:240.0:37.0, 20.0:320.0:33.0]
    dots = np.column_stack((columns.ravel(), rows.ravel())).astype(np.float32)
    wide = dataclasses.replace(pad.markers, dots=dots[np.arange(len(dots)) % 7 > 0], radius=8.5, dark=0.8)
    others = dataclasses.replace(wide, dots=wide.dots + np.float32(16.0))
    still, pressed, other = "wide.png", "wide-ball.png", "others.png"
    unit = dataclasses.replace(pad, markers=wide)
    save(still, touch_image(unit, None))
    save(pressed, ball(unit, -2.0))
    save(other, ball(dataclasses.replace(pad, markers=others), -2.0))
    told = json_of("calibrate", "--untouched", still, *MINI, "--out", "wide.npz")
    covered = len(wide.dots) * np.pi * wide.radius**2 / (240 * 320)
    assert covered < told["markers_share"] < 2.5 * covered  # with their soft edges
    assert json_of("info", "wide.npz")["markers_share"] == pytest.approx(told["markers_share"])
    (read,) = json_of("read", pressed, "--untouched", still, *MINI)
    bare = dataclasses.replace(pad, markers=None)
    save("bare.png", touch_image(bare, None))
    save("bare-ball.png", ball(bare, -2.0))
    (as_bare,) = json_of("read", "bare-ball.png", "--untouched", "bare.png", *MINI)
    assert read["place_mm"] == pytest.approx(as_bare["place_mm"], abs=0.1)
    assert json_of("read", pressed, "--untouched", still, *MINI, "--markers", "off")[0]["contact"]
    assert "of the dots of the untouched gel where they are there" in fails("read", other, "--untouched", still, *MINI)
    names = [save(f"{number}-dots.png", ball(bare if number < 2 else unit, 2.0 * number - 4.0)) for number in range(4)]
    Path("two.csv").write_text("file,place_mm\n" + "".join(f"{name},{2 * k - 4}\n" for k, name in enumerate(names)))
    words = ("calibrate", "--presses", "two.csv", *MINI, "--out", "two.npz", "--untouched")
    assert "two.csv: 0-dots.png: image: shows " in fails(*words, still)
    assert "two.csv: 2-dots.png: image: shows dots, and the untouched gel none" in fails(*words, "bare.png")
