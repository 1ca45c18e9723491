import numpy as np
import pytest
import shapely

from palpate import DIGIT, Disc, Polygon
from palpate.geometry.se2 import interpolated
from palpate.geometry.shapes import sharp_corners
from palpate.models.pushing.contact_geometry import contact_model


def test_sharp_corners_stick_out():
    notched = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 1.0), (0.0, 2.0)])  # the fourth points inwards
    assert sharp_corners(notched)[:, 0].tolist() == [0, 1, 2, 4]
    assert not len(sharp_corners(Disc(1.0).outline(13)))  # 27.7 degrees each
    assert len(sharp_corners(Disc(1.0).outline(11))) == 11  # 32.7


@pytest.mark.parametrize("style", ["bevel", "round"])
def test_a_chamfer_or_a_small_fillet_is_the_corner_that_it_cuts(style):
    cut = shapely.box(-0.05, -0.03, 0.05, 0.03).buffer(-3e-4).buffer(3e-4, join_style=style)
    x, y, bisector, half = contact_model(Polygon(shapely.get_coordinates(cut)), DIGIT).corners.T
    assert set(zip(np.sign(x), np.sign(y), strict=True)) == {(1, 1), (-1, 1), (-1, -1), (1, -1)} and len(x) == 4
    np.testing.assert_allclose((abs(x), abs(y)), ((0.05,) * 4, (0.03,) * 4), atol=3e-4)
    np.testing.assert_allclose(half, np.pi / 4, atol=1e-6)
    np.testing.assert_allclose(np.exp(1j * bisector), -(np.sign(x) + 1j * np.sign(y)) / np.sqrt(2.0), atol=1e-6)


def test_poses_in_between_turn_the_shorter_way():
    time, pose = np.array([0.0, 1.0, 2.0]), np.array([[0.0, 0.0, 3.0], [1.0, 2.0, -3.0], [1.0, 2.0, -3.0]])
    found = interpolated(np.array([-1.0, 0.5, 3.0]), time, pose)
    np.testing.assert_allclose(found[0], pose[0])
    np.testing.assert_allclose(found[1], [0.5, 1.0, np.pi], atol=1e-12)
    np.testing.assert_allclose(found[2], pose[2])
