"""Shapes and sensors as plain data, as files hold them."""

from dataclasses import asdict

import pytest

from palpate import DIGIT, POINT, Polygon, Rectangle, SensorProfile, SettingError, ShapeError
from palpate.geometry.shapes import shape_from_dict, shape_to_dict
from palpate.types.sensor import sensor_from_dict

TYPES = "disc, rectangle, ellipse, polygon"


def test_round_trips():
    for shape in (Rectangle(0.051, 0.036), Polygon([(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)])):
        assert shape_from_dict(shape_to_dict(shape)) == shape
    for sensor in (DIGIT, SensorProfile("two", 0.004, ((0.0, -0.02), (0.0, 0.02)))):
        assert sensor_from_dict(asdict(sensor)) == sensor
    assert shape_from_dict({"type": "rectangle", "size_x": 1, "size_y": 2}) == Rectangle(1.0, 2.0)
    assert sensor_from_dict({"name": "point", "radius": 0}) == POINT


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"type": "blob", "radius": 1}, TYPES),
        ({"radius": 1}, TYPES),
        ({"type": ["disc"]}, TYPES),
        ({"type": "disc"}, "radius"),
        ({"type": "disc", "radius": 1, "size": 2}, "size"),
        ({"type": "disc", "radius": "big"}, "radius is 'big'"),
        ({"type": "polygon", "vertices": None}, "polygon vertices"),
        (["disc"], "must be an object"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(data, message):
    with pytest.raises(ShapeError, match=message):
        shape_from_dict(data)


def test_sensors_that_do_not_fit_are_refused():
    refused = {"needed are name": {"name": "x"}, "colour": {"name": "x", "radius": 0, "colour": 1}, "object": "DIGIT"}
    for message, data in refused.items():
        with pytest.raises(SettingError, match=message):
            sensor_from_dict(data)  # pyright: ignore[reportArgumentType]
