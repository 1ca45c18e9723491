"""Patch and ellipse: known places and angles on drawn sensors."""

import math

import cv2
import numpy as np
import pytest

from palpate import DIGIT, Background
from palpate.touch.background import background_of
from palpate_lab.paper.images import ellipse_features, patch_outline
from palpate_lab.simulate.gel import ball_overlap, touch_image
from palpate_lab.simulate.unit import SensorUnit, draw_unit


@pytest.fixture(scope="module")
def units() -> list[SensorUnit]:
    return [draw_unit(DIGIT, seed) for seed in range(100, 104)]


def untouched(unit: SensorUnit) -> Background:
    return background_of([unit.no_contact])


def drawn(column: float, row: float, major: float, minor: float, angle: float) -> tuple[np.ndarray, Background]:
    image = np.full((320, 240, 3), 100, np.uint8)
    axes = (round(major / 2), round(minor / 2))
    cv2.ellipse(image, (round(column), round(row)), axes, math.degrees(angle), 0, 360, (160, 140, 120), -1)
    return image, background_of([np.full(image.shape, 100, np.uint8)])


def patch_center(image: np.ndarray, background: Background) -> np.ndarray:
    """The centroid (2,) of the contact patch in pixels (column, row)."""
    outline = patch_outline(image, background)
    assert outline is not None
    moments = cv2.moments(outline)
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


@pytest.mark.parametrize("angle", [0.2, math.pi / 4, math.pi / 2, 0.6 * math.pi, 0.9 * math.pi])
def test_features_of_a_drawn_ellipse(angle):
    image, background = drawn(100, 180, 120, 60, angle)
    column, row, major, minor, cos, sin = ellipse_features(image, background)
    assert (column, row) == pytest.approx((100.5 / 240, 180.5 / 320), abs=0.005)
    assert (major, minor) == pytest.approx((120 / 240, 60 / 240), abs=0.02)
    assert (cos, sin) == pytest.approx((math.cos(angle), math.sin(angle)), abs=0.03)
    assert patch_center(image, background) == pytest.approx((100.0, 180.0), abs=1.0)


def test_noise_moves_the_centre_by_less_than_a_pixel_and_is_no_patch(units):
    rng = np.random.default_rng(2)
    for unit in units:
        background, overlap = untouched(unit), ball_overlap(unit, 0.004, (0.001, 0.001), 5e-4)
        clean = patch_center(touch_image(unit, overlap), background)
        assert np.abs(patch_center(touch_image(unit, overlap, rng=rng), background) - clean).max() < 1.5
        empty = np.clip(unit.no_contact + rng.normal(0.0, 3.0, unit.no_contact.shape), 0, 255).astype(np.uint8)
        for image in (unit.no_contact, empty):
            assert patch_outline(image, background) is None
            assert np.isnan(ellipse_features(image, background)).all()


def test_a_ring_is_filled_in_images_of_any_size():
    for size in (64, 240, 480):
        image = np.full((size, size, 3), 100, np.uint8)
        place = (round(0.6 * size), round(0.4 * size))
        cv2.circle(image, place, size // 5, (180, 180, 180), max(2, size // 20))
        background = background_of([np.full(image.shape, 100, np.uint8)])
        assert patch_center(image, background) == pytest.approx(place, abs=0.01 * size)
        column, _, major, minor, _, _ = ellipse_features(image, background)
        assert (column, major, minor) == pytest.approx((0.6, 0.44, 0.44), abs=0.04)
