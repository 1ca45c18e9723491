"""Jacobians of the factors against central differences."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from push_samples import (
    RADIUS,
    SHAPES,
    Linear,
    Values,
    contact_directions,
    distance_at,
    model_of,
    rows_of,
    sensor,
    values_at,
)

from palpate import ContactCorner, ContactDirection, Measurement, ObjectPose, OwnMeasurement, Turn
from palpate.geometry import se2
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.layout import OBJECT_SIZE, STEP_SIZE, WIDTH
from palpate.models.pushing.own_measurements import OwnMeasurements
from palpate.models.pushing.variables import (
    CORNER_BIAS,
    DEPTH,
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    FRICTION_CENTER,
    FRICTION_RATIO,
    GRIP,
    OUTLINE_SCALE,
    TURN_OFFSET,
)

Array = np.ndarray
STATES = 100
STEP = 1e-6  # [m], [rad]: truncation 1e-12 times third derivatives, rounding 1e-16 / 1e-6
ROOT = np.linalg.cholesky([[2.0, 0.3, -0.1], [0.3, 1.0, 0.2], [-0.1, 0.2, 0.5]])  # so that all is mixed


def perturbed(at: Values, change: Array) -> Values:
    """The values with all rows changed by a tangent vector (WIDTH,): of the step before, this step and shared."""
    steps, rows = at.steps.copy(), at.rows.copy()
    for k, first in ((-2, 0), (-1, STEP_SIZE)):
        if k + steps.shape[1] >= 0:
            for name, start in (("g", first), ("e", first + 3)):
                steps[name][:, k] = se2.compose(steps[name][:, k], se2.exp(change[start : start + 3]))
    rows["shared"] += change[2 * STEP_SIZE :]
    return Values(at.model, steps, rows)


def check(name: str, at: Values, told: Sequence[Measurement] = (), atol: float = 1e-8, pose: Any = (0, 0, 0)) -> Linear:
    """Check the Jacobians of STATES rows by central differences; of as many terms, each belongs to one of them."""
    rows = rows_of(name, at, told, 1e-3, pose)
    belong = (range(STATES), range(STATES)) if len(told) == STATES else slice(None)
    columns = []
    for change in STEP * np.eye(WIDTH):
        ends = [rows_of(name, perturbed(at, sign * change), told, 1e-3, pose).residual for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2 * STEP))
    wanted = np.stack(columns, axis=-1)[belong]
    np.testing.assert_allclose(rows.jacobian[belong], wanted, atol=atol, rtol=1e-6)
    assert np.abs(wanted).max() > 0.0
    return rows


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


def close_to_pi(rng: np.random.Generator) -> Array:
    """Errors whose angle is 1e-5 to 1e-3 from pi: Log jumps there, so that a difference step must not cross it."""
    error = random_poses(rng)
    error[:, 2] = np.where(np.arange(STATES) % 2, 1, -1) * (math.pi - rng.uniform(1e-5, 1e-3, STATES))
    return error


def model_with(name: str, radius: float, others: tuple[complex, ...] = ()) -> ContactModel:
    """A sensor whose tip's centre is on neither axis of it, and an object with the centre of friction aside."""
    known = model_of(name, sensor(radius))
    parts = np.array([complex(-radius, 0.004), *others])
    return ContactModel(known.field, parts, radius, known.friction_radius, 0.013 - 0.021j)


def with_first_tip_at(centers: Array, model: ContactModel, theta: Array) -> Array:
    """Sensor poses in the object frame (STATES, 3) with the first tip's centre of curvature at centers (STATES, 2)."""
    first = np.array([model.parts[0].real, model.parts[0].imag])
    offset = se2.transform(np.column_stack([np.zeros((STATES, 2)), theta]), first)
    return np.column_stack([centers - offset, theta])


def near_outline(name: str, model: ContactModel, theta: Array, rng: np.random.Generator) -> Array:
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
    centers = (outline + 0.5 * along + outward * (model.radius + rng.uniform(-2e-3, 2e-3, (len(outline), 1))))[pick]
    centers = centers[: 6 * STATES]  # of which more than half are smooth
    around = model.field.cell * np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-3, 4)), axis=-1).reshape(-1, 2)
    spots = centers[:, None] + around
    smooth = (np.abs(distance_at(model, spots)[0] - shape.signed_distance(spots)) < 2e-8).all(axis=1)
    assert smooth.mean() > 0.5
    return with_first_tip_at(centers[smooth][:STATES], model, theta)


def near_corner(model: ContactModel, theta: Array, rng: np.random.Generator) -> Array:
    """Sensor poses in the object frame (STATES, 3) with the tip within 2 mm of the rectangle's upper right corner."""
    bearing = rng.uniform(0.1, 0.5 * math.pi - 0.1, STATES)
    away = model.radius + rng.uniform(-2e-3, 2e-3, STATES)
    centers = np.array([0.2363, 0.1579]) / 2 + away[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    return with_first_tip_at(centers, model, theta)


def friction(rng: np.random.Generator) -> dict:
    """Values of friction, another one in each state."""
    return {
        FRICTION_RATIO: rng.normal(0.0, 0.3, STATES),
        FRICTION_CENTER: rng.normal(0.0, 0.3, (2, STATES)),
        GRIP: rng.uniform(-3.0, -0.5, STATES),
    }


DISC = model_of("disc")


@pytest.mark.parametrize("where", ["anywhere", "near pi", "error near pi"])
def test_sensor_pose(where):
    rng = np.random.default_rng(2)
    measured = np.array([0.3, -0.2, 3.1 if where == "near pi" else 0.4])
    error = close_to_pi(rng) if where == "error near pi" else small(rng, 0.3)
    at = values_at(DISC, se2.compose(measured, error)[:, None])
    rows = check("sensor_pose", at, pose=measured)
    if where == "error near pi":
        assert np.abs(rows.residual[0, 0, 2]) > 3.14


@pytest.mark.parametrize("where", ["anywhere", "near pi", "error near pi"])
def test_object_pose(where):
    rng = np.random.default_rng(3)
    g, e = random_poses(rng, where), random_poses(rng, where)
    error = close_to_pi(rng) if where == "error near pi" else small(rng, 0.3)
    measured = se2.compose(se2.compose(e, se2.inverse(g)), error)
    at = values_at(DISC, g[:, None], e[:, None])
    check("object_pose", at, [ObjectPose(pose, ROOT @ ROOT.T) for pose in measured], atol=1e-7)


@pytest.mark.parametrize("where", ["anywhere", "near pi"])
def test_first_pose(where):
    rng = np.random.default_rng(8)
    g, e = random_poses(rng, where), random_poses(rng, where)
    at = values_at(DISC, g[:, None], e[:, None])
    at.rows["first_pose"] = se2.compose(se2.compose(e, se2.inverse(g)), small(rng, 0.3))
    at.rows["first_values"], at.rows["shared"] = rng.normal(size=(STATES, OBJECT_SIZE)), 0.3
    at.rows["first_root"] = rng.normal(size=(STATES, 3 + OBJECT_SIZE, 3 + OBJECT_SIZE))
    check("first_pose", at, atol=1e-7)


@pytest.mark.parametrize("where", ["anywhere", "near pi"])
@pytest.mark.parametrize("radius", [0.0, RADIUS])
@pytest.mark.parametrize("name", SHAPES)
def test_contact_and_pushing(name, radius, where):
    rng = np.random.default_rng(4)
    model = model_with(name, radius)
    g1 = near_outline(name, model, angles(rng, where), rng)
    e1 = random_poses(rng, where)
    # Steps far larger than real ones: the Jacobian must not only be right where the residual vanishes.
    g0, e0 = se2.compose(g1, small(rng, 0.05)), se2.compose(e1, small(rng, 0.05))
    shared = {DEPTH: rng.normal(0.0, 1e-3, STATES), OUTLINE_SCALE: rng.normal(0.0, 0.05, STATES), **friction(rng)}
    at = values_at(model, np.stack([g0, g1], axis=1), np.stack([e0, e1], axis=1), shared)
    for factor in ("contact", "balance", "friction_cone"):
        check(factor, at, atol=1e-6)
    rows_of("sticking", at)
    is_settled = np.isin(at.steps["sliding"][:, 1], (-1.0, 0.0, 1.0))  # elsewhere it counts as constant, but is not
    assert is_settled.mean() > 0.8
    check("sticking", replace(at, steps=at.steps[is_settled], rows=at.rows[is_settled]), atol=1e-6)
    at.steps["slide"], at.steps["spread"] = 1e-3, 0.01  # something else moves the object
    for factor in ("disturbed_slide", "disturbed_turn"):
        check(factor, at, atol=1e-6)


@pytest.mark.parametrize("error", [0.0, 0.3, math.pi - 1e-4, 1e-4 - math.pi])
@pytest.mark.parametrize("where", ["anywhere", "near pi"])
@pytest.mark.parametrize("name", [*SHAPES, "corner"])
def test_direction(name, where, error):
    rng = np.random.default_rng(5)
    model = model_with("rectangle" if name == "corner" else name, RADIUS)
    theta = angles(rng, where)
    g = near_corner(model, theta, rng) if name == "corner" else near_outline(name, model, theta, rng)
    bias, scale = rng.uniform(-0.3, 0.3, STATES), rng.uniform(-0.2, 0.2, STATES)
    psi = contact_directions(g, model)
    measured = se2.wrap(psi + scale * np.sin(psi) + bias - error)
    at = values_at(model, g[:, None], shared={DIRECTION_BIAS: bias, DIRECTION_SCALE: scale})
    # The Hessian's slope jumps between cells, by most where the L's inner corner bends the field: the rows of pushing
    # have it times the radius.
    rows = check("direction", at, [ContactDirection(float(angle), 1.0) for angle in measured], atol=5e-5)
    np.testing.assert_allclose(np.diagonal(rows.residual[..., 0]), error, atol=1e-12)


@pytest.mark.parametrize("error", [0.0, 0.3, math.pi - 1e-4, 1e-4 - math.pi])
@pytest.mark.parametrize("where", ["anywhere", "near pi"])
def test_turn(where, error):
    rng = np.random.default_rng(6)
    g, offset = random_poses(rng, where), rng.uniform(-10.0, 10.0, STATES)
    at = values_at(DISC, g[:, None], shared={TURN_OFFSET: offset})
    rows = check("turn", at, [Turn(float(angle), 1.0) for angle in se2.wrap(g[:, 2] - offset - error)])
    np.testing.assert_allclose(np.diagonal(rows.residual[..., 0]), error, atol=1e-12)


@pytest.mark.parametrize("where", ["anywhere", "near pi"])
def test_corner(where):
    rng = np.random.default_rng(9)
    model = model_with("rectangle", RADIUS)
    model = replace(model, corners=model_of("rectangle").corners)
    g, bias = near_corner(model, angles(rng, where), rng), rng.uniform(-0.1, 0.1, STATES)
    psi = se2.wrap(contact_directions(g, model) + g[:, 2] - math.radians(225.0))
    told = [ContactCorner(float(angle), 1.0, 0.7) for angle in psi - bias - 0.2]  # a right angle: no slope
    at = values_at(model, g[:, None], shared={CORNER_BIAS: bias})
    rows = check("corner", at, told, atol=5e-5)
    np.testing.assert_allclose(np.diagonal(rows.residual[..., 0]), 0.2, atol=1e-9)
    at.rows["sign"] = -1.0  # measurements that are not from images do not turn
    np.testing.assert_allclose(rows_of("corner", at, told).residual, rows.residual)


def test_a_disturbed_step_slides_along_the_outline():
    # On the left side, the sensor 1 mm lower and 2 mm deeper than a step before: seen from the object's outline, whose
    # counter-clockwise way is down there, it slid by -1 mm, and by 2 mm across it.
    model = model_of("rectangle")
    g0 = np.array([-0.1182 + 1e-3, 0.02, 0.0])
    at = values_at(model, [[g0, g0 + np.array([2e-3, -1e-3, 0.0])]])
    at.steps["slide"], at.steps["spread"] = 5e-4, 0.01
    rows = rows_of("disturbed_slide", at)
    np.testing.assert_allclose(np.abs(rows.residual[0, 0]), [1.5e-3, 2e-3], atol=1e-8)
    np.testing.assert_allclose(rows.weight[0, 0], [1e4, 2e-3**-2])
    for factor in ("sticking", "balance", "friction_cone"):
        assert not rows_of(factor, at).weight.any()


class Seen(OwnMeasurement):
    """The object's pose, and something of three other unknowns."""

    on = ("object_pose", "friction_center", "sensor_in_object", "depth")

    def linearise(self, *values: Array) -> tuple[Array, Array]:
        pose, center, g, depth = values
        error = se2.log(se2.between(np.array([0.1, -0.2, 0.3]), pose))
        # Where the sensor's origin is along x of the object times the depth, and the centre's components multiplied.
        residual = np.array([*error, g[0] * depth[0], center[0] * center[1]])
        jacobian = np.zeros((5, 9))
        jacobian[:3, :3] = se2.right_jacobian_inverse(error)
        jacobian[3, 5:7] = depth[0] * math.cos(g[2]), -depth[0] * math.sin(g[2])
        jacobian[3, 8] = g[0]
        jacobian[4, 3:5] = center[1], center[0]
        return residual, jacobian


class Stretched(OwnMeasurement):
    """The square of the sensor's yaw, and of the offset of turns."""

    on = ("turn_offset", "sensor")

    def linearise(self, *values: Array) -> tuple[Array, Array]:
        (offset,), e = values
        return np.array([offset**2 + e[2] ** 2]), np.array([[2.0 * offset, 0.0, 0.0, 2.0 * e[2]]])


def test_own_measurements():
    rng = np.random.default_rng(7)
    g, e = random_poses(rng), random_poses(rng)
    e[:, 2] *= 0.9  # its square jumps at pi
    shared = {DEPTH: rng.normal(size=STATES), TURN_OFFSET: rng.normal(size=STATES), **friction(rng)}
    at = values_at(DISC, g[:, None], e[:, None], shared)

    def rows(change: Array) -> Array:
        there = perturbed(at, change)
        own = [(0, Seen()), (0, Stretched())]
        return OwnMeasurements([*own]).evaluated(0, there.steps, there.rows["shared"])

    here = rows(np.zeros(WIDTH))
    for c, change in enumerate(STEP * np.eye(WIDTH)[STEP_SIZE:]):
        by = (rows(change) - rows(-change))[..., 0] / (2 * STEP)
        np.testing.assert_allclose(here[..., 1 + c], by, atol=1e-7, rtol=1e-6)
    # What has fewer rows than there is room for leaves the others at nothing.
    assert not here[:, 0, 5:].any() and not here[:, 1, 1:].any()
