"""Touch images: geometry of the contact, light, markers, and units compared with real sensors."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from palpate import DIGIT, GELSIGHT_MINI, Disc, Ellipse, Polygon, Rectangle
from palpate_lab.simulate.gel import Side, ball_overlap, prism_overlap, render, touch_image
from palpate_lab.simulate.unit import SensorUnit, draw_unit

SQUARE, SIDE = Rectangle(0.09, 0.09), Side()
UNITS = [draw_unit(DIGIT, seed) for seed in range(6)]
SHADELESS = [replace(unit, shadow=0.0, halo=1.0, fold=1.0, response=0.0, scattered=0.6) for unit in UNITS]
"""Units in which the image changes only at the contact, and evenly."""
CONTACTS = {
    "disc": (Disc(0.05), (-0.05, 0.0), math.pi),
    "edge": (SQUARE, (-0.045, 0.005), math.pi),
    "near corner": (SQUARE, (-0.045, 0.042), math.pi),
    "corner": (SQUARE, (-0.045, 0.045), 0.75 * math.pi),
    "ellipse": (Ellipse(0.105, 0.1309), (-0.0525, 0.0), math.pi),
}


def touching(unit: SensorUnit, point, outward: float, yaw: float, depth: float) -> np.ndarray:
    """Return object_T_sensor of a gel that overlaps a point of an outline and is turned by yaw from facing it."""
    heading = outward + math.pi + yaw
    centre = np.asarray(point) + (unit.radius - depth) * np.array([math.cos(outward), math.sin(outward)])
    return np.array([*(centre + unit.radius * np.array([math.cos(heading), math.sin(heading)])), heading])


def edge_overlap(unit: SensorUnit, yaw: float, depth: float, side: Side = SIDE) -> np.ndarray:
    """Return the overlap with the square's left edge, pressed in the middle."""
    return prism_overlap(unit, SQUARE, touching(unit, (-0.045, 0.0), math.pi, yaw, depth), depth, side)


def centroid(unit: SensorUnit, image: np.ndarray) -> np.ndarray:
    """Return the place (y, z) [m] on the pad at which an image changed, each channel with the same weight."""
    change = np.abs(cv2.GaussianBlur(image.astype(np.float32) - unit.no_contact, (0, 0), 1.5))
    change = np.clip(change - 6.0, 0.0, 60.0)  # no pixel weighs more for being lit strongly
    weight = (change / change.sum(axis=(0, 1))).mean(axis=-1)
    return (unit.place * weight).sum(axis=(1, 2))


def test_same_seed_same_image_and_many_poses_are_as_one_by_one() -> None:
    pose = touching(UNITS[3], (-0.045, 0.0), math.pi, 0.1, 5e-4)
    first, second, third = (
        render(unit, SQUARE, pose, 5e-4, 0.5, np.random.default_rng(seed)).tobytes()
        for unit, seed in ((UNITS[3], 1), (draw_unit(DIGIT, 3), 1), (UNITS[3], 2))
    )
    assert first == second != third
    assert UNITS[3].no_contact.tobytes() != UNITS[4].no_contact.tobytes()
    both, rng = (
        render(UNITS[3], SQUARE, [pose, pose], [5e-4, 0.0], 0.5, np.random.default_rng(1)),
        np.random.default_rng(1),
    )
    assert all(
        (both[k] == render(UNITS[3], SQUARE, pose, depth, 0.5, rng)).all() for k, depth in enumerate((5e-4, 0.0))
    )


def test_units_resemble_real_digits(shared_data) -> None:
    files = sorted((shared_data / "digit_backgrounds").glob("*.jpg"))
    real = np.array([np.asarray(cv2.imread(str(file)))[..., ::-1] for file in files], dtype=float)
    ours = np.array([unit.no_contact for unit in UNITS], dtype=float)
    for images in (real, ours):  # red comes from the left, green from the right
        left, right = images[:, :, :120].mean(axis=(0, 1, 2)), images[:, :, 120:].mean(axis=(0, 1, 2))
        assert left[0] > right[0] + 15.0 and right[1] > left[1] + 4.0
    assert np.abs(real.std(axis=(1, 2)).mean(axis=0) - ours.std(axis=(1, 2)).mean(axis=0)).max() < 9.0
    assert np.abs(real.mean(axis=(0, 1, 2)) - ours.mean(axis=(0, 1, 2))).max() < 9.0
    between = np.abs(ours[:, None] - ours).mean(axis=(2, 3, 4))
    assert between[np.triu_indices(len(ours), 1)].min() > 8.0  # units differ


def test_without_contact_the_image_has_the_cameras_noise_only() -> None:
    unit, pose = UNITS[0], touching(UNITS[0], (-0.045, 0.0), math.pi, 0.0, 0.0)
    assert (render(unit, SQUARE, pose, 0.0) == unit.no_contact).all()
    noisy = render(unit, SQUARE, pose, -1e-3, rng=np.random.default_rng(0)).astype(float) - unit.no_contact
    # Rounding to whole levels adds a variance of 1/12.
    assert noisy.std() == pytest.approx(math.sqrt(unit.noise**2 + 1 / 12), rel=0.02)
    assert abs(noisy.mean()) < 0.02


@pytest.mark.parametrize("name", CONTACTS)
def test_contact_is_visible_from_a_fifth_of_a_millimetre(name: str) -> None:
    shape, point, outward = CONTACTS[name]
    for seed, unit in enumerate(UNITS):
        for yaw in (-0.25, 0.25):
            pose = touching(unit, point, outward, yaw, 2e-4)
            image = render(unit, shape, pose, 2e-4, rng=np.random.default_rng(seed))
            # The published rule: values more than 4 standard deviations off; 1 % of them is a contact.
            changed = np.abs(image.astype(float) - unit.no_contact) > 4.0 * max(unit.noise, 1.0)
            assert changed.mean() > 0.01, (seed, yaw)


@pytest.mark.parametrize("unit", UNITS[:3])
def test_the_patch_on_an_edge_has_the_place_and_size_of_geometry(unit: SensorUnit) -> None:
    for yaw in (-0.2, 0.0, 0.3):
        overlap = edge_overlap(unit, yaw, 3e-4)
        row, column = np.unravel_index(overlap.argmax(), overlap.shape)
        # The deepest point lies towards the edge from the circle's centre: y = -radius sin(yaw), z = 0.
        assert overlap.max() == pytest.approx(3e-4, rel=0.01)
        assert unit.place[0, row, column] == pytest.approx(-unit.radius * math.sin(yaw), abs=2e-4)
    # The chord of a circle of radius r cut off at depth d: half of it is sqrt(2 r d - d^2).
    patch = unit.place[0][160, edge_overlap(unit, 0.0, 3e-4)[160] > 0.0]
    assert 0.5 * np.ptp(patch) == pytest.approx(math.sqrt(2.0 * unit.radius * 3e-4 - 9e-8), rel=0.08)


def test_the_rims_and_a_leaning_side_show_at_their_place() -> None:
    z = UNITS[0].place[1][edge_overlap(UNITS[0], 0.0, 8e-4, Side(-0.004, 0.006)) > 0.0]
    assert (z.min(), z.max()) == (pytest.approx(-0.004, abs=1e-4), pytest.approx(0.006, abs=1e-4))
    # A side that leans back by t from a gel of radius L along the pad touches it at z = -L tan(t).
    unit = replace(UNITS[0], length_radius=0.1, offset=(0.0, 0.0), roll=0.0)
    for tilt in (-0.03, 0.04):
        overlap = edge_overlap(unit, 0.0, 3e-4, Side(-0.01, 0.01, tilt))
        row, _ = np.unravel_index(overlap.argmax(), overlap.shape)
        assert overlap.max() == pytest.approx(3e-4, rel=0.01)
        assert unit.place[1, row, 0] == pytest.approx(-0.1 * math.tan(tilt), abs=3e-4)


def test_a_side_leans_sideways_about_its_middle_and_a_round_one_touches_there():
    unit = draw_unit(GELSIGHT_MINI, 0)
    pose = (0.045 * math.sqrt(2.0) * math.cos(0.25 * math.pi), 0.045, -0.75 * math.pi)  # faces a corner
    y, z = unit.place

    def touched(side: Side) -> np.ndarray:
        return prism_overlap(unit, SQUARE, pose, 5e-4, side) > 0.0

    leaning = touched(Side(-0.003, 0.005, roll=0.2))
    assert np.polyfit(z[leaning], y[leaning], 1)[0] == pytest.approx(math.tan(0.2), rel=0.1)
    assert abs(np.mean(y[leaning & (np.abs(z - 0.001) < 2e-4)])) < 5e-4
    rows = z[touched(Side(-0.003, 0.005, bulge=200.0))]
    assert rows.mean() == pytest.approx(0.001, abs=1e-4)
    assert 0.5 * np.ptp(rows) == pytest.approx(math.sqrt(2.0 * 5e-4 / 200.0), rel=0.15)


@pytest.mark.parametrize("depth", [5e-4, 1e-3])
def test_a_ball_shows_at_its_place(depth: float) -> None:
    rng, off = np.random.default_rng(5), []
    for unit in SHADELESS:
        for place in ((0.0, 0.0), (-0.003, 0.004), (0.004, -0.005)):
            image = touch_image(unit, ball_overlap(unit, 0.003, place, depth), rng=rng)
            off.append(np.hypot(*(centroid(unit, image) - place)))
    assert max(off) < 3e-4


@pytest.mark.parametrize("seed", range(4))
def test_the_shown_angle_is_that_of_the_contacts_column_on_a_nominal_sensor(seed: int) -> None:
    unit = replace(draw_unit(DIGIT, seed), roll=math.radians(3.0 * (seed - 1)))
    for pad_angle in np.radians((-15.0, 0.0, 11.0)):
        away = np.hypot(unit.place[0] - unit.radius * math.sin(pad_angle), unit.place[1])
        column = np.unravel_index(away.argmin(), away.shape)[1]
        shown = math.asin((column - 119.5) * 18.4e-3 / 240 / 21e-3)  # a DIGIT's pad, its columns and its radius
        assert unit.shown_angle(pad_angle) == pytest.approx(shown, abs=0.6 * 18.4e-3 / 240 / 21e-3)
    assert abs(unit.shown_angle(math.radians(95.0))) <= 0.5 * math.pi  # out of sight
    assert draw_unit(GELSIGHT_MINI, seed).shown_angle(0.3) == 0.3


def test_glow_and_bright_flank_are_on_opposite_sides_as_on_a_real_digit(shared_data) -> None:
    folder, unit = shared_data / "digit_balls", UNITS[0]
    files = folder / "untouched.png", folder / "0010.png"
    untouched, press = (np.asarray(cv2.imread(str(file)), float)[..., ::-1] for file in files)
    place = (float(unit.place[0, 0, 120]), float(unit.place[1, 160, 0]))
    ours = touch_image(unit, ball_overlap(unit, 0.005, place, 1e-3)).astype(float)
    column = int(np.abs(press - untouched).sum(axis=(0, 2)).argmax())
    for glow, change, middle in (
        (untouched, press - untouched, column),
        (unit.no_contact, ours - unit.no_contact, 120),
    ):
        for channel, side in ((0, -1.0), (1, 1.0)):  # red glows on the left, green on the right
            halves = glow[:, :120, channel].mean(), glow[:, 120:, channel].mean()
            flanks = change[:, :middle, channel].sum(), change[:, middle:, channel].sum()
            assert side * (halves[1] - halves[0]) > 5.0 and side * (flanks[1] - flanks[0]) < 0.0


def test_a_flat_pad_shows_the_edges_of_what_it_touches() -> None:
    unit = draw_unit(GELSIGHT_MINI, 0)
    outline = [(0.0, 0.03), (0.0, -0.03), (0.02, -0.03), (0.02, -0.01), (0.06, -0.01), (0.06, 0.01), (0.02, 0.01)]
    image = render(unit, Polygon([*outline, (0.02, 0.03)]), (0.0595, 0.0, math.pi), 5e-4, side=Side(-0.004, 0.005))
    # The T's stem ends 20 mm wide, as wide as the pad. Flat on flat has no slopes but at the rims, all across.
    changed = np.abs(image.astype(int) - unit.no_contact).max(axis=-1) > 20
    assert image.shape == (240, 320, 3) and np.ptp(unit.place[0][changed]) > 0.015
    assert not changed[(np.abs(unit.place[1]) < 0.0015) & (np.abs(unit.place[0]) < 0.006)].any()


def test_flat_units_glow_where_they_are_lit_and_half_of_them_have_markers() -> None:
    units = [draw_unit(GELSIGHT_MINI, seed) for seed in range(12)]
    assert 2 < sum(unit.markers is not None for unit in units) < 10
    for unit in units:
        still = touch_image(unit, None).astype(float)
        dark = (np.abs(still - unit.no_contact).max(axis=2) > 8.0).mean()
        assert (0.02 < dark < 0.4) == (unit.markers is not None)
        if unit.markers is None:
            ball = touch_image(unit, ball_overlap(unit, 0.003, (0.0, 0.0), 6e-4)).astype(float) - still
            y, z = unit.place
            towards = y * unit.light[0, 0] + z * unit.light[0, 1]
            near = np.hypot(y, z) < 1.5e-3
            assert np.sum((towards[..., None] * unit.colour[0])[near] * ball[near]) > 0.0
            assert np.sum((unit.illumination[0] - unit.illumination[0].mean()) * towards) > 0.0
