"""Marks on the gel: what appears thin or small from one image to the next, and stays, is no touch."""

from collections.abc import Iterable

import cv2
import numpy as np
import pytest

from palpate import DIGIT, Background, Calibration
from palpate.touch.contact_detector import ContactDetector

Array = np.ndarray
ROWS, COLUMNS = np.indices((320, 240)).astype(float)
GEL = np.stack([100 + 40 * np.sin(COLUMNS / 60.0), 90 + 0.2 * ROWS, 150 - 0.3 * COLUMNS], axis=-1)


def image(*changes: Array, rng: np.random.Generator | None = None, light: float = 1.0) -> Array:
    """Return an image of the gel with changes (320, 240), with noise and as JPEG if there is an rng."""
    levels = light * GEL + sum(each[..., None] for each in changes)
    if rng is None:
        return np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    noisy = np.clip(np.rint(levels + rng.normal(0.0, 1.5, levels.shape)), 0, 255).astype(np.uint8)
    _, data = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def scratch(levels: float = -50.0, width: float = 4.0, length: float = 110.0) -> Array:
    across = 0.9 * (COLUMNS - 90) + 0.43 * (ROWS - 160)
    along = 0.43 * (COLUMNS - 90) - 0.9 * (ROWS - 160)
    return levels * ((np.abs(across) < 0.5 * width) & (np.abs(along) < 0.5 * length))


def grain(levels: float = 45.0, radius: float = 2.0) -> Array:
    return levels * np.exp(-0.5 * ((COLUMNS - 150) ** 2 + (ROWS - 200) ** 2) / radius**2)


def at_the_corner() -> Array:
    """Return the change by a grain that the image's lower right corner cuts off."""
    return np.roll(grain(45.0, 3.0), (118, 88), axis=(0, 1))


def press(column: float, row: float = 160.0, radius: float = 30.0, levels: float = 60.0) -> Array:
    """Return the change by a ball: bright on one side, dark on the other, with an edge as steep as a gel's skin."""
    right, down = COLUMNS - column, ROWS - row
    inside = 1.0 / (1.0 + np.exp((np.hypot(right, down) - radius) / 2.0))
    return levels * inside * np.clip(right / radius, -1.0, 1.0)


def ridge(column: float) -> Array:
    """Return the change by a corner that stands along the image: a dark line, as thin as a scratch."""
    return -45.0 * np.exp(-0.5 * ((COLUMNS - column) / 2.5) ** 2) * (np.abs(ROWS - 160) < 40)


def detector_of(images: Iterable[Array]) -> tuple[ContactDetector, list[bool]]:
    """Return a detector that knows the gel, and contact at each image."""
    known = Background(GEL.astype(np.float32), np.full((40, 30, 3), 0.5, np.float32))
    detector = ContactDetector(DIGIT, Calibration(known, is_sure=True))
    return detector, [detector.update(detector.read(each)) for each in images]


def learnt(detector: ContactDetector) -> Array:
    assert detector.background is not None
    return detector.background.mean - GEL


@pytest.mark.parametrize("mark", [scratch(), scratch(40.0, 2.0, 60.0), grain(), grain(-40.0, 3.0), at_the_corner()])
def test_a_mark_in_a_contact_becomes_part_of_the_untouched_gel_at_once(mark):
    rng = np.random.default_rng(0)
    places = np.linspace(90.0, 110.0, 20)
    before = [image(press(place), rng=rng) for place in places]
    after = [image(press(place), mark, rng=rng) for place in places[::-1]]
    detector, touched = detector_of([image(rng=rng), *before, *after])
    assert touched == [False] + [True] * 40
    change = learnt(detector).mean(axis=2)
    assert np.abs(change - mark)[np.abs(mark) > 20.0].mean() < 6.0  # of noise and JPEG
    assert np.abs(change[cv2.dilate(np.abs(mark), np.ones((13, 13))) < 1.0]).max() < 1e-3
    assert not any(detector.update(image(mark, rng=rng)) for _ in range(5))


def test_a_mark_that_goes_again_leaves_the_untouched_gel():
    touch = press(100.0)
    detector, _ = detector_of([image(), image(touch), image(touch, scratch()), image(touch)])
    assert np.abs(learnt(detector)).max() < 2.0


def test_two_scratches_at_once_make_no_contact():
    other = np.roll(scratch(40.0), (60, 90), axis=(0, 1))
    assert not any(detector_of([image(), *[image(scratch(), other)] * 10])[1])


SHARP = 60.0 * ((np.abs(COLUMNS - 100) < 20) & (np.abs(ROWS - 150) < 20))
PRESSES = {"ball": press(100.0), "small ball": press(100.0, radius=14.0), "sharp edges": SHARP}


@pytest.mark.parametrize("name", PRESSES)
def test_a_press_within_one_image_is_no_mark(name):
    rng = np.random.default_rng(1)
    moved = np.roll(PRESSES[name], (8, 25), axis=(0, 1))  # by a knock
    touches = [PRESSES[name], PRESSES[name], moved, moved]
    images = [image(rng=rng), *(image(each, rng=rng) for each in touches), image(rng=rng)]
    detector, touched = detector_of(images)
    assert touched == [False, True, True, True, True, False]
    assert np.abs(learnt(detector)).max() < 1e-3


def test_the_thin_imprint_of_a_corner_that_slides_is_no_mark():
    rng = np.random.default_rng(2)
    places = 100.0 + np.cumsum([0.0, 1.0, 4.0, 6.0, 3.0, 8.0, 5.0])
    around = press(110.0, radius=35.0, levels=20.0)
    images = [image(around, ridge(place), rng=rng) for place in places]
    detector, touched = detector_of([image(rng=rng), *images])
    assert all(touched[1:])
    assert np.abs(learnt(detector)).max() < 1e-3


def test_noise_and_light_are_no_marks():
    rng = np.random.default_rng(3)
    images = [image(press(100.0), rng=rng, light=light) for light in (1.0, 1.02, 0.97, 1.1, 1.0)]
    assert np.abs(learnt(detector_of([image(rng=rng), *images])[0])).max() < 1e-3


def test_markers_that_move_are_no_marks():
    dots = np.zeros((320, 240))
    for row in range(20, 320, 30):
        for column in range(20, 240, 30):
            dots[row : row + 8, column : column + 8] = -50.0
    known = Background((GEL + dots[..., None]).astype(np.float32), np.full((40, 30, 3), 0.5, np.float32))
    detector = ContactDetector(DIGIT, Calibration(known, is_sure=True))
    before = learnt(detector)
    for moved in range(4):
        detector.update(detector.read(image(np.roll(dots, moved, axis=1), press(100.0))))
    np.testing.assert_array_equal(learnt(detector), before)
