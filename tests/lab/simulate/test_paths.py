import numpy as np

from palpate import Disc
from palpate.geometry.se2 import interpolated
from palpate.geometry.shapes import sharp_corners


def test_sharp_corners_stick_out():
    notched = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 1.0), (0.0, 2.0)])  # the fourth points inwards
    assert sharp_corners(notched).tolist() == [0, 1, 2, 4]
    assert not len(sharp_corners(Disc(1.0).outline(13)))  # 27.7 degrees each
    assert len(sharp_corners(Disc(1.0).outline(11))) == 11  # 32.7


def test_poses_in_between_turn_the_shorter_way():
    time, pose = np.array([0.0, 1.0, 2.0]), np.array([[0.0, 0.0, 3.0], [1.0, 2.0, -3.0], [1.0, 2.0, -3.0]])
    found = interpolated(np.array([-1.0, 0.5, 3.0]), time, pose)
    np.testing.assert_allclose(found[0], pose[0])
    np.testing.assert_allclose(found[1], [0.5, 1.0, np.pi], atol=1e-12)
    np.testing.assert_allclose(found[2], pose[2])
