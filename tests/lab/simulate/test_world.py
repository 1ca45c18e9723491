"""The physics of pushing: forces, motion, contact, slip, drift, flat pads, hands and shoves, against closed forms."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from palpate import DIGIT, GELSIGHT_MINI, POINT, Disc, Ellipse, Polygon, Rectangle, SensorProfile, SettingError
from palpate.geometry import se2
from palpate_lab.simulate.scene import WorldSettings, convex_parts, draw_settings
from palpate_lab.simulate.world import Shove, World

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")

DISC, RECTANGLE, ELLIPSE = Disc(0.088), Rectangle(0.2363, 0.1579), Ellipse(0.1638, 0.2428)
TEE = Polygon(
    [(-0.1, 0.02), (-0.03, 0.02), (-0.03, -0.12), (0.03, -0.12), (0.03, 0.02), (0.1, 0.02), (0.1, 0.08), (-0.1, 0.08)]
)
SQUARE, CORNERS = Rectangle(0.09, 0.09), 0.04 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
SPEED = 0.02  # [m/s]
named = pytest.mark.parametrize("shape", [DISC, RECTANGLE, ELLIPSE, TEE], ids=["disc", "rectangle", "ellipse", "tee"])


def ring(radius):
    angle = 2.0 * np.pi * np.arange(20) / 20
    return radius * np.stack((np.cos(angle), np.sin(angle)), axis=-1)


def drawn(shape, seed):
    return draw_settings(shape, np.random.default_rng(seed))


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


@named
def test_a_straight_push_takes_the_force_of_friction(shape):
    settings = drawn(shape, 3)
    _, motion = pushed(shape, settings, y=0.05 if shape is TEE else float(shape.centroid[1]), pushing=75)
    force = np.hypot(motion.normal_force, motion.tangential_force)[30:].mean()
    expected = settings.mass * 9.81 * settings.table_friction
    # The T turns, which needs less force.
    assert 0.5 * expected < force < expected if shape is TEE else force == pytest.approx(expected, rel=0.1)
    stiffness = motion.normal_force[30:].mean() / motion.indentation[30:].mean()
    assert stiffness == pytest.approx(settings.gel_stiffness, rel=0.05)


def test_a_push_off_the_centre_turns_the_object_and_wide_feet_resist():
    narrow, wide = (
        pushed(RECTANGLE, WorldSettings(feet=ring(radius), gel_friction=0.0), y=0.04)[1].object_pose[-1, 2]
        for radius in (0.04, 0.075)
    )
    assert narrow < 1.3 * wide < 0.0


@pytest.mark.parametrize("shape", [RECTANGLE, ELLIPSE, TEE], ids=["rectangle", "ellipse", "tee"])
def test_contact_agrees_with_geometry(shape):
    poses, motion = pushed(shape, drawn(shape, 2), y=0.04, velocity=(SPEED, 0.004))
    object_T_center = se2.compose(se2.between(motion.object_pose, poses), (-DIGIT.radius, 0.0, 0.0))
    gap = shape.signed_distance(object_T_center[:, :2]) - DIGIT.radius
    steady = motion.contact & (np.arange(len(gap)) > 20)
    assert steady.sum() > 30
    assert motion.indentation[steady] == pytest.approx(-gap[steady], abs=1.5e-5)
    outline = shape.outline(20000)
    for i in np.flatnonzero(steady)[::10]:
        away = se2.transform(se2.inverse(object_T_center[i]), outline)
        x, y = away[np.argmin(np.hypot(*away.T))]
        assert motion.pad_angle[i] == pytest.approx(np.arctan2(y, x), abs=np.radians(1.0))
    assert not motion.contact[0] and np.isnan(motion.pad_angle[0])
    assert motion.normal_force[0] == motion.indentation[0] == motion.slip[0] == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_sliding_contact_carries_coulomb_friction(side):
    # The sensor goes to its -y at 63 degrees from its x: the object slides towards +y over it.
    settings = WorldSettings(feet=ring(0.07), gel_friction=0.25)
    _, motion = pushed(RECTANGLE, settings, pushing=50, velocity=(0.01, -0.02 * side))
    assert (motion.slip[30:] * side > 0.002).all()
    assert motion.tangential_force[30:] * side == pytest.approx(0.25 * motion.normal_force[30:], rel=0.02)


@pytest.mark.parametrize("friction", [0.0, 0.25, 0.6])
def test_slip_is_what_rolling_leaves_over(friction):
    settings = WorldSettings(feet=ring(0.07), gel_friction=friction)
    poses, motion = pushed(RECTANGLE, settings, pushing=60, velocity=(SPEED, -0.015), turn=-0.15)
    # The contact moves over the gel and along the object's edge; if both move alike the object rolls.
    over_gel = DIGIT.radius * motion.pad_angle
    along_edge = se2.compose(se2.between(motion.object_pose, poses), (-DIGIT.radius, 0.0, 0.0))[:, 1]
    first, last = 20, 59
    slid = motion.slip[first + 1 : last + 1].sum() / DIGIT.rate
    assert slid == pytest.approx(over_gel[last] - over_gel[first] - along_edge[last] + along_edge[first], abs=3e-4)
    if friction == 0.0:
        assert np.abs(motion.tangential_force).max() < 1e-3


def test_a_run_may_be_cut_in_two_and_the_frame_of_the_world_does_not_matter():
    settings, (start, poses) = drawn(RECTANGLE, 4), forward(RECTANGLE, y=0.03)
    whole = World(settings, RECTANGLE, DIGIT, np.zeros(3), start).run(poses)
    world = World(settings, RECTANGLE, DIGIT, np.zeros(3), start)
    world.run(poses[:30])
    assert len(world.run(poses[:0]).contact) == 0 and world.sensor_pose == pytest.approx(poses[29])
    rest = world.run(poses[30:])
    assert rest.object_pose == pytest.approx(whole.object_pose[30:], abs=1e-5)
    assert world.object_pose == pytest.approx(rest.object_pose[-1])
    shift = np.array([0.3, -0.2, 2.9])
    there = World(settings, RECTANGLE, DIGIT, shift, se2.compose(shift, start)).run(se2.compose(shift, poses))
    assert np.abs(se2.between(se2.compose(shift, whole.object_pose), there.object_pose)).max() < 5e-4


def test_a_gel_drifts_until_it_is_warm(monkeypatch):
    monkeypatch.setattr("palpate_lab.simulate.world.WARM_UP", 1.5)
    new = WorldSettings(feet=ring(0.07), gel_friction=0.25)
    before, after = (
        pushed(RECTANGLE, replace(new, gel_drift=drift), pushing=50, velocity=(0.01, -0.02))[1]
        for drift in ((0.0, 0.0), (0.2, -0.1))
    )
    sliding, seconds = slice(30, 50), np.minimum(0.4 + np.arange(30, 50) / DIGIT.rate, 1.5)  # it settles for 0.4 s
    friction = [one.tangential_force[sliding] / one.normal_force[sliding] for one in (before, after)]
    stiffness = [one.normal_force[sliding] / one.indentation[sliding] for one in (before, after)]
    assert friction[1] / friction[0] == pytest.approx(1.0 + 0.2 * seconds, rel=0.02)
    assert stiffness[1] / stiffness[0] == pytest.approx(1.0 - 0.1 * seconds, rel=0.03)


@pytest.mark.parametrize("tilt", [-3.0, 3.0])
def test_a_side_turns_towards_a_flat_pad(tilt):
    yaw = np.radians(tilt)
    start = np.array([-0.049, 0.0, yaw])
    world = World(WorldSettings(feet=CORNERS), SQUARE, GELSIGHT_MINI, np.zeros(3), start)
    motion = world.run(start + np.linspace(0.0, 0.03, 50)[1:, None] * np.array([1.0, 0.0, 0.0]))
    # A round tip in the middle would not turn the square at all.
    assert motion.contact[-1] and abs(motion.object_pose[-1, 2] - yaw) < 0.5 * abs(yaw) + 1e-3
    assert 1.5 < motion.normal_force[-10:].mean() < 3.0 and 1e-4 < motion.indentation[-1] < 1e-3


@pytest.mark.parametrize(("y", "fingers"), [(0.0, 2), (-0.04, 1)])
def test_both_fingers_push_the_middle_of_a_side_and_one_its_end(y, fingers):
    hand = SensorProfile("hand", radius=0.0025, tips=((0.0, 0.009), (0.0, -0.009)), rate=30.0)
    start = np.array([-0.046, y, 0.0])
    world = World(WorldSettings(feet=CORNERS), SQUARE, hand, np.zeros(3), start)
    path = start + np.linspace(0.0, 0.015, 200)[1:, None] * np.array([1.0, 0.0, 0.0])
    motion = world.run(path)
    centers = se2.transform(se2.between(motion.object_pose, path)[:, None], hand.centers)
    assert (SQUARE.signed_distance(centers)[-1] < hand.radius).sum() == fingers
    # Each is a spring of its own, and two of them are in by the same depth.
    force, indentation = motion.normal_force[-100:].mean(), motion.indentation[-100:].mean()
    assert force == pytest.approx(fingers * 4000.0 * indentation, rel=0.01)
    turned = motion.object_pose[-1, 2]
    assert abs(turned) < 1e-3 if fingers == 2 else turned > 0.05


@pytest.mark.parametrize("shape", [DISC, TEE], ids=["disc", "tee"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_shove_takes_the_pushed_point_along_and_turns_the_object(shape, side):
    pose, far = np.array([0.05, -0.02, 2.0]), np.array([-0.4, 0.0, 0.0])
    world = World(drawn(shape, 1), shape, DIGIT, pose, far)
    start, point = world.object_pose, shape.centroid - np.array([0.03, 0.04 * side])
    shove = Shove(point, direction=float(pose[2]), length=0.02, seconds=0.4)  # along the object's x
    world.shove(shove)
    motion = world.run(np.tile(far, (40, 1)))
    way = se2.transform(motion.object_pose[-1], point) - se2.transform(start, point)
    assert 0.017 < way @ (np.cos(shove.direction), np.sin(shove.direction)) < 0.022
    assert np.radians(3.0) < side * se2.wrap(float(motion.object_pose[-1, 2] - start[2])) < np.radians(30.0)
    assert motion.knocked.any() and not motion.knocked[12:].any()  # 0.4 s at 30 Hz
    assert np.abs(np.diff(motion.object_pose[25:], axis=0)).max() < 1e-5 and not motion.contact.any()


def test_concave_outlines_become_few_convex_parts():
    parts = convex_parts(TEE)
    assert len(parts) == 2 and sum(Polygon(part).area for part in parts) == pytest.approx(TEE.area)
    assert len(convex_parts(ELLIPSE)) == 1


def test_drawn_feet_are_below_the_object_and_a_fall_is_an_error():
    for seed in range(20):
        feet = drawn(TEE, seed).feet
        assert len(feet) == 20 and (TEE.signed_distance(feet) < 0.0).all()
    settings = WorldSettings(feet=np.array([(0.05, 0.0), (0.06, 0.02), (0.06, -0.02)]))
    with pytest.raises(SettingError, match="broke down"):
        World(settings, RECTANGLE, DIGIT, np.zeros(3), (-0.3, 0.0, 0.0))


def test_a_point_and_a_missing_simulator_are_refused(monkeypatch):
    with pytest.raises(SettingError, match="radius 0"):
        World(WorldSettings(feet=ring(0.05)), DISC, POINT, np.zeros(3), (-0.3, 0.0, 0.0))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(SettingError, match=r"mujoco, which is not installed: .*\[sim\]"):
        World(WorldSettings(feet=ring(0.05)), DISC, DIGIT, np.zeros(3), (-0.3, 0.0, 0.0))
