"""Contact from images: shares made by hand, light that changes, scratches, faults and calibrations."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate import DIGIT, Background, Calibration, Disc, Frame, FrameError, SettingError, Tracker, TrackerSettings

Array = np.ndarray
SMALL = replace(DIGIT, image_height=60, image_width=60)
FIRST = 15  # frames of half a second


class Camera:
    """Feeds images to a tracker whose sensor stands at a disc, and tells contact."""

    def __init__(self, calibration: Calibration | None = None, rate=30.0, sensor=SMALL, apart=0.0) -> None:
        sensor = replace(sensor, rate=rate)
        how = TrackerSettings(tactile="none", hypotheses=1)
        self.tracker = Tracker(Disc(0.05), sensor, (0.05 + apart, 0.0, 0.0), how, calibration=calibration)
        self.rate, self.count, self.reason = rate, 0, ""

    def __call__(self, image: Array) -> bool:
        self.count += 1
        estimate = self.tracker.update(Frame(self.count / self.rate, np.zeros(3), image=image))
        self.reason = estimate.reason
        return estimate.contact

    @property
    def background(self) -> Background:
        assert self.tracker.background is not None
        return self.tracker.background


def grey(level: float | tuple[float, ...] = 100.0, size: tuple[int, int] = (60, 60)) -> Array:
    return np.full((*size, 3), level, np.uint8)


def marked(cells: int) -> Array:
    """Return a grey image of 30 x 30 cells of 2 x 2 px, some of them brighter."""
    image = grey()
    for index in range(cells):
        row, column = 2 * (index // 30), 2 * (index % 30)
        image[row : row + 2, column : column + 2] = 150
    return image


def still(image: Array | None = None, deviation: float = 0.0) -> Calibration:
    """Return a calibration of this very stream, of an untouched image."""
    mean = (grey() if image is None else image).astype(np.float32)
    cells = 30 * max(len(mean), mean.shape[1]) // min(mean.shape[:2])  # along the longer side
    return Calibration(Background(mean, np.full((cells, 30, 3), deviation, np.float32)), is_sure=True)


def noisy(image: Array, rng: np.random.Generator, level: float = 0.6) -> Array:
    return np.clip(image + rng.normal(0.0, level, image.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("rate", "frames"), [(30.0, 15), (60.0, 30), (5.0, 8)])
def test_the_first_half_second_is_taken_as_untouched(rate, frames):
    rng, camera = np.random.default_rng(0), Camera(rate=rate)
    images = [rng.integers(97, 104, (60, 60, 3)).astype(np.uint8) for _ in range(frames)]
    for image in images:
        assert camera.tracker.background is None
        assert not camera(image)
    found, expected = camera.background, np.array(images, float)
    np.testing.assert_allclose(found.mean, expected.mean(axis=0), atol=1e-4)
    assert 0.5 < found.noise.min() < found.noise.max() < 1.5  # a deviation of 2 over cells of four pixels


def test_black_images_and_moving_touches_are_not_taken_as_untouched():
    camera = Camera()
    for _ in range(20):
        camera(grey(0.0))
    for column in range(20):
        image = grey()
        image[20:30, 2 * column : 2 * column + 20] = 150
        camera(image)
    assert camera.tracker.background is None
    for _ in range(FIRST):
        camera(marked(9))
    assert (camera.background.mean == marked(9)).all()


def test_one_percent_of_the_cells_begin_a_touch_and_half_of_that_ends_it():
    # Of 900 cells, 4 are 0.44 %, 5 are 0.56 %, 9 are 1 % and 10 are 1.1 %.
    camera = Camera(still())
    cells = [0, 9, 10, 9, 5, 4, 9, 300]
    assert [camera(marked(count)) for count in cells] == [False, False, True, True, True, False, False, True]


@pytest.mark.parametrize(
    ("deviation", "change", "touched"), [(10.0, 39, False), (10.0, 41, True), (0.0, 3, False), (0.0, 5, True)]
)
def test_a_touch_is_four_deviations_of_a_cell_and_at_least_four_levels(deviation, change, touched):
    image = grey()
    image[10:30, 20:50] += change
    assert Camera(still(deviation=deviation))(image) is touched


def test_light_that_fades_in_a_touch_leaves_none_behind():
    rng = np.random.default_rng(1)
    gel = rng.uniform(40.0, 160.0, (60, 60, 3))
    touch = np.zeros((60, 60, 1))
    touch[20:30, 20:30] = 40.0
    camera = Camera(still(gel))

    def image(light: Array, touched: bool) -> Array:
        return np.rint(light * gel + touched * touch).astype(np.uint8)

    assert not camera(image(np.array([1.1, 0.9, 1.05]), False))
    assert all(camera(image(np.array([fade, 1.0, 2.0 - fade]), True)) for fade in np.linspace(1.0, 0.8, 60))
    assert not camera(image(np.array([0.8, 1.0, 1.2]), False))


def test_light_that_wanders_to_one_side_is_followed_and_hides_no_touch():
    # 20 levels from left to right, over 10 s: five times as much as a touch.
    ramp = np.linspace(-1.0, 1.0, 60)[:, None] * 20.0
    camera = Camera(still())
    assert not any(camera(np.rint(grey() + part * ramp).astype(np.uint8)) for part in np.linspace(0.0, 1.0, 300))
    assert np.abs(camera.background.mean - grey() - ramp).max() < 8.0  # it lags by 3 s
    touched = np.rint(grey() + ramp).astype(np.uint8)
    touched[10:30, 5:40] += 20
    assert camera(touched) and Camera(still())(touched)


def line(width: float) -> Array:
    """Return a grey DIGIT image with a dark line across, so many px wide."""
    image = grey(size=(320, 240))
    rows, columns = np.indices(image.shape[:2])
    image[np.abs(0.8 * (columns - 120) + 0.6 * (rows - 160)) < 0.5 * width] -= 60
    return image


def test_a_scratch_is_no_touch():
    known = still(grey(size=(320, 240)), 2.0)
    assert Camera(known, sensor=DIGIT)(line(9.0))  # wider than a cell
    camera = Camera(known, sensor=DIGIT)
    assert not any(camera(line(3.0)) for _ in range(60))
    pressed = line(3.0)
    pressed[100:160, 60:100] += 20
    assert camera(pressed)


def test_stripes_of_a_camera_are_noise():
    rng, levels = np.random.default_rng(7), np.full((320, 240, 3), (100.0, 101.0, 102.0), np.float32)

    def striped() -> Array:
        stripes = np.repeat(rng.normal(0.0, 3.0, (1, 30, 3)), 8, axis=1)
        return (levels + stripes + rng.normal(0.0, 1.0, levels.shape)).astype(np.uint8)

    of_pixels, of_cells = (Background(levels, np.full((40, 30, 3), noise, np.float32)) for noise in (0.8, 3.0))
    unaware, camera = (Camera(Calibration(gel, is_sure=True), sensor=DIGIT) for gel in (of_pixels, of_cells))
    assert any(unaware(striped()) for _ in range(5))
    assert sum(camera(striped()) for _ in range(20)) <= 1
    pressed = striped()
    pressed[100:180, 60:120] += 40
    assert camera(pressed)


def test_markers_are_taken_off():
    rng, camera = np.random.default_rng(3), Camera(sensor=DIGIT)
    dotted = grey((120.0, 90.0, 100.0), (320, 240)).astype(float)
    for row in range(20, 320, 30):
        for column in range(20, 240, 30):
            dotted[row : row + 8, column : column + 8] -= 60.0
    assert not any(camera(noisy(dotted, rng, 1.0)) for _ in range(30))
    assert camera.background.mean.min() > 80.0
    assert not camera(noisy(np.roll(dotted, 4, axis=0), rng, 1.0))  # the skin moves with its dots
    dotted[100:160, 60:120] += 25.0
    assert camera(noisy(dotted, rng, 1.0))


def gel(rng: np.random.Generator) -> Array:
    """Return a gel with different light from all sides, with one level of noise."""
    rows, columns = np.indices((60, 60)) / 60
    levels = np.stack([100 + 50 * columns, 100 + 40 * np.sin(6.0 * rows), 150 - 60 * rows * columns], axis=-1)
    return np.rint(levels + rng.normal(0.0, 1.0, levels.shape)).astype(np.uint8)


def settled(rng: np.random.Generator) -> Camera:
    camera = Camera()
    assert not any(camera(gel(rng)) for _ in range(20))
    return camera


NOISE = np.random.default_rng(1).integers(0, 256, (60, 60, 3), np.uint8)


@pytest.mark.parametrize("image", [grey(0.0), grey(255.0), NOISE], ids=["black", "saturated", "noise"])
def test_an_image_without_a_gel_is_refused_and_changes_nothing(image):
    rng = np.random.default_rng(0)
    camera = settled(rng)
    before = camera.background
    for _ in range(3):
        with pytest.raises(FrameError, match="is unlike the untouched gel"):
            camera(image)
    assert (camera.background.mean == before.mean).all() and not camera(gel(rng))
    touched = gel(rng)
    touched[10:30, 10:30] += 40
    assert camera(touched)


def test_a_camera_that_hangs_is_refused_until_it_goes_on():
    rng = np.random.default_rng(0)
    camera, image = settled(rng), gel(rng)
    for _ in range(10):
        camera(image)
    for _ in range(3):
        with pytest.raises(FrameError, match=r"found the same 1\d times, to the last bit"):
            camera(image)
    assert not camera(gel(rng))
    camera = Camera()
    assert not any(camera(grey()) for _ in range(40))  # images without noise may repeat


def known(rng: np.random.Generator) -> Calibration:
    images = np.array([gel(rng) for _ in range(30)], np.float32)
    return Calibration(Background(images.mean(axis=0), np.full((30, 30, 3), 0.5, np.float32)))


VIEWS = {
    "it fits mirrored, ": lambda image: image[:, ::-1],
    "it fits turned by 180 degrees, ": lambda image: np.rot90(image, 2),
    "it fits channels BGR, ": lambda image: image[..., ::-1],
    "are its light or colours off": lambda image: np.repeat(image[..., :1], 3, axis=2),
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("touched", [False, True])
def test_images_in_another_view_than_the_calibration_are_refused_with_its_name(view, touched):
    rng = np.random.default_rng(0)
    camera, image = Camera(known(rng)), gel(rng)
    image[20:35, 20:40] += 40 * touched
    with pytest.raises(FrameError, match=view):
        camera(np.ascontiguousarray(VIEWS[view](image)))
    assert camera(image) is touched


def test_a_symmetric_gel_is_never_refused_for_its_view():
    rng = np.random.default_rng(2)
    rows, columns = np.indices((60, 60)) / 30.0 - 1.0
    dome = (150.0 - 40.0 * (rows**2 + columns**2))[..., None] * (1.0, 0.98, 1.02)
    for _ in range(5):
        assert not Camera(still(dome, 2.0))(noisy(dome, rng, 2.0))


def checkered(share: float) -> Array:
    """Return a grey image, a share of whose 30 x 30 cells is darker or brighter."""
    cells = np.full(900, 100, np.uint8)
    off = np.random.default_rng(2).permutation(900)[: round(900 * share)]
    cells[off[::2]], cells[off[1::2]] = 50, 150
    return np.broadcast_to(cells.reshape(30, 30).repeat(2, axis=0).repeat(2, axis=1)[..., None], (60, 60, 3)).copy()


def test_a_calibration_is_doubted_until_its_gel_is_seen():
    unsure = replace(still(), is_sure=False)
    camera = Camera(unsure)
    assert Camera(still())(checkered(0.7))
    with pytest.raises(FrameError, match="of the calibration: was that another unit or a touched gel"):
        camera(checkered(0.7))
    for _ in range(20):
        assert camera(checkered(0.5)) and camera.reason.startswith("no image so far looks like the untouched gel")
    assert not camera(checkered(0.0)) and camera.reason == ""
    assert camera(checkered(0.7)) and camera.reason == ""


def test_a_calibration_of_another_size_is_refused_before_any_image():
    with pytest.raises(SettingError, match=re.escape("is of images of 60 x 60 px; those of sensor 'DIGIT' have 320 x")):
        Camera(still(), sensor=DIGIT)


@pytest.mark.parametrize("start", [0.4, 0.8])
def test_light_that_rises_at_the_start_is_not_learnt_as_noise(start):
    rng, camera = np.random.default_rng(0), Camera()
    touched = gel(rng)
    touched[20:35, 20:40] += 12
    for count in range(60):
        light = min(start + (1.0 - start) * count / 20, 1.0)
        assert not camera((light * gel(rng)).astype(np.uint8))
    assert camera.background.noise.max() < 1.5 and camera(touched)


def refused(camera: Camera, images: Any) -> list[bool]:
    found = []
    for image in images:
        try:
            camera(image)
        except FrameError:
            found.append(True)
        else:
            found.append(False)
    return found


@pytest.mark.parametrize(
    "first", [grey(255.0), grey(8.0), np.repeat(gel(np.random.default_rng(1))[..., :1], 3, axis=2)]
)
def test_a_camera_that_is_white_dim_or_grey_for_long_is_learnt_in_colours_in_half_a_second(first):
    rng, camera = np.random.default_rng(0), Camera(apart=0.1)
    assert not any(refused(camera, [first] * 20))
    found = refused(camera, [gel(rng) for _ in range(FIRST + 1)])
    assert found == [first.std() > 0.0] * FIRST + [False]
    touched = gel(rng)
    touched[20:35, 20:40] += 40
    assert camera(touched) and not camera(gel(rng))


def test_light_that_never_is_steady_is_told():
    rng, camera = np.random.default_rng(0), Camera(apart=0.1)
    for count in range(5 * FIRST):
        camera(np.roll(gel(rng), 20 * (count % 3), axis=0))
    assert "not known untouched" in camera.reason


def test_a_steady_view_unlike_the_first_one_is_learnt_anew_away_from_the_object_alone():
    rng = np.random.default_rng(0)
    dim = [(0.15 * gel(rng)).astype(np.uint8) for _ in range(20)]
    camera, touched = Camera(apart=0.1), gel(rng)
    touched[20:35, 20:40] += 40
    assert not any(refused(camera, dim))
    found = refused(camera, [gel(rng) for _ in range(60)])
    assert all(found[:FIRST]) and not any(found[FIRST + 1 :])
    assert camera(touched)  # far from where the object is thought to be, but touched
    assert all(refused(camera, dim * 3)) and not camera(gel(rng))
    assert all(refused(Camera(known(rng), apart=0.1), [image[:, ::-1] for image in dim * 3]))  # it is the user's word
