import numpy as np
import pytest

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Polygon
from palpate.lab.simulate.scene import draw_settings
from palpate.lab.simulate.shove import STRONGEST, Finger, Shove
from palpate.lab.simulate.world import World
from palpate.types.sensor import DIGIT

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")

DISC = Disc(0.088)
TEE = Polygon(
    [(-0.1, 0.02), (-0.03, 0.02), (-0.03, -0.12), (0.03, -0.12), (0.03, 0.02), (0.1, 0.02), (0.1, 0.08), (-0.1, 0.08)]
)
POSE, FAR = np.array([0.05, -0.02, 2.0]), np.array([-0.4, 0.0, 0.0])
STEP = 0.002  # [s]


def shoved(shape, shove, frames=40):
    """Return what a shape does that is shoved while the sensor stands far away."""
    world = World(draw_settings(shape, np.random.default_rng(1)), shape, DIGIT, POSE, FAR)
    start = world.object_pose
    world.shove(shove)
    return start, world.run(np.tile(FAR, (frames, 1)))


@pytest.mark.parametrize("shape", [DISC, TEE], ids=["disc", "tee"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_shove_takes_the_pushed_point_along_and_turns_the_object(shape, side):
    point = shape.centroid - np.array([0.03, 0.04 * side])  # pushed along the object's x
    shove = Shove(point, direction=float(POSE[2]), length=0.02, seconds=0.4)
    start, motion = shoved(shape, shove)
    way = se2.transform(motion.object_pose[-1], point) - se2.transform(start, point)
    along = way @ (np.cos(shove.direction), np.sin(shove.direction))
    assert 0.017 < along < 0.022
    assert np.radians(3.0) < side * se2.wrap(float(motion.object_pose[-1, 2] - start[2])) < np.radians(30.0)
    assert motion.knocked.any() and not motion.knocked[12:].any()  # 0.4 s at 30 Hz
    assert np.abs(np.diff(motion.object_pose[25:], axis=0)).max() < 1e-5
    assert not motion.contact.any()


def test_a_finger_pushes_and_never_pulls():
    shove = Shove(np.zeros(2), direction=0.5 * np.pi, length=0.03, seconds=0.3)
    finger = Finger(shove, np.zeros(2), STEP)
    rng, forces = np.random.default_rng(0), []
    while not finger.is_done:
        forces.append(finger.force(rng.uniform(-0.03, 0.06, 2), rng.uniform(-0.5, 0.5, 2)))
    x, y = np.transpose(forces)
    assert x == pytest.approx(0.0, abs=1e-12)
    assert y.min() == 0.0 and y.max() == pytest.approx(STRONGEST)
    assert len(y) == pytest.approx(0.3 / STEP, abs=1)


def test_a_shove_ends_where_the_finger_does():
    short, long = (shoved(DISC, Shove(np.zeros(2), 0.0, length, 0.4))[1].object_pose[-1, 0] for length in (0.01, 0.03))
    assert long - short == pytest.approx(0.02, abs=0.002)


@pytest.mark.parametrize(("length", "seconds"), [(0.0, 0.2), (0.2, 0.2), (0.02, 0.0), (0.02, np.nan)])
def test_bad_shoves_are_named(length, seconds):
    with pytest.raises(SettingError, match=r"shove (length|seconds) is .*; allowed is more than 0, up to"):
        Shove(np.zeros(2), 0.0, length, seconds)
