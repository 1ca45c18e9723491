"""Pushes drawn from the estimator's own model: sticking contact on an ellipsoidal limit surface.

They are as easy as the estimator believes the world to be, which is what a test of consistency and a benchmark need;
they say nothing about how well the model fits real pushes.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import NoiseSettings
from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.balance import Balance
from palpate.graph.factors.factor import Step, Terms
from palpate.graph.factors.sticking import Sticking
from palpate.graph.values import Values
from palpate.graph.variables import IN_SHARED, SENSOR, SENSOR_IN_OBJECT, SHARED_SIZE, Unknown

Array = NDArray[np.float64]

Friction = Mapping[Unknown, ArrayLike]
"""Values of FRICTION_RATIO and FRICTION_CENTER; what is left out is as the model has it."""

_NEWTON_STEPS = 8
_CONVERGED = 1e-12  # [m], [rad]: far below any noise that is drawn


@dataclass(frozen=True)
class Steering:
    """How the sensor moves while it pushes: forward, turning towards the object's centre and to and fro."""

    speed: float = 1.0e-3
    """Forward motion per frame [m]."""
    aim: float = 0.04
    """Share of the bearing of the object's centre, seen from the sensor, that is turned off per frame."""
    sway: float = 6e-3
    """Amplitude of the turning to and fro [rad per frame]."""
    period: float = 90.0
    """Period of the turning to and fro [frames]."""


def push(
    model: ContactModel,
    object_pose: Array,
    touched: Array,
    steps: int,
    steering: Steering,
    phase: Array | float = 0.0,
    slip: Array | float = 0.0,
    torque: Array | float = 0.0,
    friction: Friction | None = None,
) -> tuple[Array, Array]:
    """Push B objects at once for a number of steps and return their poses and the sensors', (steps + 1, B, 3) each.

    object_pose (B, 3) are the first object poses in the world, touched (B, 3) the first sensor poses in the object
    frame, phase (B,) [rad] that of the sway. slip (steps, B, 2) [m] and torque (steps, B) [m^2] are the values that
    the sticking and balance factors have as residuals; 0 is the noise-free model. A value of friction is (dimension,)
    or (dimension, B); grip is of no account, for the contact sticks.

    A turn by omega in a step opens the gap by r omega^2 / 2, which is noise to sticking and would add up to millimetres
    in minutes, with a tip that pushes and does not touch. The slip of the next step takes it back.
    """
    g = np.broadcast_to(touched, np.broadcast_shapes(np.shape(touched), np.shape(object_pose))).astype(np.float64)
    e = se2.compose(object_pose, g)
    slip = np.broadcast_to(slip, (steps, *g.shape[:-1], 2))
    torque = np.broadcast_to(torque, (steps, *g.shape[:-1]))
    sensors, touches = [e], [g]
    gap, _ = _gap(model, g)
    for step in range(steps):
        aim = se2.transform(se2.inverse(g), np.array([model.friction_center.real, model.friction_center.imag]))
        bearing = np.arctan2(aim[..., 1], aim[..., 0])
        turn = steering.aim * bearing + steering.sway * np.sin(2 * np.pi * step / steering.period + phase)
        forward = np.full_like(turn, steering.speed)
        e_next = se2.compose(e, se2.exp(np.stack([forward, np.zeros_like(turn), turn], axis=-1)))
        found, normal = _gap(model, g)
        slid = slip[step] + (found - gap)[..., None] * normal
        gap = gap - np.sum(slip[step] * normal, axis=-1)
        g = _pushed(g, e, e_next, model, friction or {}, np.concatenate([slid, torque[step][..., None]], axis=-1))
        e = e_next
        sensors.append(e)
        touches.append(g)
    world_T_sensor = np.stack(sensors)
    return se2.compose(world_T_sensor, se2.inverse(np.stack(touches))), world_T_sensor


def draw_residuals(
    model: ContactModel,
    noise: NoiseSettings,
    speed: float,
    outward: float,
    steps: int,
    count: int,
    rng: np.random.Generator,
) -> tuple[Array, Array, Array]:
    """Draw what the model leaves open in count pushes on a straight side whose outward normal points to outward [rad].

    Returns the first gap between tip and side (count,) [m], and the slip (steps, count, 2) [m] and torque
    (steps, count) [m^2] that `push` takes. The graph has two Gaussians on the same gaps, one on each (contact) and one
    on their differences (the normal part of sticking), so they are drawn from the product of both.
    """
    sticking = noise.sticking
    slip_sigma = np.hypot(sticking.still, sticking.share * speed)
    torque_sigma = Balance(noise.balance, model).deviation(speed)
    differences = np.diff(np.eye(steps + 1), axis=0)
    information = np.eye(steps + 1) / noise.contact.deviation**2 + differences.T @ differences / slip_sigma**2
    gaps = np.linalg.solve(np.linalg.cholesky(information).T, rng.normal(size=(steps + 1, count)))
    along_normal, along_side = -np.diff(gaps, axis=0), rng.normal(0.0, slip_sigma, (steps, count))
    normal, side = np.array([np.cos(outward), np.sin(outward)]), np.array([-np.sin(outward), np.cos(outward)])
    slip = along_normal[..., None] * normal + along_side[..., None] * side
    return gaps[0], slip, rng.normal(0.0, torque_sigma, (steps, count))


def _gap(model: ContactModel, g: Array) -> tuple[Array, Array]:
    """Gap (...) [m] between sensor and outline at poses g (..., 3), and the outline's normal (..., 2)."""
    touch = model.touching(np.ascontiguousarray(g).reshape(1, -1, 3))[0]
    normal = np.stack([np.real(touch["normal"]), np.imag(touch["normal"])], axis=-1)
    return touch["gap"].reshape(g.shape[:-1]), normal.reshape(*g.shape[:-1], 2)


def _pushed(g: Array, e: Array, e_next: Array, model: ContactModel, friction: Friction, wanted: Array) -> Array:
    """The sensor-in-object pose after a step, by Newton's method on the residuals of pushing (Eq. 7)."""
    shape, noise = g.shape, NoiseSettings()
    g, e, e_next = (np.ascontiguousarray(pose).reshape(-1, 3) for pose in (g, e, e_next))
    shared = np.zeros((SHARED_SIZE, len(g)))
    for unknown, value in friction.items():
        given = np.asarray(value, np.float64)
        shared[IN_SHARED[unknown]] = given.reshape(unknown.dimension, -1)
    sticking, balance = Sticking(noise.sticking), Balance(noise.balance, model)
    # The rows of g1 in the Jacobians: sticking is on g0 and g1, balance on g0, e0, g1, e1 and friction.
    columns = (sticking, slice(3, 6)), (balance, slice(6, 9))
    terms = [_on_two_steps(factor.terms(Step(e_next[0], e[0], (), (0.0, 1.0)))) for factor, _ in columns]
    g_next = g
    for _ in range(_NEWTON_STEPS):
        values = {SENSOR_IN_OBJECT: np.stack([g, g_next], axis=1), SENSOR: np.stack([e, e_next], axis=1)}
        at = Values(model, values, shared)
        rows = [factor.linearise(at, given) for (factor, _), given in zip(columns, terms, strict=True)]
        residual = np.concatenate([one.residual[:, 0] for one in rows], axis=-1)
        by_next = [one.jacobian[:, 0, :, part] for one, (_, part) in zip(rows, columns, strict=True)]
        off = wanted.reshape(-1, 3) - residual
        change = np.linalg.solve(np.concatenate(by_next, axis=1), off[..., None])[..., 0]
        g_next = se2.compose(g_next, se2.exp(change))
        if np.abs(change).max() < _CONVERGED:
            return g_next.reshape(shape)
    raise EstimationError("the step of a push has no solution near the last one; make it smaller")


def _on_two_steps(terms: Terms | None) -> Terms:
    """The terms that arrive with a step, with places among it and the one before."""
    assert terms is not None
    return Terms(terms.places + 1, terms.data)
