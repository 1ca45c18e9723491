"""Contact from images of real sensors: untouched, pressed and gripping."""

from pathlib import Path

import numpy as np
import pytest

from palpate.touch.background import first_frames
from palpate.touch.contact_detector import ContactDetector

FIRST = first_frames(30.0)


def noisy(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.clip(np.rint(image + rng.normal(0.0, 2.0, image.shape)), 0, 255).astype(np.uint8)


def read(file: Path) -> np.ndarray:
    import cv2

    return np.ascontiguousarray(np.asarray(cv2.imread(str(file)), np.uint8)[..., ::-1])


def test_real_untouched_gels_give_no_alarm(shared_data):
    """Each real image with camera noise, JPEG at two qualities, flicker, and light that drifts, sideways by 10 %."""
    import cv2

    files = sorted((shared_data / "digit_backgrounds").glob("*.jpg"))
    assert len(files) == 17
    rng = np.random.default_rng(4)
    noise = rng.normal(size=4 * 320 * 240 * 3).astype(np.float32)
    for number, file in enumerate(files):
        gel = read(file).astype(np.float32)
        levels, quality = (1.0, 2.0, 3.0)[number % 3], (95, 80)[number % 2]
        side = np.linspace(-0.1, 0.1, 240)[:, None] * rng.choice([-1.0, 1.0], 3)
        drift = 0.05 * rng.choice([-1.0, 1.0], 3)
        detector = ContactDetector()
        for part in np.linspace(0.0, 1.0, 120):
            light = (1.0 + part * (drift + side) + rng.normal(0.0, 0.003)).astype(np.float32)
            start = int(rng.integers(3 * gel.size))
            image = np.clip(np.rint(gel * light + levels * noise[start : start + gel.size].reshape(gel.shape)), 0, 255)
            done, data = cv2.imencode(".jpg", image.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])
            assert done
            assert not detector.update(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)), file.name


def test_every_real_press_on_a_marked_gel_is_felt(shared_data):
    folder = shared_data / "gelslim_presses"
    untouched = read(folder / "no_contact.jpg")
    presses = sorted(folder.glob("press_*.jpg"))
    assert len(presses) == 12
    rng = np.random.default_rng(5)
    detector = ContactDetector()
    for _ in range(FIRST):
        detector.update(noisy(untouched, rng))
    for press in presses:
        assert not detector.update(noisy(untouched, rng))
        assert detector.update(noisy(read(press), rng)), press.name


@pytest.mark.parametrize("pair", ["02", "05", "07", "12"])
def test_a_real_grip_is_told_from_the_untouched_gel_of_its_pair(shared_data, pair):
    untouched, gripped = (read(shared_data / f"digit_gripped/{pair}_{name}.png") for name in ("untouched", "gripped"))
    rng = np.random.default_rng(6)
    detector = ContactDetector()
    for _ in range(FIRST + 5):
        assert not detector.update(noisy(untouched, rng))
    assert all(detector.update(noisy(gripped, rng)) for _ in range(5))
    assert not detector.update(noisy(untouched, rng))
