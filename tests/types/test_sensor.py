"""Sensor profiles: tips, pads and gaps by hand, and fields that are refused."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate import DIGIT, POINT, Disc, SensorProfile, SettingError

REFUSED: dict[str, tuple[Any, ...]] = {
    "name": ("", 3),
    "radius": (-0.001, math.nan, "round"),
    "rate": (0.0, math.inf),
    "half_width": (0.0, math.inf),
    "image_height": (-1, 320.5, 0),
    "image_width": (True, 0),
    "tips": ((), ((0.0, math.nan),), (0.0, 0.0), None),
}


@pytest.mark.parametrize(("field", "value"), [(field, value) for field, values in REFUSED.items() for value in values])
def test_fields_that_do_not_fit_are_refused(field, value):
    alone = field.startswith("image") and value == 0  # rows without columns, or the reverse
    with pytest.raises(SettingError, match="rows and .* columns" if alone else field):
        replace(DIGIT, **{field: value})


def test_centres_of_curvature_lie_behind_the_tips():
    fingers = SensorProfile("two fingers", 0.004, ((0.0, -0.02), (0.001, 0.02)))
    np.testing.assert_allclose(fingers.centers, [[-0.004, -0.02], [-0.003, 0.02]])
    np.testing.assert_array_equal(POINT.centers, [[0.0, 0.0]])


def test_gap_is_that_of_the_nearest_tip():
    sensor = SensorProfile(name="two", radius=0.01, tips=((0.0, 0.02), (0.0, -0.02)))
    # The object, a disc of 50 mm at (0.2, 0), is looked at along +y from (0.2, -0.1): the tips' centres are
    # 10 mm behind the sensor and 20 mm to the sides. Each is at (+-0.02, -0.11) from the disc's centre.
    pose = np.array([[0.2, -0.1, np.pi / 2]] * 2)
    truth = np.array([[0.2, 0.0, 1.0], [np.nan] * 3])
    gap = sensor.gaps(pose, truth, Disc(0.05))
    assert gap[0] == pytest.approx(np.hypot(0.02, 0.11) - 0.05 - 0.01)
    assert np.isnan(gap[1])
    # Moved 10 mm sideways, one tip is nearer: (0.01, -0.11) or (-0.03, -0.11).
    gap = sensor.gaps(pose + np.array([0.01, 0, 0]), truth, Disc(0.05))
    assert gap[0] == pytest.approx(np.hypot(0.01, 0.11) - 0.06)


def test_outlines_of_flat_and_sharp_pads():
    (sharp,) = SensorProfile("edge", 0.0, half_width=0.01).pads
    assert np.isfinite(sharp).all()
    with pytest.raises(SettingError, match=r"half_width 0\.005 and flat_width 0\.03; the pad must be as wide as"):
        SensorProfile("flat", 0.002, half_width=0.005, flat_width=0.03)
    (flat,) = SensorProfile("flat", 0.002, half_width=0.015, flat_width=0.03).pads
    assert np.abs(flat[:, 1]).max() == pytest.approx(0.015)
