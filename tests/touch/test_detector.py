"""Contact from images: simulated touches, shares made by hand, and drifting light."""

import time
import tracemalloc

import numpy as np
import pytest

from palpate.errors import SettingError
from palpate.lab.simulate.gel import ball_overlap, touch_image
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.touch.background import Background, background_of, check_image
from palpate.touch.contact_detector import END, START, ContactDetector
from palpate.types.images import decode_image, encode_image
from palpate.types.sensor import DIGIT

FIRST = 15
"""Frames of half a second at 30 Hz."""


@pytest.fixture(scope="module")
def units() -> list[SensorUnit]:
    return [draw_unit(DIGIT, seed) for seed in range(100, 104)]


def seen(unit: SensorUnit, depth: float, rng: np.random.Generator) -> np.ndarray:
    """What a camera sees of a ball of 4 mm radius pressed in by a depth [m], through JPEG."""
    overlap = ball_overlap(unit, 0.004, (0.002, -0.003), depth) if depth else None
    return decode_image(encode_image(touch_image(unit, overlap, rng=rng)), "jpeg", (320, 240))


def grey(level: float | tuple[float, ...] = 100.0, size: tuple[int, int] = (60, 60)) -> np.ndarray:
    return np.full((*size, 3), level, np.uint8)


def marked(cells: int) -> np.ndarray:
    """A grey image of 60 x 60 px, of whose 30 x 30 cells of 2 x 2 px some are brighter."""
    image = grey()
    for index in range(cells):
        row, column = 2 * (index // 30), 2 * (index % 30)
        image[row : row + 2, column : column + 2] = 150
    return image


def still(level: float = 100.0) -> Background:
    return Background(grey(level).astype(np.float32), np.zeros((60, 60, 3), np.float32))


def test_a_ball_is_felt_from_a_fifth_of_a_millimetre_on_and_gone_when_it_is(units):
    rng = np.random.default_rng(0)
    for unit in units:
        detector = ContactDetector()
        depths = [0.0] * 20 + [2e-4] * 3 + [0.0] * 3 + [8e-4] * 3 + [0.0] * 3
        felt = [detector.update(seen(unit, depth, rng)) for depth in depths]
        assert felt == [depth > 0.0 for depth in depths]


def test_first_frames_are_taken_as_untouched():
    rng = np.random.default_rng(0)
    images = [rng.integers(97, 104, (60, 60, 3)).astype(np.uint8) for _ in range(FIRST)]
    detector = ContactDetector()
    for image in images:
        assert detector.background is None
        assert detector.update(image) is False
    found, expected = detector.background, np.array(images, float)
    assert found is not None and found.mean.dtype == found.deviation.dtype == np.float32
    assert np.allclose(found.mean, expected.mean(axis=0), atol=1e-4)
    assert np.allclose(found.deviation, expected.std(axis=0, ddof=1), atol=1e-4)


def test_first_frames_of_any_rate_are_not_kept():
    detector = ContactDetector(rate=1e6)
    image = grey(size=(100, 100))
    detector.update(image)
    tracemalloc.start()
    for _ in range(100):
        detector.update(image.copy())
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert detector.background is None
    assert kept < 40 * image.nbytes


def test_shares_are_of_cells_and_the_end_lies_below_the_start():
    # Of 900 cells, 4 are 0.44 %, 5 are 0.56 %, 9 are 1 % and 10 are 1.1 %.
    assert START == 0.01 and END == 0.005
    detector = ContactDetector(still())
    sequence = [(0, False), (9, False), (10, True), (9, True), (5, True), (4, False), (9, False), (900 // 3, True)]
    for cells, touched in sequence:
        assert detector.update(marked(cells)) is touched
        assert detector.share == pytest.approx(cells / 900)


def test_four_deviations_of_a_cell_and_never_less_than_four_levels():
    # Pixels of 10 levels are cells of 10 here: 2 x 2 px share their noise. Changes of 39 and 41 are 3.9 and 4.1.
    noisy = Background(still().mean, np.full((60, 60, 3), 10.0, np.float32))
    for background, change, touched in ((noisy, 39, False), (noisy, 41, True), (still(), 3, False), (still(), 5, True)):
        image = grey()
        image[10:30, 20:50] += change
        assert ContactDetector(background).update(image) is touched


def test_a_brighter_light_is_no_touch_and_fading_during_one_leaves_none_behind():
    rng = np.random.default_rng(1)
    gel = rng.uniform(40.0, 160.0, (60, 60, 3))
    untouched = Background(gel.astype(np.float32), np.zeros((60, 60, 3), np.float32))
    touch = np.zeros((60, 60, 1))
    touch[20:30, 20:30] = 40.0
    detector = ContactDetector(untouched)

    def image(light: np.ndarray, touched: bool) -> np.ndarray:
        return np.rint(light * gel + touched * touch).astype(np.uint8)

    assert not detector.update(image(np.array([1.1, 0.9, 1.05]), False))
    for fade in np.linspace(1.0, 0.8, 60):
        assert detector.update(image(np.array([fade, 1.0, 2.0 - fade]), True))
    assert not detector.update(image(np.array([0.8, 1.0, 1.2]), False))


def test_the_light_is_told_until_the_background_has_followed_it():
    detector = ContactDetector(still(100.0))
    detector.update(grey(100.0))
    np.testing.assert_allclose(detector.light, 1.0)
    rng = np.random.default_rng(0)
    others = [(grey((100.0, 70.0, 130.0)) + rng.integers(2, size=(60, 60, 3))).astype(np.uint8) for _ in range(300)]
    detector.update(others[0])
    np.testing.assert_allclose(detector.light, [1.0, 0.7, 1.3], atol=0.01)
    for other in others:
        detector.update(other)
    np.testing.assert_allclose(detector.light, 1.0, atol=0.03)


def test_follows_a_slow_drift_of_one_side():
    # 20 levels from left to right, over 20 s: five times what would be taken for a touch.
    ramp = np.linspace(-1.0, 1.0, 60)[:, None] * 20.0
    detector = ContactDetector(still())
    for part in np.linspace(0.0, 1.0, 600):
        assert not detector.update(np.rint(grey() + part * ramp).astype(np.uint8))
    followed = detector.background
    # It lags 3 s behind a drift of 1 level/s at the edge.
    assert followed is not None and np.abs(followed.mean - grey() - ramp).max() < 4.0


def test_light_that_wanders_to_one_side_is_no_touch_and_hides_none():
    ramp = np.linspace(-1.0, 1.0, 60)[:, None] * 20.0
    detector = ContactDetector(still())
    assert not detector.update(np.rint(grey() + ramp).astype(np.uint8))
    touched = np.rint(grey() + ramp).astype(np.uint8)
    touched[10:30, 5:40] += 20  # a fifth of the image
    assert detector.update(touched)
    assert detector.share == pytest.approx(20 * 35 / 3600, abs=0.01)


def test_half_a_second_of_any_rate_is_taken_and_never_few():
    for rate, frames in ((30.0, 15), (60.0, 30), (5.0, 8)):
        detector = ContactDetector(rate=rate)
        for number in range(frames):
            assert detector.background is None, number
            detector.update(grey())
        assert detector.background is not None


def test_what_is_forgotten_while_it_is_gathered_is_not_taken_as_untouched():
    detector = ContactDetector()
    for number in range(FIRST - 5 + FIRST):
        assert detector.background is None, number
        if number == FIRST - 5:
            detector.forget()
        detector.update(grey())
    assert detector.background is not None


def test_black_frames_and_a_touch_that_moves_are_not_taken_as_untouched():
    detector = ContactDetector()
    for _ in range(20):
        detector.update(grey(0.0))
    for column in range(20):  # something slides over the gel
        image = grey()
        image[20:30, 2 * column : 2 * column + 20] = 150
        detector.update(image)
    assert detector.background is None
    for _ in range(FIRST):
        detector.update(grey())
    assert detector.background is not None and (detector.background.mean == 100.0).all()


def test_images_of_another_size_than_the_sensors_are_refused_from_the_first():
    with pytest.raises(SettingError, match="turned by a quarter"):
        ContactDetector(size=(320, 240)).update(grey(size=(240, 320)))


def test_a_resting_touch_is_not_swallowed():
    detector = ContactDetector(still())
    assert all(detector.update(marked(20)) for _ in range(1000))
    assert detector.background is not None and (detector.background.mean == 100.0).all()
    assert not detector.update(marked(0))


def noisy(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return (image + rng.normal(0.0, 0.6, image.shape)).astype(np.uint8)


@pytest.mark.parametrize("before", range(5))  # frames, of which each fifth is what the background follows
def test_what_a_touch_leaves_behind_is_the_untouched_gel_from_then_on(before):
    rng = np.random.default_rng(8)
    detector = ContactDetector(still())
    assert not any(detector.update(noisy(marked(0), rng)) for _ in range(before))
    assert all(detector.update(noisy(marked(300), rng)) for _ in range(20))
    found = [detector.update(noisy(marked(12), rng)) for _ in range(40)]
    assert found == [True] * 4 + [False] * 36  # five images in a row
    assert detector.background is not None and detector.background.mean[0, 1] == pytest.approx(150.0, abs=3.0)
    assert detector.update(noisy(marked(300), rng))


def test_a_touch_that_wanes_or_moves_on_or_shows_more_goes_on():
    rng = np.random.default_rng(9)
    waning = [300] * 20 + [round(300 * 0.9**count) for count in range(1, 33)]
    detector = ContactDetector(still())
    assert all(detector.update(noisy(marked(count), rng)) for count in waning if count > 9)
    moving = [np.roll(marked(12), 2 * count, axis=0) for count in range(20)]
    for after in (moving, [marked(25)] * 20):
        detector = ContactDetector(still())
        assert all(detector.update(noisy(image, rng)) for image in [marked(300)] * 20 + after)


def test_deviation_follows_too():
    rng = np.random.default_rng(2)
    detector = ContactDetector(still())
    for _ in range(450):
        detector.update((grey() + rng.normal(0.0, 2.5, (60, 60, 3))).astype(np.uint8))
    assert detector.background is not None
    assert np.sqrt((detector.background.deviation**2).mean()) == pytest.approx(2.5, rel=0.05)


def line(width: float) -> np.ndarray:
    """A grey image of 320 x 240 px with a dark line across, so many px wide."""
    image = grey(size=(320, 240))
    rows, columns = np.indices(image.shape[:2])
    image[np.abs(0.8 * (columns - 120) + 0.6 * (rows - 160)) < 0.5 * width] -= 60
    return image


def test_a_scratch_is_no_touch_and_is_learnt():
    rng = np.random.default_rng(6)
    images = [(grey(size=(320, 240)) + rng.normal(0.0, 2.0, (320, 240, 3))).astype(np.uint8) for _ in range(FIRST)]
    detector = ContactDetector(background_of(images))
    assert detector.update(line(9.0))  # wider than a cell
    assert not any(detector.update(line(3.0)) for _ in range(300))
    found = detector.background
    assert found is not None and np.abs(found.mean - line(3.0)).max() < 4.0
    pressed = line(3.0)
    pressed[100:160, 60:100] += 20
    assert detector.update(pressed)


def test_stripes_that_cells_share_are_noise():
    rng = np.random.default_rng(7)

    def striped() -> np.ndarray:
        stripes = np.repeat(rng.normal(0.0, 3.0, (1, 30, 3)), 8, axis=1)
        return (100.0 + stripes + rng.normal(0.0, 1.0, (320, 240, 3))).astype(np.uint8)

    known = background_of(striped() for _ in range(FIRST))
    by_pixels = Background(known.mean, known.deviation)
    assert np.sqrt(np.mean(known.noise**2)) == pytest.approx(3.0, rel=0.15)
    assert np.sqrt(np.mean(by_pixels.noise**2)) < 1.0
    assert any(ContactDetector(by_pixels).update(striped()) for _ in range(5))
    detector = ContactDetector(known)
    # One stripe that is beyond 4 deviations is as large as a touch.
    assert sum(detector.update(striped()) for _ in range(20)) <= 1
    pressed = striped()
    pressed[100:180, 60:120] += 40
    assert detector.update(pressed)


def test_of_few_images_noise_is_what_cells_have_in_common():
    rng = np.random.default_rng(8)
    few = background_of(grey() + rng.integers(-8, 9, (60, 60, 3)).astype(np.uint8) for _ in range(2))
    # Of two values the deviation of each cell spreads from nothing to several times the true one.
    assert few.noise.max() / few.noise.min() < 2.0


def test_takes_well_under_a_millisecond(units):
    rng = np.random.default_rng(0)
    images = [touch_image(units[0], None, rng=rng) for _ in range(FIRST)]
    detector, took = ContactDetector(), []
    for image in images * 6:
        begin = time.perf_counter()
        detector.update(image)
        took.append(time.perf_counter() - begin)
    assert np.median(took[FIRST:]) < 1e-3


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((320, 240, 3), np.float32), "float32"),
        (np.zeros((240, 320, 3), np.uint8), "turned by a quarter"),
        (np.zeros((3, 320, 240), np.uint8), "channels first"),
        (np.zeros((320, 240), np.uint8), r"\(320, 240\)"),
        ([1, 2, 3], "list"),
    ],
)
def test_other_images_are_refused(image, words):
    with pytest.raises(SettingError, match=words) as error:
        check_image(image, 320, 240)
    assert "uint8 (320, 240, 3)" in str(error.value)
    level = np.full((320, 240, 3), 100.0, np.float32)
    detector = ContactDetector(Background(level, level))
    with pytest.raises(SettingError):
        detector.update(image)


def test_images_must_not_change_their_size():
    detector = ContactDetector()
    detector.update(grey())
    with pytest.raises(SettingError, match=r"found uint8 \(62, 60, 3\); expected uint8 \(60, 60, 3\)"):
        detector.update(grey(size=(62, 60)))
