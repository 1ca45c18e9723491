"""Black dots on a gel: found in its untouched image, and taken off all."""

import numpy as np
import pytest

from palpate.lab.simulate.gel import ball_overlap, touch_image
from palpate.lab.simulate.unit import draw_unit
from palpate.touch.background import Background, has_markers, without_markers
from palpate.touch.contact_detector import ContactDetector
from palpate.types.sensor import DIGIT, GELSIGHT_MINI

MARKED = next(unit for unit in (draw_unit(GELSIGHT_MINI, seed) for seed in range(20)) if unit.markers is not None)
PLAIN = next(unit for unit in (draw_unit(GELSIGHT_MINI, seed) for seed in range(20)) if unit.markers is None)


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_markers_look_as_the_gel_around_them(kind):
    image = touch_image(MARKED, None)
    assert has_markers(image.astype(kind))
    clean = without_markers(image.astype(kind))
    assert clean.dtype == kind
    # A bright speck of dust may be nearby, so not all; the markers themselves were 60 and more levels darker.
    off = np.abs(clean.astype(float) - MARKED.no_contact)
    assert np.quantile(off, 0.99) < 6.0
    assert np.quantile(np.abs(image.astype(float) - MARKED.no_contact), 0.99) > 25.0
    assert not has_markers(clean)


def test_gels_without_markers_have_none():
    assert not has_markers(PLAIN.no_contact)
    for seed in range(5):
        assert not has_markers(draw_unit(DIGIT, seed).no_contact)


@pytest.mark.parametrize("unit", [MARKED, PLAIN])
def test_touch_is_found_and_a_grid_at_rest_is_none(unit):
    rng = np.random.default_rng(0)
    detector = ContactDetector(rate=25.0)

    def update(image):
        return detector.update(detector.read(image))

    assert not any(update(touch_image(unit, None, rng=rng)) for _ in range(30))
    ball = ball_overlap(unit, 0.004, (0.002, 0.001), 4e-4)
    assert update(touch_image(unit, ball, 1.0, rng))
    assert not update(touch_image(unit, None, rng=rng))
    background = detector.background
    assert background is not None and not has_markers(background.mean)
    # What `palpate calibrate` writes is the gel as it is, markers and all.
    calibrated = ContactDetector(Background(touch_image(unit, None).astype(np.float32), background.deviation))
    assert not calibrated.update(calibrated.read(touch_image(unit, None, rng=rng)))
    assert calibrated.update(calibrated.read(touch_image(unit, ball, 1.0, rng)))
