from dataclasses import fields

import numpy as np
import pytest

from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Polygon, Rectangle, Shape
from palpate.lab.simulate.places import kinds
from palpate.lab.simulate.pushes import draw_sequence
from palpate.lab.simulate.world import Motion, World
from palpate.types.sensor import DIGIT

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")

DISC, RECTANGLE = Disc(0.088), Rectangle(0.2363, 0.1579)
TRIANGLE = Polygon([(-0.1, -0.06), (0.1, -0.06), (0.0, 0.12)])


def drawn(shape: Shape = RECTANGLE, seed=7, knocks: int | None = 1, seconds=4.0):
    hand = None if knocks is None else np.random.default_rng(knocks)
    return draw_sequence(shape, kinds(shape)[0], DIGIT, np.random.default_rng(seed), seconds, hand)


def arrays(sequence):
    return {"sensor_pose": sequence.sensor_pose, **{f.name: getattr(sequence.motion, f.name) for f in fields(Motion)}}


def test_without_knocks_nothing_has_changed():
    sequence = drawn(knocks=None)
    assert not sequence.motion.knocked.any()
    # As it was before there were knocks.
    assert sequence.sensor_pose[-1] == pytest.approx((0.05678494, 0.08101066, -2.50069778), abs=1e-6)
    assert sequence.motion.object_pose[-1] == pytest.approx((-0.10723318, 0.0258782, 2.09171468), abs=1e-6)


def test_the_same_seeds_give_the_same_and_nothing_differs_before_the_first_knock():
    plain, first, again, other = (arrays(drawn(knocks=knocks)) for knocks in (None, 1, 1, 2))
    begin = int(np.argmax(first["knocked"]))
    assert begin > 20
    for name, value in first.items():
        assert value.tobytes() == again[name].tobytes(), name
        assert value[:begin].tobytes() == plain[name][:begin].tobytes(), name
    assert first["object_pose"].tobytes() != other["object_pose"].tobytes()


@pytest.mark.parametrize("shape", [DISC, RECTANGLE, TRIANGLE], ids=["disc", "rectangle", "triangle"])
def test_every_sequence_is_knocked_where_a_finger_can_stand(shape, monkeypatch):
    begun = []
    begin = World.shove

    def watched(world, shove):
        begun.append((shove, world.object_pose, world.sensor_pose))
        begin(world, shove)

    monkeypatch.setattr(World, "shove", watched)
    for seed in range(3):
        motion = drawn(shape, seed, seed, 7.0).motion
        assert motion.knocked.any()
        assert motion.indentation.max() < 3e-3
        assert np.isfinite(motion.object_pose).all()
        way = np.hypot(*np.diff(motion.object_pose[:, :2], axis=0).T)
        assert way[motion.knocked[1:]].max() > 2.0 * np.median(way[motion.contact[1:]])
    assert len(begun) >= 3
    for shove, object_pose, sensor_pose in begun:
        gel = se2.transform(sensor_pose, DIGIT.centers[0])
        pushed = se2.transform(object_pose, shove.point)
        assert shape.signed_distance(shove.point) == pytest.approx(0.0, abs=1e-4)
        assert np.hypot(*(pushed - gel)) > DIGIT.radius
        before = pushed - 0.01 * np.array([np.cos(shove.direction), np.sin(shove.direction)])
        assert shape.signed_distance(se2.transform(se2.inverse(object_pose), before)) > 0.005


def test_an_object_shoved_in_a_pause_comes_no_nearer_to_the_sensor():
    found = 0
    for seed in range(4):
        sequence = drawn(DISC, seed, seed, 15.0)
        motion, sensor_pose = sequence.motion, sequence.sensor_pose
        stands = np.append(False, np.abs(np.diff(sensor_pose, axis=0)).max(axis=1) < 1e-12)
        alone = np.flatnonzero(motion.knocked & stands)
        if len(alone):
            found += 1
            first, last = alone[0] - 1, alone[-1] + 5
            away = np.hypot(*(motion.object_pose[:, :2] - se2.compose(sensor_pose, (-DIGIT.radius, 0, 0))[:, :2]).T)
            assert away[last] > away[first] - 1e-4
            assert not motion.contact[first : last + 1].any()
    assert found
