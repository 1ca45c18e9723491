import numpy as np

from palpate import Disc
from palpate.geometry import se2
from palpate.geometry.lines import closed_outline, ellipses_95


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
    outline = closed_outline(Disc(0.05))
    np.testing.assert_array_equal(outline[0], outline[-1])
    np.testing.assert_allclose(np.hypot(*outline.T), 0.05)
