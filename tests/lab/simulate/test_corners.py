import numpy as np

from palpate import Disc
from palpate.lab.simulate.paths import sharp_corners


def test_sharp_corners_stick_out():
    notched = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 1.0), (0.0, 2.0)])  # the fourth points inwards
    assert sharp_corners(notched).tolist() == [0, 1, 2, 4]
    assert not len(sharp_corners(Disc(1.0).outline(13)))  # 27.7 degrees each
    assert len(sharp_corners(Disc(1.0).outline(11))) == 11  # 32.7
