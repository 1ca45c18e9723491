"""Pushes from the estimator's own model, the shapes and tips that several tests use, and single rows of factors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from limit_surface import Steering, push
from numpy.typing import ArrayLike, NDArray

import palpate
from palpate import Disc, Ellipse, Frame, Measurement, NoiseSettings, Polygon, Rectangle, SensorProfile, Shape
from palpate.compiled import compiled
from palpate.estimation.variable import Variable
from palpate.geometry import se2
from palpate.manifolds.se2_kernels import position, rotation
from palpate.models.generated import linearise_measured, linearise_step, put_rotations
from palpate.models.pushing.compiled import PUSHING
from palpate.models.pushing.contact_geometry import SURFACE, ContactModel, Surface, contact_model, put_touch
from palpate.models.pushing.force import make_put_force
from palpate.models.pushing.layout import IN_SHARED, NAMES, OBJECT_SIZE
from palpate.models.pushing.measurements import Step, terms_of
from palpate.models.pushing.settings import SETTINGS, settings_record
from palpate.models.pushing.variables import GRIP

Array = np.ndarray
LINEAR, ROW, STEP, TERM = PUSHING.records.linear, PUSHING.records.row, PUSHING.records.step, PUSHING.records.term
STEP_FACTORS = NAMES.index("contact") + 1
put_force = make_put_force(PUSHING.model)
Shared = Mapping[Variable, ArrayLike]

RADIUS = 0.021  # [m], the DIGIT's
RATE = 30.0  # [Hz]
DEEPER = np.array([3e-4, 0.0, 0.0])  # [m], into the left side as deep as ROBUST of smoother_samples expects
HAND = 5  # frames in which a hand moves the object
SHAPES: dict[str, Shape] = {
    "disc": Disc(0.088),
    "rectangle": Rectangle(0.2363, 0.1579),
    "ellipse": Ellipse(0.1638, 0.2428),
    # An L whose centroid is not the origin.
    "concave": Polygon([(-0.09, -0.06), (0.07, -0.06), (0.07, 0.0), (-0.02, 0.0), (-0.02, 0.07), (-0.09, 0.07)]),
}


def with_settings(noise: NoiseSettings, **groups: dict[str, Any]) -> NoiseSettings:
    """The settings with some changed, by group: `sticking={"share": 0.1}`."""
    return replace(noise, **{name: replace(getattr(noise, name), **group) for name, group in groups.items()})


def sensor(radius: float = RADIUS, tips: tuple[tuple[float, float], ...] = ((0.0, 0.0),)) -> SensorProfile:
    return SensorProfile("test", radius=radius, tips=tips, rate=RATE)


@cache
def model_of(name: str, profile: SensorProfile = sensor()) -> ContactModel:  # noqa: B008
    return contact_model(SHAPES[name], profile)


def distance_at(model: ContactModel, points: Array) -> tuple[Array, Array]:
    """Distance from the outline (...) and its gradient (..., 2) at points (..., 2), as a sharp tip is there."""
    g = np.concatenate([points.reshape(1, -1, 2), np.zeros((1, points.size // 2, 1))], axis=-1)
    touch = replace(model, parts=np.zeros(1, np.complex128), radius=0.0).touching(g)[0].reshape(points.shape[:-1])
    return touch["gap"], np.stack([touch["normal"].real, touch["normal"].imag], axis=-1)


@dataclass(frozen=True)
class Values:
    model: ContactModel
    steps: Array  # STEP (B, N)
    rows: Array  # ROW (B,)


class Linear(NamedTuple):
    """T terms of R residual rows, linearised."""

    residual: Array  # (B, T, R)
    jacobian: Array  # (B, T, R, WIDTH)
    information: Array  # (B, T, R)
    weight: Array  # (B, T, R)


def values_at(model: ContactModel, g: ArrayLike, e: ArrayLike | None = None, shared: Shared | None = None) -> Values:
    """Values of B rows at N steps: g and e are (B, N, 3), shared variables (dimension,) or (dimension, B)."""
    steps = np.zeros(np.shape(g)[:2], STEP)
    rows = np.zeros(len(steps), ROW)
    steps["g"], steps["e"], rows["sign"] = g, g if e is None else e, 1.0
    for variable, value in (shared or {}).items():
        rows["shared"][:, IN_SHARED[variable]] = np.asarray(value, np.float64).reshape(variable.dimension, -1).T
    return Values(model, steps, rows)


@compiled(
    np.zeros((1, 1), STEP),
    np.zeros(1, ROW),
    np.zeros(1, TERM),
    0,
    np.zeros(1, SETTINGS),
    SURFACE,
    np.zeros((1, 1)),
    np.zeros((1, 1), LINEAR),
)
def _linearise(
    steps: Array, rows: Array, terms: Array, kind: int, settings: Any, surface: Surface, corners: Array, out: Array
) -> None:
    for b in range(len(steps)):
        for k in range(steps.shape[1]):
            now = steps[b, k]
            put_rotations(now)
            now.turn_measured = rotation(now.measured[2])
            put_touch(position(now.g), now.turn_g, surface, now.touch)
        for k in range(steps.shape[1]):
            put_force(steps[b], k, rows[b], settings[0])
        last, before = steps[b, steps.shape[1] - 1], steps[b, steps.shape[1] - 2]
        if kind < STEP_FACTORS:
            linearise_step(kind, before, last, rows[b], settings[0], out[b, 0])
        for t in range(len(terms)):
            linearise_measured(kind, last, rows[b], terms[t], settings[0], corners, out[b, t])


DEFAULT = NoiseSettings()
cached_factors = cache(settings_record)


def rows_of(
    name: str,
    at: Values,
    measurements: Sequence[Measurement] = (),
    moved: float = 0.0,
    pose: ArrayLike = (0, 0, 0),
    noise: NoiseSettings | None = None,
) -> Linear:
    """A factor on the last step, or the terms of measurements that arrive with it, linearised.

    The sensor was measured at a pose there and has moved so far [m].
    """
    kind, settings = NAMES.index(name), cached_factors(noise or DEFAULT, at.model)
    terms, _ = terms_of(PUSHING, Step(np.zeros(3), measurements), 0)
    terms = terms[terms[:, 1] == kind].view(TERM)[:, 0]
    at.steps["measured"][:, -1], at.steps["moved"][:, -1] = pose, moved
    out = np.zeros((len(at.rows), max(len(terms), int(kind < STEP_FACTORS))), LINEAR)
    _linearise(at.steps, at.rows, terms, kind, settings, at.model.surface, at.model.corners, out)
    count = ROWS.get(name, 1)
    return Linear(*(out[field][:, :, :count] for field in ("residual", "jacobian", "information", "weight")))


ROWS = {"sticking": 2, "disturbed_slide": 2, "sensor_pose": 3, "object_pose": 3, "first_pose": 3 + OBJECT_SIZE}


def gaps(g: Array, model: ContactModel) -> Array:
    """Gaps (...) [m] between sensor and outline at sensor poses g (..., 3) in the object frame."""
    return model.touching(np.array(g, np.float64).reshape(1, -1, 3))["gap"].reshape(np.shape(g)[:-1])


def contact_directions(g: Array, model: ContactModel) -> Array:
    """Where the tip is touched (...) [rad] at sensor poses g (..., 3) in the object frame."""
    rows = rows_of("direction", values_at(model, np.reshape(g, (-1, 1, 3))), [palpate.ContactDirection(0.0, 1.0)])
    return rows.residual[:, 0, 0].reshape(np.shape(g)[:-1])


def pushing_residuals(
    g0: Array, e0: Array, g1: Array, e1: Array, model: ContactModel, shared: Shared | None = None
) -> Array:
    """Residuals (..., 3) of sticking and balance over steps from g0, e0 to g1, e1 (..., 3)."""
    g, e = (np.stack([np.reshape(pose, (-1, 3)) for pose in ends], axis=1) for ends in ((g0, g1), (e0, e1)))
    at = values_at(model, g, e, shared)
    residual = np.concatenate([rows_of(name, at).residual[:, 0] for name in ("sticking", "balance")], axis=-1)
    return residual.reshape(*np.shape(g1)[:-1], 3)


def pushing_angles(g: Array, e: Array, model: ContactModel, shared: Shared | None = None) -> NDArray[np.float64]:
    """Angles (N - 1,) of the pushing force at all steps (N, 3) but the first."""
    at = values_at(model, g[None], e[None], shared)
    rows_of("sticking", at)
    return at.steps["force_angle"][0, 1:]


def touching(model: ContactModel, y: Array | float, theta: Array | float = 0.0) -> Array:
    """Sensor poses in the object frame (..., 3) that touch the object's left side at height y, pushing along +x."""
    g = np.stack(np.broadcast_arrays(-0.13, y, theta), axis=-1).astype(float)
    for _ in range(50):
        # Never overshoots: the distance falls no faster than x grows.
        g[..., 0] += gaps(g, model)
    return g


def pushed(
    name: str = "rectangle",
    steps: int = 60,
    y: float = 0.01,
    first: Array | None = None,
    steering: Steering | None = None,
    radius: float = RADIUS,
    tips: Any = ((0.0, 0.0),),
) -> tuple[Array, Array]:
    """Noise-free object and sensor poses (steps + 1, 3) of one push from the left."""
    model = model_of(name, sensor(radius, tuple(tips)))
    first = np.zeros(3) if first is None else first
    o, e = push(model, first[None], touching(model, np.array([y]), 0.05), steps, steering or Steering())
    return o[:, 0], e[:, 0]


def in_two_contacts(name: str, steps: int = 50, radius: float = RADIUS) -> tuple[Array, Array, Array]:
    """Object poses, sensor poses (N, 3) and contact (N,): push, ten frames away from the object, push again."""
    o1, e1 = pushed(name, steps, 0.015, radius=radius)
    o2, e2 = pushed(name, steps, -0.01, first=o1[-1], radius=radius)
    away = se2.compose(se2.compose(o1[-1], np.array([-0.25, 0.0, 0.0])), np.zeros((10, 3)))
    o = np.concatenate([o1, np.broadcast_to(o1[-1], (10, 3)), o2])
    contact = np.repeat([True, False, True], [len(o1), 10, len(o2)])
    return o, np.concatenate([e1, away, e2]), contact


def frames(o: Array, e: Array, contact: Array | bool = True, start: float = 0.0) -> list[Frame]:
    """Frames of these object and sensor poses (N, 3), with the object poses as ground truth."""
    flags = np.broadcast_to(contact, len(e))
    return [
        Frame(start + k / RATE, e[k].copy(), contact=bool(flags[k]), object_pose=o[k].copy()) for k in range(len(e))
    ]


@cache
def slid(y: float, heading: float, grip: float, steps: int) -> tuple[Array, Array]:
    """Object and sensor poses of a push by which the sensor slides along the rectangle's left side.

    The sensor goes straight on at an angle of heading [rad] from the side's normal at first, outside the friction cone.
    The object moves as the balance says with the force at the cone's edge, and the sensor stays on its side.
    """
    model, on_normal_balance_and_cone = model_of("rectangle"), [0, 2, 3]
    g = touching(model, y) + DEEPER
    touches, sensors = [g], [g]
    for _ in range(steps):
        e = sensors[-1] + 1e-3 * np.array([np.cos(heading), np.sin(heading), 0.0])
        g = touches[-1]
        for _ in range(8):
            at = values_at(model, [[touches[-1], g]], [[sensors[-1], e]], {GRIP: np.log(grip)})
            rows = [rows_of(name, at) for name in ("sticking", "balance", "friction_cone")]
            residual = np.concatenate([one.residual[0, 0] for one in rows])[on_normal_balance_and_cone]
            jacobian = np.concatenate([one.jacobian[0, 0, :, 6:9] for one in rows])  # by g1
            change = -np.linalg.solve(jacobian[on_normal_balance_and_cone], residual)
            g = se2.compose(g, se2.exp(change))
            if np.abs(change).max() < 1e-13:
                break
        touches.append(g)
        sensors.append(e)
    return se2.compose(np.array(sensors), se2.inverse(np.array(touches))), np.array(sensors)


def by_hand(o: Array, e: Array, slid: float, turned: float, steps: int) -> tuple[Array, Array]:
    """Object and sensor poses of a push of the rectangle, what a hand does after it, and so many steps of pushing on.

    The hand slides the object over the sensor [m] and turns it [rad].
    """
    model, objects, sensors, g = model_of("rectangle"), [*o], [*e], se2.between(o[-1], e[-1])
    for _ in range(HAND):
        sensor_pose = se2.compose(sensors[-1], [1e-3, 0.0, 0.0])
        g = model.moved_along(g[None], np.array([-slid / HAND]))[0] - [0.0, 0.0, turned / HAND]
        for _ in range(5):
            touch = model.touching(g[None, None])[0, 0]
            way = touch["gap"] * touch["normal"]
            g = g - [way.real, way.imag, 0.0]
        objects.append(se2.compose(sensor_pose, se2.inverse(g)))
        sensors.append(sensor_pose)
    o_after, e_after = push(model, objects[-1][None], g[None], steps, Steering())
    return np.concatenate([objects, o_after[1:, 0]]), np.concatenate([sensors, e_after[1:, 0]])


def noisy(poses: Array, sigmas: tuple[float, float, float], rng: np.random.Generator) -> Array:
    return se2.compose(poses, se2.exp(rng.normal(size=poses.shape) * sigmas))


def draw_residuals(
    model: ContactModel,
    noise: NoiseSettings,
    speed: float,
    outward: float,
    steps: int,
    count: int,
    rng: np.random.Generator,
) -> tuple[Array, Array, Array]:
    """Draw the noise of count pushes on a straight side whose outward normal points to outward [rad].

    Returns the first gap between tip and side (count,) [m], and the slip (steps, count, 2) [m] and torque
    (steps, count) [m^2] that `push` takes. The graph has two Gaussians on the same gaps, one on each (contact) and one
    on their differences (the normal part of sticking), so they are drawn from the product of both.
    """
    slip_sigma = np.hypot(noise.sticking.still, noise.sticking.share * speed)
    torque_sigma = np.hypot(noise.balance.still, noise.balance.share * speed * model.friction_radius)
    differences = np.diff(np.eye(steps + 1), axis=0)
    information = np.eye(steps + 1) / noise.contact.deviation**2 + differences.T @ differences / slip_sigma**2
    gaps = np.linalg.solve(np.linalg.cholesky(information).T, rng.normal(size=(steps + 1, count)))
    along_normal, along_side = -np.diff(gaps, axis=0), rng.normal(0.0, slip_sigma, (steps, count))
    normal, side = np.array([np.cos(outward), np.sin(outward)]), np.array([-np.sin(outward), np.cos(outward)])
    slip = along_normal[..., None] * normal + along_side[..., None] * side
    return gaps[0], slip, rng.normal(0.0, torque_sigma, (steps, count))
