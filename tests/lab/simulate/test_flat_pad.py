"""Pushing with a flat pad or a hand of two fingers, and what the images of a pad show."""

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Rectangle
from palpate.io.cmu_two_finger import HAND
from palpate.lab.simulate.gel import ball_overlap, touch_image
from palpate.lab.simulate.places import draw_touch
from palpate.lab.simulate.pushes import draw_sequence
from palpate.lab.simulate.scene import WorldSettings
from palpate.lab.simulate.unit import draw_unit
from palpate.lab.simulate.world import World
from palpate.types.sensor import DIGIT, GELSIGHT_MINI

SQUARE = Rectangle(0.09, 0.09)
FEET = 0.04 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])


@pytest.mark.parametrize("tilt", [-3.0, 0.0, 3.0])
def test_a_side_is_turned_towards_the_pad(tilt):
    yaw = math.radians(tilt)
    start = np.array([-0.049, 0.0, yaw])
    world = World(WorldSettings(feet=FEET), SQUARE, GELSIGHT_MINI, np.zeros(3), start)
    path = start + np.linspace(0.0, 0.03, 50)[1:, None] * np.array([1.0, 0.0, 0.0])
    motion = world.run(path)
    assert motion.contact[-1]
    turned = motion.object_pose[-1, 2]
    # 26 mm of pushing bring side and pad nearer; a round tip in the middle would not turn the square at all.
    assert abs(turned - yaw) < 0.5 * abs(yaw) + 1e-3
    assert 1.5 < motion.normal_force[-10:].mean() < 3.0
    assert 1e-4 < motion.indentation[-1] < 1e-3


@pytest.mark.parametrize(("y", "fingers"), [(0.0, 2), (-0.04, 1)])
def test_both_fingers_push_the_middle_of_a_side_and_one_its_end(y, fingers):
    hand = replace(HAND, rate=30.0)
    start = np.array([-0.046, y, 0.0])
    world = World(WorldSettings(feet=FEET, gel_stiffness=4000.0), SQUARE, hand, np.zeros(3), start)
    path = start + np.linspace(0.0, 0.015, 200)[1:, None] * np.array([1.0, 0.0, 0.0])
    motion = world.run(path)
    depth = hand.radius - SQUARE.signed_distance(
        se2.transform(se2.between(motion.object_pose, path)[:, None], hand.centers)
    )
    assert (depth[-1] > 0.0).sum() == fingers
    # Each is a spring of its own, and two of them are in by the same depth.
    force, indentation = motion.normal_force[-100:].mean(), motion.indentation[-100:].mean()
    assert force == pytest.approx(fingers * 4000.0 * indentation, rel=0.01)
    turned = motion.object_pose[-1, 2]
    assert abs(turned) < 1e-3 if fingers == 2 else turned > 0.05


def test_pushes_stay_on_the_pad():
    sequence = draw_sequence(Disc(0.06), "disc", GELSIGHT_MINI, np.random.default_rng(1), 6.0)
    motion = sequence.motion
    assert motion.contact.mean() > 0.3
    assert np.nanmax(np.abs(motion.pad_angle)) < math.radians(40.0)
    touch = draw_touch(SQUARE, "rectangle-edges", GELSIGHT_MINI, np.random.default_rng(0))
    parts = se2.transform(touch.sensor_pose[None], GELSIGHT_MINI.round_centers)
    assert SQUARE.signed_distance(parts).min() == pytest.approx(GELSIGHT_MINI.radius, abs=1e-9)


def test_units_with_and_without_markers():
    units = [draw_unit(GELSIGHT_MINI, seed) for seed in range(12)]
    marked = [unit.markers is not None for unit in units]
    assert 2 < sum(marked) < 10
    assert draw_unit(DIGIT, 0).markers is None
    for unit in units:
        bare, image = unit.no_contact.astype(float), touch_image(unit, None)
        changed = np.abs(image - bare).max(axis=2) > 8.0
        assert (0.02 < changed.mean() < 0.4) == (unit.markers is not None)


def test_a_ball_is_bright_on_the_side_that_glows():
    """As on a real GelSight Mini; on a hollow gel it is the other way round."""
    for unit in [draw_unit(GELSIGHT_MINI, seed) for seed in range(20)]:
        if unit.markers is not None:
            continue
        plain = touch_image(unit, None).astype(float)
        ball = touch_image(unit, ball_overlap(unit, 0.003, (0.0, 0.0), 6e-4)).astype(float) - plain
        light = unit.light[0] @ np.eye(3)[:, :2]
        y, z = unit.place
        toward = np.hypot(y, z) < 1.5e-3
        flank = (y * light[0] + z * light[1])[..., None] * unit.colour[0]
        assert np.sum(flank[toward] * ball[toward]) > 0.0
        lit = unit.illumination[0] - unit.illumination[0].mean()
        assert np.sum(lit * (y * light[0] + z * light[1])) > 0.0
