import json
import math

import numpy as np
import pytest

from palpate import DIGIT, POINT, SensorProfile, SettingError
from palpate.types.sensor import sensor_from_dict, sensor_to_dict


def test_digit():
    # The apex is the origin and x points out of the gel, so the centre of curvature lies 21 mm behind it.
    np.testing.assert_allclose(DIGIT.centers, [[-0.021, 0.0]])
    assert (DIGIT.image_height, DIGIT.image_width, DIGIT.rate) == (320, 240, 30.0)
    np.testing.assert_array_equal(POINT.centers, [[0.0, 0.0]])


def test_two_fingers():
    fingers = SensorProfile("two fingers", 0.004, ((0.0, -0.02), (0.001, 0.02)))
    np.testing.assert_allclose(fingers.centers, [[-0.004, -0.02], [-0.003, 0.02]])


@pytest.mark.parametrize("sensor", [DIGIT, POINT, SensorProfile("two", 0.004, ((0.0, -0.02), (0.0, 0.02)))])
def test_dict_round_trip(sensor):
    assert sensor_from_dict(json.loads(json.dumps(sensor_to_dict(sensor)))) == sensor


def test_defaults_fill_a_short_dict():
    assert sensor_from_dict({"name": "point", "radius": 0}) == POINT


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("name", ""),
        ("name", 3),
        ("radius", -0.001),
        ("radius", math.nan),
        ("radius", "round"),
        ("rate", 0.0),
        ("rate", math.inf),
        ("half_width", 0.0),
        ("half_width", math.inf),
        ("image_height", -1),
        ("image_height", 320.5),
        ("image_width", True),
        ("image_width", 0),
        ("tips", ()),
        ("tips", ((0.0, math.nan),)),
        ("tips", (0.0, 0.0)),
        ("tips", None),
    ],
)
def test_bad_fields(field, value):
    data = {**sensor_to_dict(DIGIT), field: value}
    with pytest.raises(SettingError, match="columns" if (field, value) == ("image_width", 0) else field[:4]):
        sensor_from_dict(data)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"name": "x"}, "needed are name and radius"),
        ({"name": "x", "radius": 0, "colour": 1}, "colour"),
        ("DIGIT", "object with fields"),
    ],
)
def test_bad_dicts(data, message):
    with pytest.raises(SettingError, match=message):
        sensor_from_dict(data)


def test_outlines_of_flat_and_sharp_pads():
    (sharp,) = SensorProfile("edge", 0.0, half_width=0.01).pads
    assert np.isfinite(sharp).all()
    with pytest.raises(SettingError, match=r"half_width 0\.005 and flat_width 0\.03; the pad must be as wide as"):
        SensorProfile("flat", 0.002, half_width=0.005, flat_width=0.03)
    (flat,) = SensorProfile("flat", 0.002, half_width=0.015, flat_width=0.03).pads
    assert np.abs(flat[:, 1]).max() == pytest.approx(0.015)
