import math
from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np
import pytest
from push_samples import RADIUS, SHAPES, sensor, tips_of

from palpate import se2
from palpate.distance_field import DistanceField
from palpate.graph import factors
from palpate.graph.factors import ContactModel
from palpate.shapes import Disc, Rectangle

Array = np.ndarray
STATES = 100
STEP = 1e-6  # [m], [rad]: truncation 1e-12 times third derivatives, rounding 1e-16 / 1e-6


def numeric_jacobian(residual: Callable[..., Array], poses: list[Array]) -> Array:
    """Central differences (..., rows, 3 poses) by right perturbations of each pose."""
    columns = []
    for which, pose in enumerate(poses):
        for axis in range(3):
            step = STEP * np.eye(3)[axis]
            ends = [[*poses[:which], se2.compose(pose, se2.exp(s * step)), *poses[which + 1 :]] for s in (1, -1)]
            columns.append((residual(*ends[0]) - residual(*ends[1])) / (2 * STEP))
    return np.stack(columns, axis=-1)


def check(factor: Callable[..., tuple[Array, Array]], *poses: Array, tolerance: float = 1e-8) -> None:
    residual, jacobian = factor(*poses)
    wanted = numeric_jacobian(lambda *moved: factor(*moved)[0], list(poses))
    assert residual.shape == wanted.shape[:-1]
    assert jacobian.shape == wanted.shape
    np.testing.assert_allclose(jacobian, wanted, atol=tolerance, rtol=1e-6)
    for k in (0, 57):  # one state alone gives the same
        alone = factor(*(pose[k] for pose in poses))
        np.testing.assert_allclose(alone[0], residual[k], atol=1e-15)
        np.testing.assert_allclose(alone[1], jacobian[k], atol=1e-12)


def angles(rng: np.random.Generator, where: str) -> Array:
    """Angles (STATES,) anywhere, or within 1e-3 of +pi and of -pi."""
    if where == "anywhere":
        return rng.uniform(-math.pi, math.pi, STATES)
    side = np.where(np.arange(STATES) % 2, 1.0, -1.0)
    close = rng.uniform(0.0, 1e-3, STATES)
    close[:4] = 0.0, 0.0, 1e-9, 1e-9  # the difference step crosses the seam here
    return side * (math.pi - close)


def random_poses(rng: np.random.Generator, where: str = "anywhere") -> Array:
    return np.column_stack([rng.normal(size=(STATES, 2)), angles(rng, where)])


def small(rng: np.random.Generator, size: float) -> Array:
    return se2.exp(rng.normal(0.0, size, (STATES, 3)))


def tip_with(name: str, radius: float, friction_center: tuple[float, float] = (0.013, -0.021)) -> ContactModel:
    """A tip whose centre is on neither axis of the sensor."""
    known = tips_of(name, sensor(radius))[0]
    return ContactModel(known.field, (-radius, 0.004), radius, known.friction_radius, friction_center)


def near_outline(name: str, tip: ContactModel, theta: Array, rng: np.random.Generator) -> Array:
    """Sensor poses in the object frame (STATES, 3) with the tip within 2 mm of the outline.

    Points within three cells of a kink of the distance (the medial axis, met at corners) are left out: there the spline
    is no distance and its third derivatives, about 1 / cell^2, jump from cell to cell, so that central differences
    across a cell's border do not measure the derivative. They are told by the spline's error.
    """
    shape = SHAPES[name]
    outline = shape.outline(4000)
    along = np.roll(outline, -1, axis=0) - outline
    outward = np.stack([along[:, 1], -along[:, 0]], axis=-1) / np.hypot(*along.T)[:, None]
    pick = rng.permutation(len(outline))
    centers = (outline + 0.5 * along + outward * (tip.radius + rng.uniform(-2e-3, 2e-3, (len(outline), 1))))[pick]
    around = tip.field.cell * np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-3, 4)), axis=-1).reshape(-1, 2)
    spots = centers[:, None] + around
    smooth = (np.abs(tip.field.value(spots) - shape.signed_distance(spots)) < 2e-8).all(axis=1)
    assert smooth.mean() > 0.5
    centers = centers[smooth][:STATES]
    offset = se2.transform(np.column_stack([np.zeros((STATES, 2)), theta]), np.array(tip.center))
    return np.column_stack([centers - offset, theta])


@pytest.mark.parametrize("where", ["anywhere", "near pi"])
def test_between_jacobian(where):
    rng = np.random.default_rng(1)
    i, j = random_poses(rng, where), random_poses(rng)
    measured = se2.compose(se2.between(i, j), small(rng, 0.3))
    check(lambda a, b: factors.between(a, b, measured if a.ndim > 1 else at(measured, i, a)), i, j)


def at(measured: Array, poses: Array, pose: Array) -> Array:
    """The measurement that belongs to one of the poses."""
    return measured[np.argmax((poses == pose).all(axis=-1))]


def test_between_and_prior_jacobians_where_the_error_itself_is_near_pi():
    # Log jumps at pi, so the difference step must not cross it: 1e-5 away.
    rng = np.random.default_rng(2)
    error = random_poses(rng)
    error[:, 2] = np.where(np.arange(STATES) % 2, 1, -1) * (math.pi - rng.uniform(1e-5, 1e-3, STATES))
    i, j = random_poses(rng), random_poses(rng)
    measured = se2.compose(se2.between(i, j), se2.inverse(error))
    check(lambda a, b: factors.between(a, b, measured if a.ndim > 1 else at(measured, i, a)), i, j)
    pose = random_poses(rng)
    known = se2.compose(pose, se2.inverse(error))
    check(lambda a: factors.prior(a, known if a.ndim > 1 else at(known, pose, a)), pose)
    assert np.abs(factors.prior(pose, known)[0][:, 2]).min() > 3.14


@pytest.mark.parametrize("where", ["anywhere", "near pi"])
def test_prior_and_first_pose_jacobians(where):
    rng = np.random.default_rng(3)
    g, e = random_poses(rng, where), random_poses(rng, where)
    measured = se2.compose(e, small(rng, 0.3))
    check(lambda a: factors.prior(a, measured if a.ndim > 1 else at(measured, e, a)), e)
    known = se2.compose(se2.compose(e, se2.inverse(g)), small(rng, 0.3))
    check(lambda a, b: factors.first_pose(a, b, known if a.ndim > 1 else at(known, g, a)), g, e)


@pytest.mark.parametrize("where", ["anywhere", "near pi"])
@pytest.mark.parametrize("radius", [0.0, RADIUS])
@pytest.mark.parametrize("name", SHAPES)
def test_contact_and_pushing_jacobians(name, radius, where):
    rng = np.random.default_rng(4)
    tip = tip_with(name, radius)
    g1 = near_outline(name, tip, angles(rng, where), rng)
    e1 = random_poses(rng, where)
    # Steps far larger than real ones: the Jacobian must not only be right where the residual vanishes.
    g0, e0 = se2.compose(g1, small(rng, 0.05)), se2.compose(e1, small(rng, 0.05))
    check(lambda g: factors.contact(g, tip), g1, tolerance=1e-7)
    check(lambda a, b, c, d: factors.pushing(a, b, c, d, tip), g0, e0, g1, e1, tolerance=1e-6)


def test_between_by_hand():
    # Across the seam: from 3.1 to -3.1 is 2 pi - 6.2 = 0.0831853 rad, 0.0031853 more than the measured 0.08.
    residual, _ = factors.between(np.array([0, 0, 3.1]), np.array([0, 0, -3.1]), np.array([0, 0, 0.08]))
    np.testing.assert_allclose(residual, [0, 0, 2 * math.pi - 6.28], atol=1e-15)
    # i looks along +y; j lies 2 m ahead of it, measured 1.5 m ahead.
    i, j = np.array([1.0, 1.0, math.pi / 2]), np.array([1.0, 3.0, math.pi / 2])
    residual, jacobian = factors.between(i, j, np.array([1.5, 0.0, 0.0]))
    np.testing.assert_allclose(residual, [0.5, 0, 0], atol=1e-15)
    # Measured right. Turning i by d swings j, 2 m ahead, by -2 d to the left.
    residual, jacobian = factors.between(i, j, np.array([2.0, 0.0, 0.0]))
    np.testing.assert_allclose(jacobian, [[-1, 0, 0, 1, 0, 0], [0, -1, -2, 0, 1, 0], [0, 0, -1, 0, 0, 1]], atol=1e-15)


def test_first_pose_by_hand():
    # Sensor at x = 1.1, 0.1 in front of the object's origin: o = (1, 0, 0), known to be at (0.9, 0, 0).
    g, e = np.array([0.1, 0.0, 0.0]), np.array([1.1, 0.0, 0.0])
    residual, jacobian = factors.first_pose(g, e, np.array([0.9, 0.0, 0.0]))
    np.testing.assert_allclose(residual, [0.1, 0, 0], atol=1e-15)
    # Known to be where it is. Turning the sensor by d about itself swings the object's origin, 0.1 behind it, by -0.1
    # d in y.
    residual, jacobian = factors.first_pose(g, e, np.array([1.0, 0.0, 0.0]))
    by_e = np.array([[1, 0, 0], [0, 1, -0.1], [0, 0, 1]])
    np.testing.assert_allclose(jacobian, np.hstack([-by_e, by_e]), atol=1e-15)


def square_tip(radius: float) -> ContactModel:
    return ContactModel(DistanceField.of(Rectangle(0.2, 0.2), margin=0.08), (-radius, 0.0), radius, 0.05)


def test_contact_by_hand():
    tip = square_tip(RADIUS)
    # The apex 3 mm off the left side: the centre is at -0.103 - 0.021, 0.024 from the side, less the radius.
    residual, jacobian = factors.contact(np.array([-0.103, 0.02, 0.0]), tip)
    np.testing.assert_allclose(residual, [0.003], atol=1e-9)
    np.testing.assert_allclose(jacobian, [[-1, 0, 0]], atol=1e-9)
    # Turned to the left by 90 degrees the apex at (-0.13, 0.021) has its centre at (-0.13, 0), 0.03 - 0.021 off. The
    # side's normal is now the sensor's +y. Turning further moves the centre, 0.021 below, to the right: closer by
    # 0.021.
    residual, jacobian = factors.contact(np.array([-0.13, 0.021, math.pi / 2]), tip)
    np.testing.assert_allclose(residual, [0.009], atol=1e-9)
    np.testing.assert_allclose(jacobian, [[0, 1, -0.021]], atol=1e-9)
    # The centre 30 mm left of and 40 mm above a corner: 50 mm from it, less the radius. The spline is good to
    # micrometres.
    residual, _ = factors.contact(np.array([-0.109, 0.14, 0.0]), tip)
    np.testing.assert_allclose(residual, [0.029], atol=2e-6)
    # Two-sided: 2 mm inside is -2 mm.
    residual, _ = factors.contact(np.array([-0.098, 0.0, 0.0]), tip)
    np.testing.assert_allclose(residual, [-0.002], atol=1e-9)


def test_paper_point_pushes_a_disc_through_its_centre():
    disc = Disc(0.088)
    tip = ContactModel(DistanceField.of(disc), (0.0, 0.0), 0.0, disc.friction_radius())
    start, moved = np.array([-0.088, 0.0, 0.0]), np.array([-0.087, 0.0, 0.0])
    # Sensor and object both go 1 mm in x: p = (-0.088, 0), v = (1, 0) mm, so that p x v = 0 and the disc does not turn.
    np.testing.assert_allclose(factors.pushing(start, start, start, moved, tip)[0], np.zeros(3), atol=1e-15)
    # The object stays while the sensor goes 1 mm in x: V = 0, Vp = (1, 0) mm, so that V - Vp = (-1, 0) mm.
    np.testing.assert_allclose(factors.pushing(start, start, moved, moved, tip)[0], [-1e-3, 0, 0], atol=1e-15)


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
def test_paper_point_pushes_off_centre(share):
    # p = (-0.08, 0.03) and v = (1, 0) mm give p x v = px vy - py vx = -3e-5 m^2. With c^2 = 0.0036 the disc turns by
    # omega = -3e-5 / 0.0036 = -1/120 rad. With only a share of that turn the row is -3e-5 (1 - share).
    tip = ContactModel(DistanceField.of(Disc(0.088)), (0.0, 0.0), 0.0, 0.06)
    omega = -share / 120
    object0, object1 = np.array([-1e-3, 0.0, -omega]), np.zeros(3)  # the frame at step 1 is the world's
    g = np.array([-0.08, 0.03, 0.4])  # the point sticks where it is
    residual, _ = factors.pushing(g, se2.compose(object0, g), g, se2.compose(object1, g), tip)
    np.testing.assert_allclose(residual, [0, 0, -3e-5 * (1 - share)], atol=1e-15)


def test_torque_is_taken_about_the_centre_of_friction():
    # v = (1, 0) mm without turning and p = (-0.08, 0.03). About (0, 0.01) the arm is (-0.08, 0.02): row 3 is -2e-5 m^2.
    field = DistanceField.of(Disc(0.088))
    g, before = np.array([-0.08, 0.03, 0.0]), np.array([-0.081, 0.03, 0.0])
    tip = ContactModel(field, (0.0, 0.0), 0.0, 0.06, (0.0, 0.01))
    np.testing.assert_allclose(factors.pushing(g, before, g, g, tip)[0], [0, 0, -2e-5], atol=1e-15)
    # Turning by omega = 0.01 rad about a centre of friction at (0.02, 0.01) moves that centre nowhere: v = 0,
    # although the object's origin moves. Row 3 is -c^2 omega = -0.0036 * 0.01.
    tip = ContactModel(field, (0.0, 0.0), 0.0, 0.06, (0.02, 0.01))
    there = np.array([0.02, 0.01, 0.0])
    before = se2.compose(se2.compose(there, [0.0, 0.0, -0.01]), se2.inverse(there))
    residual, _ = factors.pushing(g, se2.compose(before, g), g, g, tip)
    np.testing.assert_allclose(residual, [0, 0, -3.6e-5], atol=1e-15)


@pytest.mark.parametrize("angle", [0.001, 0.02, -0.02, 0.1])
def test_rolling_on_a_flat_side_is_no_sliding(angle):
    # Left of a flat side at x = -0.1 a tip that turns by +angle rolls down by 0.021 angle. The material point that
    # touches at the end was, on its cycloid, r (1 - cos angle) off the side and r (angle - sin angle) above: of
    # second and third order. At 0.02 rad, a fast turn, that is 4.2e-6 m and 2.8e-8 m.
    tip, r = square_tip(RADIUS), RADIUS
    start = np.array([-0.1 - r, 0.01, 0.0])  # of the centre
    end = start + np.array([0.0, -r * angle, angle])
    to_origin = np.array([r, 0.0, 0.0])  # the sensor's origin is its apex
    g0, g1 = se2.compose(start, to_origin), se2.compose(end, to_origin)
    residual, _ = factors.pushing(g0, g0, g1, g1, tip)
    wanted = [-r * (1 - math.cos(angle)), r * (angle - math.sin(angle)), 0.0]
    np.testing.assert_allclose(residual, wanted, atol=1e-9)
    # The same turn on the spot is a slide by 0.021 angle, less than 0.2 % of which is hidden by the curvature.
    spot = se2.compose(start + np.array([0, 0, angle]), to_origin)
    residual, _ = factors.pushing(g0, g0, spot, spot, tip)
    assert residual[1] == pytest.approx(-r * angle, rel=2e-3)


def test_sliding_by_1_mm_is_1_mm():
    tip = square_tip(RADIUS)
    g0, g1 = np.array([-0.1, 0.01, 0.0]), np.array([-0.1, 0.011, 0.0])
    np.testing.assert_allclose(factors.pushing(g0, g0, g1, g1, tip)[0], [0, -1e-3, 0], atol=1e-9)
    # A 1 mm deeper overlap is 1 mm along the normal.
    g1 = np.array([-0.099, 0.01, 0.0])
    np.testing.assert_allclose(factors.pushing(g0, g0, g1, g1, tip)[0], [-1e-3, 0, 0], atol=1e-9)


def paper_rows(o0: Array, e0: Array, o1: Array, e1: Array, c: float) -> Array:
    """D V - Vp in the object frame of step 1 (facts: Lynch 1992, Zhou 2017), for a point sensor."""
    turn = se2.rotation(o1[2]).T
    vx, vy = turn @ (o1 - o0)[:2]
    omega = o1[2] - o0[2]
    px, py = turn @ (e1 - o1)[:2]
    contact_velocity = turn @ (e1 - e0)[:2]
    d = np.array([[1, 0, -py], [0, 1, px], [-py, px, -(c**2)]])
    return d @ [vx, vy, omega] - [*contact_velocity, 0.0]


def test_pushing_agrees_with_the_paper_to_first_order():
    tip = ContactModel(DistanceField.of(Disc(0.088)), (0.0, 0.0), 0.0, 0.06)
    rng = np.random.default_rng(5)
    for _ in range(20):
        o1, e1 = np.array([0.3, -0.2, 0.7]), np.array([0.25, -0.13, 1.9])
        by_object, by_sensor = rng.normal(size=(2, 3)) * [2e-3, 2e-3, 2e-2]
        off = []
        for scale in (1.0, 0.1):
            o0, e0 = o1 - scale * by_object, e1 - scale * by_sensor
            g0, g1 = se2.between(o0, e0), se2.between(o1, e1)
            ours, _ = factors.pushing(g0, e0, g1, e1, tip)
            paper = paper_rows(o0, e0, o1, e1, 0.06)
            off.append(np.abs(ours - paper).max())
            # What the paper linearises away in a step turns the ways by omega: the object's, the sensor's and the
            # arm's.
            ways = np.hypot(*by_object[:2]) + np.hypot(*by_sensor[:2]) + abs(by_object[2]) * np.hypot(*(e1 - o1)[:2])
            assert off[-1] < scale**2 * abs(by_object[2]) * ways
        assert off[1] < 0.02 * off[0]  # a tenth of the motion, a hundredth of the difference


@pytest.mark.parametrize("where", ["anywhere", "near pi"])
def test_between_and_prior_agree_with_gtsam(where):
    rng = np.random.default_rng(6)
    i, j, measured = random_poses(rng, where), random_poses(rng, where), random_poses(rng)
    if where == "near pi":
        measured = se2.compose(se2.between(i, j), small(rng, 0.1))
    unit = gtsam.noiseModel.Unit.Create(3)
    for a, b, m in zip(i, j, measured, strict=True):
        values = gtsam.Values()
        values.insert(0, gtsam.Pose2(*a))
        values.insert(1, gtsam.Pose2(*b))
        relative: Any = gtsam.BetweenFactorPose2(0, 1, gtsam.Pose2(*m), unit)
        known: Any = gtsam.PriorFactorPose2(0, gtsam.Pose2(*m), unit)
        for ours, theirs in ((factors.between(a, b, m), relative), (factors.prior(a, m), known)):
            np.testing.assert_allclose(ours[0], theirs.unwhitenedError(values), atol=1e-9)
            # GTSAM's derivative of Log is itself off by 4e-7 at angles below 1e-3.
            np.testing.assert_allclose(ours[1], theirs.linearize(values).jacobian()[0], atol=1e-6)


def test_rest_marginalised_is_a_first_pose_with_summed_covariance():
    # Unknowns: the object's pose before, and g and e after. The last marginal N(m, P) on the one and the paper's rest
    # factor Log(o_before^-1 o_now), N(0, Q), between them; the first is then eliminated.
    rng = np.random.default_rng(7)
    e, g = rng.normal(size=(2, 3))
    now = se2.compose(e, se2.inverse(g))
    last, rest = (0.1 * np.eye(3) + root @ root.T for root in rng.normal(size=(2, 3, 3)))
    _, prior = factors.prior(now, now)
    _, between = factors.between(now, now, np.zeros(3))
    _, by_both = factors.first_pose(g, e, now)  # at zero error that is how o moves with g and e
    known = np.hstack([prior, np.zeros((3, 6))])
    resting = np.hstack([between[:, :3], between[:, 3:] @ by_both])
    information = known.T @ np.linalg.inv(last) @ known + resting.T @ np.linalg.inv(rest) @ resting
    left = information[3:, 3:] - information[3:, :3] @ np.linalg.solve(information[:3, :3], information[:3, 3:])
    np.testing.assert_allclose(left, by_both.T @ np.linalg.inv(last + rest) @ by_both, atol=1e-12)


def test_contact_models_of_a_sensor():
    tips = factors.contact_models(SHAPES["concave"], sensor(0.004, ((0.0, 0.03), (0.001, -0.03))), 0.05)
    assert [tip.center for tip in tips] == [(-0.004, 0.03), (-0.003, -0.03)]
    assert tips[0].field is tips[1].field
    assert not any(tip.alone for tip in tips)
    # The L is 0.16 x 0.06 about (-0.01, -0.03) and 0.07 x 0.07 about (-0.055, 0.035): areas 0.0096 and 0.0049.
    # x = (0.0096 * -0.01 + 0.0049 * -0.055) / 0.0145, y = (0.0096 * -0.03 + 0.0049 * 0.035) / 0.0145
    assert tips[0].friction_center == pytest.approx((-0.02520690, -0.00803448), abs=1e-8)
    assert tips[0].friction_radius == 0.05
    alone = factors.contact_models(Disc(0.09), sensor())
    assert alone[0].alone
    assert alone[0].friction_radius == pytest.approx(0.06)  # 2 r / 3 for uniform pressure
    # The centre of a tip of radius r stands r off the outline: the grid reaches further.
    wide = factors.contact_models(Disc(0.09), sensor(0.1))[0].field
    assert wide.origin[0] < -0.09 - 0.1
