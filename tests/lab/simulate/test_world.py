import sys
from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Ellipse, Polygon, Rectangle
from palpate.lab.simulate.scene import WorldSettings, convex_parts, draw_settings
from palpate.lab.simulate.world import World
from palpate.types.sensor import DIGIT, POINT

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")

DISC, RECTANGLE, ELLIPSE = Disc(0.088), Rectangle(0.2363, 0.1579), Ellipse(0.1638, 0.2428)
TEE = Polygon(
    [(-0.1, 0.02), (-0.03, 0.02), (-0.03, -0.12), (0.03, -0.12), (0.03, 0.02), (0.1, 0.02), (0.1, 0.08), (-0.1, 0.08)]
)
SPEED = 0.02  # [m/s]
GRAVITY = 9.81


def ring(radius, count=20):
    angle = 2.0 * np.pi * np.arange(count) / count
    return radius * np.stack((np.cos(angle), np.sin(angle)), axis=-1)


def forward(shape, y=0.0, pushing=60, resting=0, velocity=(SPEED, 0.0), turn=0.0):
    """Return a first sensor pose 1 mm from the left side of a shape, and poses that push it from there."""
    x = np.linspace(-0.3, 0.0, 30001)
    center = np.column_stack((x, np.full_like(x, y)))
    start = np.array([x[np.argmax(shape.signed_distance(center) < DIGIT.radius + 0.001)] + DIGIT.radius, y, 0.0])
    moving = np.minimum(np.arange(1, pushing + resting + 1), pushing)[:, None] / DIGIT.rate
    return start, start + moving * np.array([*velocity, turn])


def pushed(shape, settings, **how):
    start, poses = forward(shape, **how)
    return poses, World(settings, shape, DIGIT, np.zeros(3), start).run(poses)


@pytest.mark.parametrize("shape", [DISC, RECTANGLE, ELLIPSE, TEE], ids=["disc", "rectangle", "ellipse", "tee"])
def test_a_straight_push_takes_the_force_of_friction(shape):
    y = float(shape.centroid[1])
    settings = draw_settings(shape, np.random.default_rng(3))
    start, poses = forward(shape, y=0.05 if shape is TEE else y, pushing=75)
    motion = World(settings, shape, DIGIT, np.zeros(3), start).run(poses)
    force = np.hypot(motion.normal_force, motion.tangential_force)[30:]
    straight = shape is not TEE  # which turns, and so needs less force
    expected = settings.mass * GRAVITY * settings.table_friction
    assert force.mean() == pytest.approx(expected, rel=0.1) if straight else 0.5 * expected < force.mean() < expected
    # The gel is a linear spring.
    assert motion.normal_force[30:].mean() / motion.indentation[30:].mean() == pytest.approx(
        settings.gel_stiffness, rel=0.05
    )


def test_the_object_rests_when_the_sensor_stops():
    _, motion = pushed(RECTANGLE, draw_settings(RECTANGLE, np.random.default_rng(1)), y=0.03, pushing=45, resting=35)
    rest = motion.object_pose[46:]
    assert np.hypot(*(rest[:, :2] - rest[0, :2]).T).max() < 1e-4
    assert np.abs(rest[:, 2] - rest[0, 2]).max() < 1e-3
    assert motion.contact[-1]
    assert motion.object_pose[45, 0] > 0.01


@pytest.mark.parametrize("shape", [DISC, RECTANGLE, ELLIPSE], ids=["disc", "rectangle", "ellipse"])
def test_rotation_does_not_hang_on_the_time_step(shape):
    settings = draw_settings(shape, np.random.default_rng(5))
    coarse = pushed(shape, settings, y=0.03)[1].object_pose[-1, 2]
    fine = pushed(shape, replace(settings, time_step=0.001), y=0.03)[1].object_pose[-1, 2]
    assert np.degrees(abs(fine)) > 2.0
    assert coarse == pytest.approx(fine, rel=0.05)


def test_a_disc_pushed_through_its_centre_goes_straight():
    _, motion = pushed(DISC, WorldSettings(feet=ring(0.06)), pushing=75)
    x, y, theta = motion.object_pose[-1]
    assert x == pytest.approx(2.5 * SPEED - 0.001, abs=1e-3)  # the way of the sensor less the gap and indentation
    assert abs(y) < 2e-4 and abs(theta) < np.radians(0.2)


def test_a_push_above_the_centre_turns_the_object_clockwise_and_wide_feet_resist():
    narrow, wide = (
        pushed(RECTANGLE, WorldSettings(feet=ring(radius), gel_friction=0.0), y=0.04)[1].object_pose[-1, 2]
        for radius in (0.04, 0.075)
    )
    assert narrow < 1.3 * wide < 0.0


@pytest.mark.parametrize("shape", [RECTANGLE, ELLIPSE, TEE], ids=["rectangle", "ellipse", "tee"])
def test_touch_agrees_with_geometry(shape):
    poses, motion = pushed(shape, draw_settings(shape, np.random.default_rng(2)), y=0.04, velocity=(SPEED, 0.004))
    object_t_center = se2.compose(se2.between(motion.object_pose, poses), (-DIGIT.radius, 0.0, 0.0))
    gap = shape.signed_distance(object_t_center[:, :2]) - DIGIT.radius
    steady = motion.contact & (np.arange(len(gap)) > 20)
    assert steady.sum() > 30
    assert motion.indentation[steady] == pytest.approx(-gap[steady], abs=1.5e-5)
    outline = shape.outline(20000)
    for i in np.flatnonzero(steady)[::10]:
        away = se2.transform(se2.inverse(object_t_center[i]), outline)
        x, y = away[np.argmin(np.hypot(*away.T))]
        assert motion.pad_angle[i] == pytest.approx(np.arctan2(y, x), abs=np.radians(1.0))
    assert not motion.contact[0] and np.isnan(motion.pad_angle[0])
    assert motion.normal_force[0] == motion.indentation[0] == motion.slip[0] == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_sliding_has_the_sign_of_the_object_s_way_over_the_gel(side):
    settings = WorldSettings(feet=ring(0.07), gel_friction=0.25)
    # The sensor goes to its -y at 63 degrees from its x: the object slides towards +y over it.
    _, motion = pushed(RECTANGLE, settings, pushing=50, velocity=(0.01, -0.02 * side))
    assert (motion.slip[30:] * side > 0.002).all()
    # Coulomb: a sliding contact carries all the friction there is.
    assert motion.tangential_force[30:] * side == pytest.approx(0.25 * motion.normal_force[30:], rel=0.02)


def test_without_friction_the_gel_feels_no_tangential_force():
    settings = WorldSettings(feet=ring(0.07), gel_friction=0.0)
    _, motion = pushed(RECTANGLE, settings, pushing=50, velocity=(SPEED, -0.01))
    assert motion.contact[20:].all()
    assert np.abs(motion.tangential_force).max() < 1e-3


@pytest.mark.parametrize("friction", [0.0, 0.25, 0.6])
def test_slip_is_what_rolling_leaves_over(friction):
    settings = WorldSettings(feet=ring(0.07), gel_friction=friction)
    poses, motion = pushed(RECTANGLE, settings, pushing=60, velocity=(SPEED, -0.015), turn=-0.15)
    # The contact moves over the gel and along the object's edge; where both move alike the object rolls.
    over_gel = DIGIT.radius * motion.pad_angle
    along_edge = se2.compose(se2.between(motion.object_pose, poses), (-DIGIT.radius, 0.0, 0.0))[:, 1]
    first, last = 20, 59
    slid = motion.slip[first + 1 : last + 1].sum() / DIGIT.rate
    assert slid == pytest.approx(over_gel[last] - over_gel[first] - along_edge[last] + along_edge[first], abs=3e-4)


def test_a_sticking_contact_does_not_slide():
    settings = WorldSettings(feet=ring(0.07), gel_friction=0.6)
    _, motion = pushed(RECTANGLE, settings, pushing=50, velocity=(SPEED, -0.004))
    assert np.abs(motion.slip[30:]).max() < 5e-4


def test_a_run_may_be_cut_in_two():
    settings = draw_settings(RECTANGLE, np.random.default_rng(4))
    start, poses = forward(RECTANGLE, y=0.03)
    whole = World(settings, RECTANGLE, DIGIT, np.zeros(3), start).run(poses)
    world = World(settings, RECTANGLE, DIGIT, np.zeros(3), start)
    world.run(poses[:30])
    assert len(world.run(poses[:0]).contact) == 0
    assert world.sensor_pose == pytest.approx(poses[29])
    rest = world.run(poses[30:])
    assert rest.object_pose == pytest.approx(whole.object_pose[30:], abs=1e-5)
    assert world.object_pose == pytest.approx(rest.object_pose[-1])


def test_the_frame_of_the_world_does_not_matter():
    settings = WorldSettings(feet=ring(0.07))
    shift = np.array([0.3, -0.2, 2.9])
    start, poses = forward(RECTANGLE, y=0.03)
    here = World(settings, RECTANGLE, DIGIT, np.zeros(3), start).run(poses)
    there = World(settings, RECTANGLE, DIGIT, shift, se2.compose(shift, start)).run(se2.compose(shift, poses))
    moved = se2.between(se2.compose(shift, here.object_pose), there.object_pose)
    assert np.abs(moved).max() < 5e-4


def test_concave_outlines_become_few_convex_parts():
    parts = convex_parts(TEE)
    assert len(parts) == 2
    assert sum(Polygon(part).area for part in parts) == pytest.approx(TEE.area)
    assert len(convex_parts(ELLIPSE)) == 1


def test_drawn_feet_carry_the_object():
    for seed in range(20):
        feet = draw_settings(TEE, np.random.default_rng(seed)).feet
        assert len(feet) == 20
        assert (TEE.signed_distance(feet) < 0.0).all()


def test_a_fall_is_an_error():
    settings = WorldSettings(feet=np.array([(0.05, 0.0), (0.06, 0.02), (0.06, -0.02)]))
    with pytest.raises(SettingError, match="broke down"):
        World(settings, RECTANGLE, DIGIT, np.zeros(3), (-0.3, 0.0, 0.0))


def test_bad_settings_are_named():
    with pytest.raises(SettingError, match=r"mass is 0\.0; allowed is 0\.05 to 20"):
        WorldSettings(feet=ring(0.05), mass=0.0)
    with pytest.raises(SettingError, match=r"feet have shape \(2, 2\)"):
        WorldSettings(feet=ring(0.05, 2))
    with pytest.raises(SettingError, match=r"sensor poses have shape \(1, 3\); they must be finite"):
        World(WorldSettings(feet=ring(0.05)), DISC, DIGIT, np.zeros(3), (-0.3, 0.0, 0.0)).run([[0.0, 0.0, np.nan]])
    with pytest.raises(SettingError, match="radius 0"):
        World(WorldSettings(feet=ring(0.05)), DISC, POINT, np.zeros(3), (-0.3, 0.0, 0.0))


def test_a_missing_simulator_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(SettingError, match=r"pip install palpate\[sim\]"):
        World(WorldSettings(feet=ring(0.05)), DISC, DIGIT, np.zeros(3), (-0.3, 0.0, 0.0))


def test_a_gel_drifts_as_it_is_used():
    new = WorldSettings(feet=ring(0.07), gel_friction=0.25)
    (_, before), (_, after) = (
        pushed(RECTANGLE, replace(new, gel_drift=drift), pushing=50, velocity=(0.01, -0.02))
        for drift in ((0.0, 0.0), (0.2, -0.1))
    )
    # The object settles for 0.4 s before the first frame.
    seconds, sliding = 0.4 + np.arange(30, 50) / DIGIT.rate, slice(30, 50)
    friction, stiffness = (
        np.array([motion.tangential_force[sliding] / motion.normal_force[sliding] for motion in (before, after)]),
        np.array([motion.normal_force[sliding] / motion.indentation[sliding] for motion in (before, after)]),
    )
    assert friction[1] / friction[0] == pytest.approx(1.0 + 0.2 * seconds, rel=0.02)
    assert stiffness[1] / stiffness[0] == pytest.approx(1.0 - 0.1 * seconds, rel=0.03)


def test_a_gel_that_is_warm_drifts_no_more(monkeypatch):
    monkeypatch.setattr("palpate.lab.simulate.world.WARMS_FOR", 0.4)
    settings = WorldSettings(feet=ring(0.07), gel_friction=0.25, gel_drift=(0.5, 0.5))
    _, motion = pushed(RECTANGLE, settings, pushing=50, velocity=(0.01, -0.02))
    friction = motion.tangential_force[30:] / motion.normal_force[30:]
    assert friction == pytest.approx(np.full(len(friction), 0.25 * 1.2), rel=0.02)
