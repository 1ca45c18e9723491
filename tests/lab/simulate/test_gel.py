import math
import time
from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import SettingError
from palpate.geometry.shapes import Disc, Ellipse, Polygon, Rectangle
from palpate.lab.simulate.gel import Side, ball_overlap, gel_height, prism_overlap, render, touch_image
from palpate.lab.simulate.optics import shading
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.types.images import encode_image
from palpate.types.sensor import DIGIT, GELSIGHT_MINI, POINT, sensor_from_dict, sensor_to_dict

SQUARE = Rectangle(0.09, 0.09)
SIDE = Side(-0.01, 0.01)


@pytest.fixture(scope="module")
def units() -> list[SensorUnit]:
    return [draw_unit(DIGIT, seed) for seed in range(6)]


@pytest.fixture(scope="module")
def shadeless(units: list[SensorUnit]) -> list[SensorUnit]:
    """Units in which only what is touched changes, and evenly: not what lies in the shadow of it."""
    return [replace(unit, shadow=0.0, halo=1.0, fold=1.0, response=0.0) for unit in units]


def touching(unit: SensorUnit, point, outward: float, yaw: float, depth: float) -> np.ndarray:
    """object_T_sensor of a gel that overlaps an outline's point by depth and has turned by yaw from facing it."""
    heading = outward + math.pi + yaw
    centre = np.asarray(point) + (unit.radius - depth) * np.array([math.cos(outward), math.sin(outward)])
    return np.array([*(centre + unit.radius * np.array([math.cos(heading), math.sin(heading)])), heading])


CONTACTS = {
    "disc": (Disc(0.05), (-0.05, 0.0), math.pi),
    "edge": (SQUARE, (-0.045, 0.005), math.pi),
    "near corner": (SQUARE, (-0.045, 0.042), math.pi),
    "corner": (SQUARE, (-0.045, 0.045), 0.75 * math.pi),
    "ellipse": (Ellipse(0.105, 0.1309), (-0.0525, 0.0), math.pi),
}


def centroid(unit: SensorUnit, image: np.ndarray) -> np.ndarray:
    """Place (y, z) [m] on the pad of what changed in the image; each channel weighs the same."""
    import cv2

    change = np.abs(cv2.GaussianBlur(image.astype(np.float32) - unit.no_contact, (0, 0), 1.5))
    change = np.clip(change - 6.0, 0.0, 60.0)  # no pixel weighs more for being lit strongly
    weight = (change / change.sum(axis=(0, 1))).mean(axis=-1)
    return (unit.place * weight).sum(axis=(1, 2))


def test_same_seed_same_bytes_and_another_seed_other_data() -> None:
    unit, again, other = draw_unit(DIGIT, 3), draw_unit(DIGIT, 3), draw_unit(DIGIT, 4)
    pose = touching(unit, (-0.045, 0.0), math.pi, 0.1, 5e-4)
    first, second, third = (
        render(each, SQUARE, pose, 5e-4, 0.5, np.random.default_rng(seed))
        for each, seed in ((unit, 1), (again, 1), (unit, 2))
    )
    assert first.shape == (320, 240, 3) and first.dtype == np.uint8
    assert first.tobytes() == second.tobytes() != third.tobytes()
    assert unit.no_contact.tobytes() == again.no_contact.tobytes() != other.no_contact.tobytes()


def test_units_differ_as_real_ones_do(units: list[SensorUnit]) -> None:
    # The 17 real images: means of red 89 to 103, green 96 to 110, blue 87 to 102; spreads 25 to 61, 14 to 30, 15 to 44.
    images = np.array([unit.no_contact for unit in units], dtype=float)
    mean, spread = images.mean(axis=(1, 2)), images.std(axis=(1, 2))
    assert ((mean > (85, 90, 82)) & (mean < (106, 113, 105))).all()
    assert ((spread > (20, 11, 11)) & (spread < (64, 34, 46))).all()
    between = np.abs(images[:, None] - images).mean(axis=(2, 3, 4))
    assert between[np.triu_indices(len(units), 1)].min() > 8.0
    assert len({(unit.radius, unit.pitch, unit.offset, unit.roll) for unit in units}) == len(units)


def test_units_are_like_the_real_ones_side_by_side(units: list[SensorUnit], shared_data) -> None:
    import cv2

    files = sorted((shared_data / "digit_backgrounds").glob("*.jpg"))
    real = np.array([np.asarray(cv2.imread(str(file)))[..., ::-1] for file in files], dtype=float)
    ours = np.array([unit.no_contact for unit in units], dtype=float)
    # Red comes from the left, green from the right, blue from below or evenly.
    for images in (real, ours):
        left, right = images[:, :, :120].mean(axis=(0, 1, 2)), images[:, :, 120:].mean(axis=(0, 1, 2))
        assert left[0] > right[0] + 15.0 and right[1] > left[1] + 5.0
    assert np.abs(real.std(axis=(1, 2)).mean(axis=0) - ours.std(axis=(1, 2)).mean(axis=0)).max() < 9.0


def test_no_contact_is_the_units_image_and_noise_only_where_asked(units: list[SensorUnit]) -> None:
    unit = units[0]
    pose = touching(unit, (-0.045, 0.0), math.pi, 0.0, 0.0)
    assert (render(unit, SQUARE, pose, 0.0) == unit.no_contact).all()
    noisy = render(unit, SQUARE, pose, -1e-3, rng=np.random.default_rng(0)).astype(float) - unit.no_contact
    # Rounding to whole levels adds a variance of 1/12.
    assert noisy.std() == pytest.approx(math.sqrt(unit.noise**2 + 1 / 12), rel=0.02)
    assert abs(noisy.mean()) < 0.02


@pytest.mark.parametrize("name", CONTACTS)
def test_contact_is_visible_from_a_fifth_of_a_millimetre(units: list[SensorUnit], name: str) -> None:
    shape, point, outward = CONTACTS[name]
    for seed, unit in enumerate(units):
        rng = np.random.default_rng(seed)
        for yaw in (-0.25, 0.0, 0.25):
            image = render(unit, shape, touching(unit, point, outward, yaw, 2e-4), 2e-4, rng=rng)
            # The published rule: values more than 4 standard deviations off; 1 % of them is a contact.
            changed = np.abs(image.astype(float) - unit.no_contact) > 4.0 * max(unit.noise, 1.0)
            assert changed.mean() > 0.01, (seed, yaw)


@pytest.mark.parametrize("name", ["edge", "disc", "ellipse"])
def test_patch_rolls_over_the_curved_gel(units: list[SensorUnit], name: str) -> None:
    shape, point, outward = CONTACTS[name]
    sines = np.linspace(-0.12, 0.12, 9)
    for unit in units[:3]:
        poses = (touching(unit, point, outward, math.asin(sine), 4e-4) for sine in sines)
        pressed = np.array([gel_height(unit, prism_overlap(unit, shape, pose, 4e-4, SIDE)) for pose in poses])
        places = (unit.place[0] * pressed).sum(axis=(1, 2)) / pressed.sum(axis=(1, 2))
        slope, _ = np.polyfit(sines, places, 1)
        # On the gel's circle a contact lies at radius * sin(yaw).
        assert -slope == pytest.approx(unit.radius, rel=0.03)


def test_the_flat_edges_patch_is_where_geometry_puts_it(units: list[SensorUnit]) -> None:
    for unit in units:
        for yaw in (-0.2, 0.0, 0.3):
            pose = touching(unit, (-0.045, 0.0), math.pi, yaw, 3e-4)
            overlap = prism_overlap(unit, SQUARE, pose, 3e-4, SIDE)
            row, column = np.unravel_index(overlap.argmax(), overlap.shape)
            # The deepest point lies towards the edge from the circle's centre: y = -radius sin(yaw), z = 0.
            assert overlap.max() == pytest.approx(3e-4, rel=0.01)
            assert unit.place[0, row, column] == pytest.approx(-unit.radius * math.sin(yaw), abs=2e-4)
            # Chord of a circle of radius r cut off at depth d: half of it is sqrt(2 r d - d^2).
            patch = unit.place[0][160, overlap[160] > 0.0]
            half = math.sqrt(2.0 * unit.radius * 3e-4 - 9e-8) * math.cos(yaw)
            if yaw == 0.0:
                assert 0.5 * np.ptp(patch) == pytest.approx(half, rel=0.08)


def test_a_corner_pivots_in_place(units: list[SensorUnit]) -> None:
    unit = units[0]
    shape, point, outward = CONTACTS["corner"]
    # The gel that touches it with its apex turns about it: the patch stays, only the slopes of the two sides change.
    poses = np.array([touching(unit, point, outward + yaw, 0.0, 3e-4) for yaw in (-0.2, 0.2)])
    images = render(unit, shape, poses, 3e-4)
    places = [centroid(unit, image)[0] for image in images]
    assert abs(places[1] - places[0]) < 0.15 * 2.0 * math.sin(0.2) * unit.radius
    assert np.abs(images[0].astype(float) - images[1]).max() > 30.0


def test_image_follows_small_motions_smoothly(units: list[SensorUnit]) -> None:
    # A corner that moves over the pad in steps of a twentieth of a pixel must not flicker with the pixels' grid.
    unit = units[0]
    shape, point, outward = CONTACTS["corner"]
    poses = np.array([touching(unit, point, outward, yaw, 4e-4) for yaw in 0.05 + np.arange(40) * 2e-4])
    heights = [gel_height(unit, prism_overlap(unit, shape, pose, 4e-4, SIDE)) for pose in poses]
    pressed = np.array([height.sum() for height in heights])
    assert np.abs(np.diff(pressed)).max() < 0.01 * pressed.mean()


@pytest.mark.parametrize("depth", [5e-4, 1e-3])
def test_ball_press_is_found_back(shadeless: list[SensorUnit], depth: float) -> None:
    rng = np.random.default_rng(5)
    worst = 0.0
    for unit in shadeless:
        for place in ((0.0, 0.0), (-0.003, 0.004), (0.004, -0.005)):
            image = touch_image(unit, ball_overlap(unit, 0.003, place, depth), rng=rng)
            worst = max(worst, float(np.hypot(*(centroid(unit, image) - place))))
    assert worst < 3e-4


def test_ball_overlap_is_a_cap(units: list[SensorUnit]) -> None:
    overlap = ball_overlap(units[0], 0.003, (0.001, -0.002), 2e-4)
    row, column = np.unravel_index(overlap.argmax(), overlap.shape)
    assert overlap.max() == pytest.approx(2e-4, rel=0.01)
    np.testing.assert_allclose(units[0].place[:, row, column], (0.001, -0.002), atol=1e-4)
    # Ball on a gel of radii R and L: half axes sqrt(2 d / (1/r + 1/R)) across and along.
    inside = units[0].place[:, overlap > 0.0]
    for half, radius in zip(
        0.5 * (np.ptp(inside, axis=1) + units[0].pitch), (units[0].radius, units[0].length_radius), strict=True
    ):
        assert half == pytest.approx(math.sqrt(4e-4 / (1 / 0.003 + 1 / radius)), abs=units[0].pitch)


def test_jpeg_moves_the_patch_by_less_than_a_thirtieth_of_a_millimetre(shadeless: list[SensorUnit]) -> None:
    import cv2

    rng = np.random.default_rng(2)
    moved, sizes = [], []
    for unit in shadeless[:4]:
        for shape, point, outward in CONTACTS.values():
            image = render(unit, shape, touching(unit, point, outward, 0.1, 4e-4), 4e-4, 0.5, rng)
            lossy = encode_image(image, "jpeg")
            sizes.append(len(lossy))
            shown = np.asarray(cv2.imdecode(np.frombuffer(lossy, np.uint8), cv2.IMREAD_COLOR))[..., ::-1]
            moved.append(np.hypot(*(centroid(unit, shown) - centroid(unit, image))))
    assert np.mean(moved) < 1e-3 / 30
    # 450 frames in at most 15 MB.
    assert np.mean(sizes) < 15e6 / 450


def test_shear_moves_the_skirt_and_not_the_contact(shadeless: list[SensorUnit]) -> None:
    unit = shadeless[1]
    pose = touching(unit, (-0.045, 0.0), math.pi, 0.0, 5e-4)
    overlap = prism_overlap(unit, SQUARE, pose, 5e-4, SIDE)
    rest, pushed, pulled = (gel_height(unit, overlap, force) for force in (0.0, 1.0, -1.0))
    deep = overlap > 4.85e-4
    np.testing.assert_allclose(pushed[deep], rest[deep], atol=4e-6)
    # The force along +y pulls the gel beyond the contact along: more height ahead of it, less behind.
    ahead = (overlap == 0.0) & (unit.place[0] > 0.0) & (rest > 2e-5)
    assert (pushed - rest)[ahead].mean() > 1e-6
    assert (pulled - rest)[ahead].mean() < -1e-6


def test_gel_does_not_give_way_at_the_hard_rim(units: list[SensorUnit]) -> None:
    for unit in units:
        height = gel_height(unit, np.full((320, 240), 5e-4, np.float32))
        at_rim = np.abs(unit.place[0]) > unit.half_width
        assert height[160, 120] == pytest.approx(5e-4, rel=1e-3)
        assert not at_rim.any() or height[at_rim].max() < 1e-4


def test_the_objects_rims_show_where_the_span_puts_them(units: list[SensorUnit]) -> None:
    unit = units[0]
    pose = touching(unit, (-0.045, 0.0), math.pi, 0.0, 8e-4)
    overlap = prism_overlap(unit, SQUARE, pose, 8e-4, Side(-0.004, 0.006))
    z = unit.place[1][overlap > 0.0]
    assert (z.min(), z.max()) == (pytest.approx(-0.004, abs=1e-4), pytest.approx(0.006, abs=1e-4))


def test_mounting_moves_and_turns_the_image() -> None:
    unit = draw_unit(DIGIT, 8)
    height, width = 320, 240
    middle = unit.place[:, height // 2 - 1 : height // 2 + 1, width // 2 - 1 : width // 2 + 1].mean(axis=(1, 2))
    np.testing.assert_allclose(middle, unit.offset, atol=1e-6)
    along_row = (unit.place[:, 0, -1] - unit.place[:, 0, 0]) / ((width - 1) * unit.pitch)
    np.testing.assert_allclose(along_row, (math.cos(unit.roll), math.sin(unit.roll)), atol=1e-3)
    assert unit.place[1, 0, 0] > unit.place[1, -1, 0]  # the first row is the upper one


@pytest.mark.parametrize("seed", range(4))
def test_where_a_contact_shows_is_what_the_profile_makes_of_its_column(seed: int) -> None:
    unit = replace(draw_unit(DIGIT, seed), roll=math.radians(3.0 * (seed - 1)))
    for pad_angle in np.radians((-15.0, -4.0, 0.0, 11.0)):
        away = np.hypot(unit.place[0] - unit.radius * math.sin(pad_angle), unit.place[1])
        column = np.unravel_index(away.argmin(), away.shape)[1]
        shown = math.asin((column - 119.5) * 18.4e-3 / 240 / 21e-3)  # a DIGIT's pad, its columns and its radius
        assert unit.shown_angle(pad_angle) == pytest.approx(shown, abs=0.6 * 18.4e-3 / 240 / 21e-3)
    assert abs(unit.shown_angle(math.radians(95.0))) <= 0.5 * math.pi  # out of sight
    flat = draw_unit(GELSIGHT_MINI, seed)
    assert flat.shown_angle(0.3) == 0.3  # the edges of a flat pad lie where they lie


def test_a_side_that_leans_is_met_where_it_comes_closest(units: list[SensorUnit]) -> None:
    # A side that leans back by t from a gel of radius L along the pad touches it at z = -L tan(t).
    unit = replace(units[0], length_radius=0.1, offset=(0.0, 0.0), roll=0.0)
    pose = touching(unit, (-0.045, 0.0), math.pi, 0.0, 3e-4)
    for tilt in (-0.03, 0.0, 0.04):
        overlap = prism_overlap(unit, SQUARE, pose, 3e-4, Side(-0.01, 0.01, tilt))
        row, _ = np.unravel_index(overlap.argmax(), overlap.shape)
        assert overlap.max() == pytest.approx(3e-4, rel=0.01)
        assert unit.place[1, row, 0] == pytest.approx(-0.1 * math.tan(tilt), abs=3e-4)


def test_a_bump_is_lit_where_it_faces_the_light_and_dark_beyond(units: list[SensorUnit]) -> None:
    # One light at a time, from the right: then seen from inside a bump's right flank is bright and its left one dark.
    right = np.array([math.cos(0.2), 0.0, math.sin(0.2)])
    even = np.ones_like(units[0].illumination)
    unit = replace(units[0], light=np.tile(right, (3, 1)), roll=0.0, fold=0.0, illumination=even, halo=0.3)
    bump = ball_overlap(unit, 0.004, (0.0, 0.0), 8e-4)
    column, row = np.abs(unit.place[0, 0]).argmin(), np.abs(unit.place[1, :, 0]).argmin()
    lit, shadeless = (shading(replace(unit, shadow=shadow), gel_height(unit, bump))[row, :, 0] for shadow in (1.0, 0.0))
    flank, beyond = round(1.5e-3 / unit.pitch), round(3e-3 / unit.pitch)
    assert lit[column + flank] > 20.0 > -20.0 > lit[column - flank]
    assert lit[column - beyond] < shadeless[column - beyond] - 5.0
    np.testing.assert_allclose(lit[column + beyond :], shadeless[column + beyond :], atol=1.0)


def test_glow_and_bright_flank_of_a_light_are_on_opposite_sides(shared_data) -> None:
    import cv2

    # Red and green of the real DIGIT's untouched gel and of its presses, and of the simulated units of its kind.
    folder = shared_data / "digit_balls"
    untouched = np.asarray(cv2.imread(str(folder / "untouched.png")), float)[..., ::-1]
    press = np.asarray(cv2.imread(str(folder / "0010.png")), float)[..., ::-1]
    unit = draw_unit(DIGIT, 0)
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


def test_many_poses_are_as_one_by_one(units: list[SensorUnit]) -> None:
    poses = np.array([touching(units[0], (-0.05, 0.0), math.pi, yaw, 4e-4) for yaw in (-0.1, 0.2)])
    both = render(units[0], Disc(0.05), poses, [4e-4, 0.0], 0.3, np.random.default_rng(1))
    rng = np.random.default_rng(1)
    single = [
        render(units[0], Disc(0.05), pose, depth, 0.3, rng) for pose, depth in zip(poses, (4e-4, 0.0), strict=True)
    ]
    assert (both == np.stack(single)).all()
    assert render(units[0], Disc(0.05), np.empty((0, 3)), []).shape == (0, 320, 240, 3)


def test_flat_gelsight_mini_and_a_concave_outline() -> None:
    assert sensor_from_dict(sensor_to_dict(GELSIGHT_MINI)) == GELSIGHT_MINI
    unit = draw_unit(GELSIGHT_MINI, 0)
    side = [(0.0, 0.03), (0.0, -0.03), (0.02, -0.03), (0.02, -0.01), (0.06, -0.01), (0.06, 0.01), (0.02, 0.01)]
    image = render(unit, Polygon([*side, (0.02, 0.03)]), (0.0595, 0.0, math.pi), 5e-4, side=Side(-0.004, 0.005))
    assert image.shape == (240, 320, 3)
    # The T's stem ends 20 mm wide, as wide as the pad. Flat on flat has no slopes but at the rims, all across.
    changed = np.abs(image.astype(int) - unit.no_contact).max(axis=-1) > 20
    assert np.ptp(unit.place[0][changed]) > 0.015
    middle = (np.abs(unit.place[1]) < 0.0015) & (np.abs(unit.place[0]) < 0.006)
    assert not changed[middle].any()


def test_wrong_settings_are_named(units: list[SensorUnit]) -> None:
    with pytest.raises(SettingError, match=r"'point' has 0 rows"):
        draw_unit(POINT, 0)
    with pytest.raises(SettingError, match=r"a side is from 0\.001"):
        render(units[0], SQUARE, (0.0, 0.0, 0.0), 1e-4, side=Side(0.001, 0.002))


def test_hundred_images_a_second_on_one_core(units: list[SensorUnit]) -> None:
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        poses = np.array([touching(units[0], (-0.045, 0.0), math.pi, yaw, 4e-4) for yaw in np.linspace(-0.2, 0.2, 25)])
        render(units[0], SQUARE, poses[:2], 4e-4)
        start = time.process_time()
        render(units[0], SQUARE, poses, 4e-4, 0.5, np.random.default_rng(0))
        rate = len(poses) / (time.process_time() - start)
    finally:
        cv2.setNumThreads(threads)
    assert rate > 60.0  # 250 on a free core
