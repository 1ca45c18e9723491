"""Images that show neither a touch nor the untouched gel, and cameras that stand still."""

import numpy as np
import pytest

from palpate.errors import SettingError
from palpate.touch.background import Background
from palpate.touch.contact_detector import ContactDetector

ROWS, COLUMNS = 60, 60


def gel(rng: np.random.Generator) -> np.ndarray:
    """A gel whose light comes from all sides in other colours, with a camera's noise of one grey level."""
    rows, columns = np.indices((ROWS, COLUMNS)) / ROWS
    levels = np.stack([100 + 50 * columns, 100 + 40 * np.sin(6.0 * rows), 150 - 60 * rows * columns], axis=-1)
    return np.rint(levels + rng.normal(0.0, 1.0, levels.shape)).astype(np.uint8)


def settled(rng: np.random.Generator) -> ContactDetector:
    detector = ContactDetector()
    for _ in range(20):
        assert not detector.update(gel(rng))
    return detector


UNLIKE = {
    "black": np.zeros((ROWS, COLUMNS, 3), np.uint8),
    "saturated": np.full((ROWS, COLUMNS, 3), 255, np.uint8),
    "noise": np.random.default_rng(1).integers(0, 256, (ROWS, COLUMNS, 3), np.uint8),
}


@pytest.mark.parametrize("name", UNLIKE)
def test_what_shows_no_gel_is_refused_and_changes_nothing(name):
    rng = np.random.default_rng(0)
    detector = settled(rng)
    before = detector.background
    for _ in range(5):
        with pytest.raises(SettingError, match="is unlike the untouched gel"):
            detector.update(UNLIKE[name])
    assert detector.background is before and detector.share < 0.01
    assert not detector.update(gel(rng))
    touched = gel(rng)
    touched[10:30, 10:30] += 40
    assert detector.update(touched)


def test_exchanged_channels_are_named_at_every_frame_against_a_calibration():
    rng = np.random.default_rng(0)
    images = np.array([gel(rng) for _ in range(30)], np.float32)
    detector = ContactDetector(Background(images.mean(axis=0), images.std(axis=0)))
    for _ in range(40):
        with pytest.raises(SettingError, match="lies otherwise than the untouched gel: it fits channels BGR"):
            detector.update(np.ascontiguousarray(gel(rng)[..., ::-1]))


def test_a_camera_that_stands_still_is_refused_until_it_goes_on():
    rng = np.random.default_rng(0)
    detector = settled(rng)
    image = gel(rng)
    for _ in range(6):
        detector.update(image)
    for _ in range(3):
        with pytest.raises(SettingError, match=r"found the same \d times, to the last bit"):
            detector.update(image)
    assert not detector.update(gel(rng))


def test_pictures_without_noise_may_be_the_same():
    detector = ContactDetector()
    image = np.full((ROWS, COLUMNS, 3), 90, np.uint8)
    assert not any(detector.update(image) for _ in range(40))


def test_a_black_frame_is_no_noise_of_a_camera_without():
    image = np.random.default_rng(0).integers(90, 110, (ROWS, COLUMNS, 3)).astype(np.uint8)
    detector = ContactDetector()
    for _ in range(20):
        detector.update(image)
    with pytest.raises(SettingError, match="unlike the untouched gel"):
        detector.update(np.zeros_like(image))
    assert not any(detector.update(image) for _ in range(10))


def test_an_image_that_is_refused_at_first_says_no_size():
    rng = np.random.default_rng(0)
    detector = ContactDetector()
    with pytest.raises(SettingError, match=r"found uint8 \(3, 60, 60\)"):
        detector.update(np.zeros((3, 60, 60), np.uint8))
    assert not any(detector.update(gel(rng)) for _ in range(20))
    assert detector.background is not None


def test_what_was_forgotten_is_learnt_from_the_next_images():
    rng = np.random.default_rng(0)
    detector = settled(rng)
    scratched = [gel(rng) for _ in range(20)]
    for image in scratched:
        image[:, 10:20] //= 2
    assert detector.update(scratched[0])
    detector.forget()
    assert not any(detector.update(image) for image in scratched)
    touched = scratched[0].copy()
    touched[30:50, 30:50] += 40
    assert detector.update(touched)


def test_a_grey_image_is_named_against_an_untouched_gel_in_colours():
    rng = np.random.default_rng(0)
    images = np.array([gel(rng) for _ in range(30)], np.float32)
    detector = ContactDetector(Background(images.mean(axis=0), images.std(axis=0)))
    with pytest.raises(SettingError, match="found grey, expected colours"):
        detector.update(np.repeat(gel(rng)[..., :1], 3, axis=2))
    with pytest.raises(SettingError, match="is unlike the untouched gel"):  # black is no grey picture
        detector.update(UNLIKE["black"])
    assert not detector.update(gel(rng))
