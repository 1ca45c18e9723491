"""Jacobians of the factors against central differences and GTSAM's."""

import math

import numpy as np
import pytest
from push_samples import RADIUS, SHAPES, contact_directions, model_of, sensor, terms_of, values_at

from palpate.config import (
    BalanceSettings,
    ContactSettings,
    DirectionSettings,
    FrictionConeSettings,
    NoiseSettings,
    SensorPoseSettings,
    StickingSettings,
    TurnSettings,
)
from palpate.geometry import se2
from palpate.graph.belief import Belief
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factor_list import make_factors
from palpate.graph.factors.balance import Balance
from palpate.graph.factors.contact import Contact
from palpate.graph.factors.direction import Direction
from palpate.graph.factors.factor import Factor, Terms
from palpate.graph.factors.first_pose import FirstPose
from palpate.graph.factors.friction_cone import FrictionCone
from palpate.graph.factors.measured import Measured
from palpate.graph.factors.object_pose import ObjectPose
from palpate.graph.factors.sensor_pose import SensorPose
from palpate.graph.factors.sticking import Sticking
from palpate.graph.factors.turn import Turn
from palpate.graph.values import Values
from palpate.graph.variables import (
    DEPTH,
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    FRICTION_CENTER,
    FRICTION_RATIO,
    GRIP,
    OBJECT_SIZE,
    OUTLINE_SCALE,
    PLACE_BIAS,
    SHARED_SIZE,
    STEP_SIZE,
    TURN_OFFSET,
)
from palpate.types import measurements as said
from palpate.types.measurements import ContactDirection, OwnMeasurement

Array = np.ndarray
STATES = 100
STEP = 1e-6  # [m], [rad]: truncation 1e-12 times third derivatives, rounding 1e-16 / 1e-6
ROOT = np.linalg.cholesky([[2.0, 0.3, -0.1], [0.3, 1.0, 0.2], [-0.1, 0.2, 0.5]])  # so that all is mixed


def numeric_jacobian(factor: Factor, at: Values, terms: Terms) -> Array:
    """Central differences (B, T, R, N STEP_SIZE + SHARED_SIZE) by all numbers of all steps and of what they share."""
    columns = []
    steps = at.steps * STEP_SIZE
    for change in STEP * np.eye(steps + SHARED_SIZE):
        by_step = np.tile(change[:steps].reshape(1, at.steps, STEP_SIZE), (at.rows, 1, 1))
        by_shared = np.tile(change[steps:], (at.rows, 1))
        ends = [factor.linearise(at.moved(s * by_step, s * by_shared), terms).residual for s in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2 * STEP))
    return np.stack(columns, axis=-1)


def spread_jacobian(factor: Factor, at: Values, terms: Terms) -> Array:
    """The factor's own, spread over the same columns."""
    jacobian = factor.linearise(at, terms).jacobian
    spread = np.zeros((*jacobian.shape[:-1], at.steps * STEP_SIZE + SHARED_SIZE))
    for t, last in enumerate(terms.step):
        starts = [*(STEP_SIZE * (last - factor.spans + 1 + slot) for slot in range(factor.spans)), STEP_SIZE * at.steps]
        spans = [np.arange(a, a + size) + start for start, a, size in zip(starts, *factor.columns, strict=True)]
        spread[:, t][..., np.concatenate(spans)] = jacobian[:, t]
    return spread


def check(factor: Factor, at: Values, terms: Terms, tolerance: float = 1e-8) -> None:
    """Check the Jacobians of STATES smoothers; of as many terms, each belongs to one of them."""
    assert at.rows == STATES
    belong = (range(STATES), range(STATES)) if len(terms.data) == STATES else slice(None)
    found, wanted = spread_jacobian(factor, at, terms)[belong], numeric_jacobian(factor, at, terms)[belong]
    np.testing.assert_allclose(found, wanted, atol=tolerance, rtol=1e-6)
    assert np.abs(wanted).max() > 0.0
    rows = factor.linearise(at, terms)
    assert rows.residual.shape == rows.information.shape == rows.weight.shape == rows.jacobian.shape[:-1]
    assert rows.residual.shape == (STATES, len(terms.data), factor.rows)


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
    smooth = (np.abs(model.field.value(spots) - shape.signed_distance(spots)) < 2e-8).all(axis=1)
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
        GRIP: rng.uniform(0.0, 0.6, STATES),
    }


DISC = model_of("disc")


@pytest.mark.parametrize("where", ["anywhere", "near pi", "error near pi"])
def test_sensor_pose(where):
    rng = np.random.default_rng(2)
    e = random_poses(rng, where)
    error = close_to_pi(rng) if where == "error near pi" else small(rng, 0.3)
    factor = SensorPose(SensorPoseSettings())
    at = values_at(DISC, e[:, None])
    each = [terms_of(factor, at, pose=pose) for pose in se2.compose(e, se2.inverse(error))]
    check(factor, at, Terms(*(np.concatenate(parts) for parts in zip(*each, strict=True))))
    if where == "error near pi":
        assert np.abs(factor.linearise(at, each[0]).residual[0, 0, 2]) > 3.14


@pytest.mark.parametrize("where", ["anywhere", "near pi", "error near pi"])
def test_object_pose(where):
    rng = np.random.default_rng(3)
    g, e = random_poses(rng, where), random_poses(rng, where)
    error = close_to_pi(rng) if where == "error near pi" else small(rng, 0.3)
    measured = se2.compose(se2.compose(e, se2.inverse(g)), error)
    at = values_at(DISC, g[:, None], e[:, None])
    seen = [said.ObjectPose(pose, ROOT @ ROOT.T) for pose in measured]
    check(ObjectPose(), at, terms_of(ObjectPose(), at, seen), tolerance=1e-7)


@pytest.mark.parametrize("where", ["anywhere", "near pi"])
def test_first_pose(where):
    rng = np.random.default_rng(8)
    g, e = random_poses(rng, where), random_poses(rng, where)
    pose = se2.compose(se2.compose(e, se2.inverse(g)), small(rng, 0.3))
    root = np.eye(3 + OBJECT_SIZE) + 0.3 * rng.normal(size=(STATES, 3 + OBJECT_SIZE, 3 + OBJECT_SIZE))
    values = rng.normal(size=(STATES, OBJECT_SIZE))
    factor = FirstPose(Belief(pose, values, root @ root.transpose(0, 2, 1)))
    bias, scale, place, depth, larger, ratio, *center, grip = rng.normal(size=(OBJECT_SIZE, STATES))
    shared = {DIRECTION_BIAS: bias, DIRECTION_SCALE: scale, PLACE_BIAS: place, DEPTH: depth, OUTLINE_SCALE: larger}
    shared |= {FRICTION_RATIO: ratio, FRICTION_CENTER: np.array(center), GRIP: grip}
    at = values_at(DISC, g[:, None], e[:, None], shared)
    check(factor, at, terms_of(factor, at), tolerance=1e-6)  # an inverse root may be as large as 100


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
    contact = Contact(ContactSettings())
    shared = {DEPTH: rng.normal(0.0, 1e-3, STATES), OUTLINE_SCALE: rng.normal(0.0, 0.05, STATES)}
    at = values_at(model, g1[:, None], e1[:, None], shared)
    check(contact, at, terms_of(contact, at), tolerance=1e-7)
    for shared in ({}, friction(rng)):
        at = values_at(model, np.stack([g0, g1], axis=1), np.stack([e0, e1], axis=1), shared)
        for factor in (
            Sticking(StickingSettings()),
            Balance(BalanceSettings(), model),
            FrictionCone(FrictionConeSettings()),
        ):
            check(factor, at, terms_of(factor, at, moved=1e-3), tolerance=1e-6)


def test_contact_and_sticking_of_two_tips():
    # Two tips on the flat left side, each another one's mirror image.
    rng = np.random.default_rng(9)
    model = model_with("rectangle", RADIUS, (complex(-RADIUS, -0.03),))
    g1 = with_first_tip_at(
        np.column_stack([np.full(STATES, -0.2363 / 2 - RADIUS), rng.uniform(0.0, 0.03, STATES)]),
        model,
        rng.normal(0.0, 0.02, STATES),
    )
    g0 = se2.compose(g1, small(rng, 0.01))
    at = values_at(model, np.stack([g0, g1], axis=1))
    for factor in (Contact(ContactSettings()), Sticking(StickingSettings())):
        terms = terms_of(factor, at, moved=1e-3)
        check(factor, at, terms, tolerance=1e-6)


@pytest.mark.parametrize("error", [0.0, 0.3, math.pi - 1e-4, 1e-4 - math.pi])
@pytest.mark.parametrize("where", ["anywhere", "near pi"])
@pytest.mark.parametrize("name", [*SHAPES, "corner"])
def test_direction(name, where, error):
    rng = np.random.default_rng(5)
    for radius in (RADIUS,) if name == "corner" else (0.0, RADIUS):
        model = model_with("rectangle" if name == "corner" else name, radius)
        theta = angles(rng, where)
        g = near_corner(model, theta, rng) if name == "corner" else near_outline(name, model, theta, rng)
        bias = rng.uniform(-0.3, 0.3, STATES)
        scale = rng.uniform(-0.2, 0.2, STATES)
        measured = se2.wrap(contact_directions(g, model) + bias - error) / (1.0 - scale)
        factor = Direction(DirectionSettings())
        at = values_at(model, g[:, None], shared={DIRECTION_BIAS: bias, DIRECTION_SCALE: scale})
        terms = terms_of(factor, at, [ContactDirection(float(angle), 1.0) for angle in measured])
        # The Hessian's slope jumps between cells, by most where the L's inner corner bends the field: the rows of
        # pushing have it times the radius.
        check(factor, at, terms, tolerance=5e-5)
        np.testing.assert_allclose(np.diagonal(factor.linearise(at, terms).residual[..., 0]), error, atol=1e-12)


@pytest.mark.parametrize("error", [0.0, 0.3, math.pi - 1e-4, 1e-4 - math.pi])
@pytest.mark.parametrize("where", ["anywhere", "near pi"])
def test_turn(where, error):
    rng = np.random.default_rng(6)
    g, offset = random_poses(rng, where), rng.uniform(-10.0, 10.0, STATES)
    factor = Turn(TurnSettings())
    at = values_at(DISC, g[:, None], shared={TURN_OFFSET: offset})
    terms = terms_of(factor, at, [said.Turn(float(angle), 1.0) for angle in se2.wrap(g[:, 2] - offset - error)])
    check(factor, at, terms)
    np.testing.assert_allclose(np.diagonal(factor.linearise(at, terms).residual[..., 0]), error, atol=1e-12)


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
    terms = terms_of(Measured(), at, [Seen(), Stretched()])
    check(Measured(), at, terms, tolerance=1e-7)
    # What has fewer rows than there is room for leaves the others at nothing.
    rows = Measured().linearise(at, terms)
    assert not rows.residual[:, 0, 5:].any() and not rows.residual[:, 1, 1:].any()
    assert not rows.jacobian[:, 0, 5:].any() and not rows.jacobian[:, 1, 1:].any()


def test_many_hypotheses_at_once_are_each_as_alone():
    rng = np.random.default_rng(10)
    model = model_with("ellipse", RADIUS)
    g1, e1 = near_outline("ellipse", model, angles(rng, "anywhere"), rng), random_poses(rng)
    g0, e0 = se2.compose(g1, small(rng, 0.05)), se2.compose(e1, small(rng, 0.05))
    shared = {each: rng.normal(size=STATES) for each in (TURN_OFFSET, DIRECTION_BIAS, DIRECTION_SCALE)} | friction(rng)
    at = values_at(model, np.stack([g0, g1], axis=1), np.stack([e0, e1], axis=1), shared)
    measurements = [
        ContactDirection(0.4, 1e-2),
        said.ContactPlace(0.001, 1e-6),
        said.Turn(-0.2, 1e-2),
        said.ObjectPose(np.zeros(3), np.eye(3)),
        Seen(),
    ]
    for factor in make_factors(NoiseSettings(), model):
        terms = terms_of(factor, at, measurements, 1e-3)
        together = factor.linearise(at, terms)
        for k in (0, 57):
            one = {unknown: value[..., k] for unknown, value in shared.items()}
            alone = factor.linearise(values_at(model, [[g0[k], g1[k]]], [[e0[k], e1[k]]], one), terms)
            for a, b in zip(together, alone, strict=True):
                np.testing.assert_allclose(a[k], b[0], rtol=1e-12, atol=1e-15)
