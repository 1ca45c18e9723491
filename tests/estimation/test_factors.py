"""Jacobians of the factors against central differences and GTSAM's."""

import math
from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np
import pytest
from push_samples import RADIUS, SHAPES, contact_rows, direction_rows, pushing_rows, sensor, tips_of

from palpate.geometry import se2
from palpate.graph import factors
from palpate.graph.factors import ContactModel

Array = np.ndarray
STATES = 100
STEP = 1e-6  # [m], [rad]: truncation 1e-12 times third derivatives, rounding 1e-16 / 1e-6


def numeric_jacobian(residual: Callable[..., Array], poses: list[Array], lasting: Array | None = None) -> Array:
    """Central differences (..., rows, 3 poses + L), by right perturbations of each pose and steps of what lasts."""
    rest = [] if lasting is None else [lasting]
    columns = []
    for which, pose in enumerate(poses):
        for axis in range(3):
            step = STEP * np.eye(3)[axis]
            ends = [[*poses[:which], se2.compose(pose, se2.exp(s * step)), *poses[which + 1 :], *rest] for s in (1, -1)]
            columns.append((residual(*ends[0]) - residual(*ends[1])) / (2 * STEP))
    for value in () if lasting is None else STEP * np.eye(len(lasting)):
        columns.append((residual(*poses, lasting + value) - residual(*poses, lasting - value)) / (2 * STEP))
    return np.stack(columns, axis=-1)


def check(
    factor: Callable[..., tuple[Array, Array]], *poses: Array, lasting: Array | None = None, tolerance: float = 1e-8
) -> None:
    rest = [] if lasting is None else [lasting]
    residual, jacobian = factor(*poses, *rest)
    wanted = numeric_jacobian(lambda *moved: factor(*moved)[0], list(poses), lasting)
    assert residual.shape == wanted.shape[:-1]
    assert jacobian.shape == wanted.shape
    np.testing.assert_allclose(jacobian, wanted, atol=tolerance, rtol=1e-6)
    for k in (0, 57):  # one state alone gives the same
        alone = factor(*(pose[k] for pose in poses), *rest)
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


def test_known_jacobian():
    rng = np.random.default_rng(8)
    for g, e in zip(random_poses(rng), random_poses(rng, "near pi"), strict=True):
        pose = se2.compose(se2.compose(e, se2.inverse(g)), se2.exp(rng.normal(0.0, 0.3, 3)))
        lasting, known_lasting = rng.normal(size=(2, 6))

        def known(g: Array, e: Array, lasting: Array, pose: Array = pose, known_lasting: Array = known_lasting):
            return factors.known(g, e, lasting, pose, known_lasting)

        residual, jacobian = known(g, e, lasting)
        wanted = numeric_jacobian(lambda *moved, known=known: known(*moved)[0], [g, e], lasting)
        assert residual.shape == (9,)
        np.testing.assert_allclose(jacobian, wanted, atol=1e-8, rtol=1e-6)


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
    depth = np.array([4e-4])
    check(lambda g, lasting: contact_rows(g, lasting[0], tip), g1, lasting=depth, tolerance=1e-7)
    sides = np.where(np.arange(STATES) % 2, 1.0, -1.0)

    def pushed(a: Array, b: Array, c: Array, d: Array, friction: Array) -> tuple[Array, Array]:
        return pushing_rows(a, b, c, d, tip, friction, sides if a.ndim > 1 else at(sides, g0, a))

    for friction in ((0.0, 0.0, 0.0, 0.0), (0.5, 0.3, -0.2, 0.4)):
        check(pushed, g0, e0, g1, e1, lasting=np.array(friction), tolerance=1e-6)


def test_pushing_takes_a_friction_for_each_state():
    rng = np.random.default_rng(9)
    tip = tip_with("ellipse", RADIUS)
    g1, e1 = near_outline("ellipse", tip, angles(rng, "anywhere"), rng), random_poses(rng)
    g0, e0 = se2.compose(g1, small(rng, 0.05)), se2.compose(e1, small(rng, 0.05))
    friction, side = rng.normal(0.0, 0.3, (STATES, 4)), rng.choice([-1.0, 1.0], STATES)
    residual, jacobian = pushing_rows(g0, e0, g1, e1, tip, friction, side)
    for k in range(0, STATES, 7):
        alone = pushing_rows(g0[k], e0[k], g1[k], e1[k], tip, friction[k], side[k])
        np.testing.assert_allclose(residual[k], alone[0], atol=1e-15)
        np.testing.assert_allclose(jacobian[k], alone[1], atol=1e-12)


def near_corner(tip: ContactModel, theta: Array, rng: np.random.Generator) -> Array:
    """Sensor poses in the object frame (STATES, 3) with the tip within 2 mm of the rectangle's upper right corner."""
    bearing = rng.uniform(0.1, 0.5 * math.pi - 0.1, STATES)
    away = tip.radius + rng.uniform(-2e-3, 2e-3, STATES)
    centers = np.array([0.2363, 0.1579]) / 2 + away[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    offset = se2.transform(np.column_stack([np.zeros((STATES, 2)), theta]), np.array(tip.center))
    return np.column_stack([centers - offset, theta])


@pytest.mark.parametrize("error", [0.0, 0.3, math.pi - 1e-4, 1e-4 - math.pi])
@pytest.mark.parametrize("where", ["anywhere", "near pi"])
@pytest.mark.parametrize("name", [*SHAPES, "corner"])
def test_direction_jacobian(name, where, error):
    rng = np.random.default_rng(5)
    for radius in (RADIUS,) if name == "corner" else (0.0, RADIUS):
        tip = tip_with("rectangle" if name == "corner" else name, radius)
        theta = angles(rng, where)
        g = near_corner(tip, theta, rng) if name == "corner" else near_outline(name, tip, theta, rng)
        bias = np.array([0.3])
        measured = se2.wrap(direction_rows(g, 0.0, 0.0, tip)[0][:, 0] + bias - error)

        def direction(pose: Array, bias: Array, tip: ContactModel = tip, g: Array = g, measured: Array = measured):
            return direction_rows(pose, measured if pose.ndim > 1 else at(measured, g, pose), bias[0], tip)

        # The Hessian's slope jumps between cells, by most where the L's inner corner bends the field: the rows of
        # pushing have it times the radius.
        check(direction, g, lasting=bias, tolerance=5e-5)
        np.testing.assert_allclose(direction_rows(g, measured, bias[0], tip)[0], error, atol=1e-12)


@pytest.mark.parametrize("error", [0.0, 0.3, math.pi - 1e-4, 1e-4 - math.pi])
@pytest.mark.parametrize("where", ["anywhere", "near pi"])
def test_turn_jacobian(where, error):
    rng = np.random.default_rng(6)
    g, offset = random_poses(rng, where), rng.uniform(-10.0, 10.0, STATES)
    angle = se2.wrap(g[:, 2] - offset - error)

    def turn_by_pose(pose: Array) -> tuple[Array, Array]:
        k = slice(None) if pose.ndim > 1 else np.argmax((g == pose).all(axis=-1))
        residual, jacobian = factors.turn(pose, offset[k], angle[k])
        return residual, jacobian[..., :3]

    check(turn_by_pose, g)
    residual, jacobian = factors.turn(g, offset, angle)
    np.testing.assert_allclose(residual[:, 0], error, atol=1e-12)
    by_offset = (factors.turn(g, offset + STEP, angle)[0] - factors.turn(g, offset - STEP, angle)[0]) / (2 * STEP)
    np.testing.assert_allclose(jacobian[..., 3], by_offset, atol=1e-8)


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
