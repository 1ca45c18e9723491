"""Shapes as plain data, their sharp corners, and the closed lines that figures draw."""

import json

import numpy as np
import pytest

from palpate import Disc, Ellipse, Polygon, Rectangle, ShapeError
from palpate.geometry import se2
from palpate.geometry.polygon import sharp_corners
from palpate.geometry.se2 import ellipses_95
from palpate.geometry.shapes import shape_from_dict, shape_to_dict

SHAPES = [Disc(0.088), Rectangle(0.051, 0.036), Ellipse(0.4, 0.05), Polygon([(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)])]


@pytest.mark.parametrize("shape", SHAPES, ids=repr)
def test_dict_round_trip(shape):
    assert shape_from_dict(json.loads(json.dumps(shape_to_dict(shape)))) == shape


def test_dict_by_hand():
    assert shape_to_dict(Disc(0.088)) == {"type": "disc", "radius": 0.088}
    assert shape_from_dict({"type": "rectangle", "size_x": 1, "size_y": 2}) == Rectangle(1.0, 2.0)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"type": "blob", "radius": 1}, "disc, rectangle, ellipse, polygon"),
        ({"radius": 1}, "disc, rectangle, ellipse, polygon"),
        ({"type": ["disc"]}, "disc, rectangle, ellipse, polygon"),
        ({"type": "disc"}, "radius"),
        ({"type": "disc", "radius": 1, "size": 2}, "size"),
        ({"type": "disc", "radius": "big"}, "radius is 'big'"),
        ({"type": "polygon", "vertices": None}, "polygon vertices"),
        (["disc"], "object with fields"),
    ],
)
def test_bad_dicts(data, message):
    with pytest.raises(ShapeError, match=message):
        shape_from_dict(data)


def test_sharp_corners_stick_out():
    notched = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 1.0), (0.0, 2.0)])  # the fourth points inwards
    assert sharp_corners(notched).tolist() == [0, 1, 2, 4]
    assert not len(sharp_corners(Disc(1.0).outline(13)))  # 27.7 degrees each
    assert len(sharp_corners(Disc(1.0).outline(11))) == 11  # 32.7


def test_ellipses_hold_95_percent_of_what_is_drawn():
    rng = np.random.default_rng(5)
    pose = np.array([0.3, -0.2, 2.0])
    root = np.array([[0.02, 0.0, 0.0], [0.012, 0.004, 0.0], [0.1, 0.0, 0.2]])
    drawn = (rng.normal(size=(20000, 3)) @ root.T)[:, :2]  # in the object's frame
    ellipse = se2.transform(se2.inverse(pose), ellipses_95(pose[None], (root @ root.T)[None])[0])
    np.testing.assert_allclose(ellipse[0], ellipse[-1], atol=1e-12)
    edges = np.roll(ellipse[:-1], -1, axis=0) - ellipse[:-1]
    to = drawn[:, None] - ellipse[:-1]
    side = edges[:, 0] * to[..., 1] - edges[:, 1] * to[..., 0]
    inside = (np.sign(side) == np.sign(side[:, :1])).all(axis=1).mean()
    assert 0.94 < inside < 0.96


def test_an_outline_is_closed():
    outline = Disc(0.05).closed_outline
    np.testing.assert_array_equal(outline[0], outline[-1])
    np.testing.assert_allclose(np.hypot(*outline.T), 0.05)
