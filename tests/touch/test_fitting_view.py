"""Images that lie otherwise than the untouched gel of a calibration: turned, mirrored or with exchanged channels."""

import re

import numpy as np
import pytest

from palpate.errors import SettingError
from palpate.lab.simulate.gel import ball_overlap, touch_image
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.touch.background import Background, background_of
from palpate.touch.camera_view import AS_IT_IS, CameraView, views
from palpate.touch.contact_detector import ContactDetector
from palpate.types.sensor import DIGIT

OTHERS = [view for view in views(np.empty((320, 240, 3)), 320, 240) if view != AS_IT_IS]
SIMPLE = [
    CameraView(0, True),
    CameraView(2),
    CameraView(2, True),
    CameraView(channels=(2, 1, 0)),
    CameraView(channels=(1, 0, 2)),
    CameraView(0, True, (1, 0, 2)),
]


@pytest.fixture(scope="module")
def units() -> list[SensorUnit]:
    return [draw_unit(DIGIT, seed) for seed in range(100, 104)]


def seen(unit: SensorUnit, depth: float, rng: np.random.Generator) -> np.ndarray:
    """What a camera sees of a ball of 6 mm radius pressed in by a depth [m]."""
    return touch_image(unit, ball_overlap(unit, 0.006, (0.002, -0.003), depth) if depth else None, rng=rng)


def known(unit: SensorUnit, rng: np.random.Generator) -> Background:
    return background_of(seen(unit, 0.0, rng) for _ in range(15))


def as_seen_in(view: CameraView, image: np.ndarray) -> np.ndarray:
    """What a camera gives whose images lie right once they are read in this view."""
    channels = np.argsort(view.channels)
    unmirrored = image[:, ::-1] if view.mirrored else image
    return np.ascontiguousarray(np.rot90(unmirrored, -view.quarter_turns)[..., channels])


def named(background: Background, image: np.ndarray) -> str:
    """The view that a refused first image is told to fit, in words; nothing where none is."""
    try:
        ContactDetector(background).update(image)
    except SettingError as error:
        found = re.match(
            r"image: lies otherwise than the untouched gel: it fits (.+), [\d.]+ grey levels off", str(error)
        )
        return found[1] if found else ""
    return ""


@pytest.mark.parametrize("view", SIMPLE, ids=str)
def test_the_view_that_fits_is_named_touched_or_not(units, view):
    rng = np.random.default_rng(0)
    for unit in units:
        background = known(unit, rng)
        for depth in (0.0, 1e-3, 2e-3):
            image = seen(unit, depth, rng)
            np.testing.assert_array_equal(view.of(as_seen_in(view, image)), image)
            assert named(background, as_seen_in(view, image)) == str(view)


def test_images_that_lie_as_the_calibration_are_taken_touched_or_in_another_light(units):
    rng = np.random.default_rng(1)
    side = 1.0 + 0.1 * np.linspace(-1.0, 1.0, 240)[:, None] * (1.0, -1.0, 1.0)
    for unit in units:
        background = known(unit, rng)
        for depth in (0.0, 5e-4, 2e-3):
            image = seen(unit, depth, rng)
            lit = np.clip(image * side * (1.2, 0.9, 1.1), 0, 255).astype(np.uint8)
            assert ContactDetector(background).update(image) is (depth > 0.0)
            ContactDetector(background).update(lit)


def test_an_image_of_a_gel_that_looks_alike_in_many_views_is_never_refused_for_one_of_them():
    rng = np.random.default_rng(2)
    rows, columns = np.indices((320, 240)) / 160.0 - 1.0
    dome = (150.0 - 40.0 * (rows**2 + columns**2))[..., None]
    for gel in (np.full((320, 240, 3), 90.0), dome * np.ones(3), dome * (1.0, 0.98, 1.02)):
        still = background_of(np.rint(gel + rng.normal(0.0, 2.0, gel.shape)).astype(np.uint8) for _ in range(15))
        for _ in range(5):
            detector = ContactDetector(still)
            image = np.rint(gel + rng.normal(0.0, 2.0, gel.shape)).astype(np.uint8)
            assert not detector.update(image)
            image[100:200, 60:140] += 40
            assert ContactDetector(still).update(image)


def test_a_stream_whose_camera_turns_is_told_how_it_lies_since(units):
    rng = np.random.default_rng(3)
    detector = ContactDetector()
    for _ in range(20):
        detector.update(seen(units[0], 0.0, rng))
    with pytest.raises(SettingError, match="lies otherwise than the untouched gel: it fits turned by 180 degrees, "):
        detector.update(as_seen_in(CameraView(2), seen(units[0], 0.0, rng)))


def test_real_gels_tell_nearly_every_view_and_none_where_they_lie_right(shared_data):
    import cv2

    files = sorted((shared_data / "digit_backgrounds").glob("*.jpg"))
    assert len(files) == 17
    rng, nothing = np.random.default_rng(4), np.zeros((320, 240, 3), np.float32)
    images = [np.asarray(cv2.imread(str(file)), np.uint8)[..., ::-1] for file in files]
    right, wrong = [], []
    for number, gel in enumerate(images):
        background = Background(gel.astype(np.float32), nothing)
        image = np.clip(np.rint(gel + rng.normal(0.0, 2.0, gel.shape)), 0, 255).astype(np.uint8)
        assert not ContactDetector(background).update(image)
        for view in OTHERS[number % 5 :: 5]:
            said = named(background, as_seen_in(view, image))
            right.append(said == str(view))
            wrong.append(said not in ("", str(view)))
    assert np.mean(right) > 0.95 and not any(wrong)
    # Those of other units are no images of this one that lie otherwise.
    others = [named(Background(gel.astype(np.float32), nothing), image) for gel in images for image in images]
    assert set(others) == {""}
