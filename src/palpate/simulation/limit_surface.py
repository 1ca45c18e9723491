"""Pushes drawn from the estimator's own model: sticking contact on an ellipsoidal limit surface.

They are as easy as the estimator believes the world to be, which is what a test of consistency and a benchmark need;
they say nothing about how well the model fits real pushes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph.factors import ContactModel, touching
from palpate.graph.noise import GraphNoise
from palpate.graph.pushing import pushing

Array = NDArray[np.float64]

NOMINAL = (0.0, 0.0, 0.0, 0.0)
"""Friction as the tip's model has it."""

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
    tip: ContactModel,
    object_pose: Array,
    touched: Array,
    steps: int,
    steering: Steering,
    phase: Array | float = 0.0,
    slip: Array | float = 0.0,
    torque: Array | float = 0.0,
    friction: ArrayLike = NOMINAL,
) -> tuple[Array, Array]:
    """Push B objects at once for a number of steps and return their poses and the sensors', (steps + 1, B, 3) each.

    object_pose (B, 3) are the first object poses in the world, touched (B, 3) the first sensor poses in the object
    frame, phase (B,) [rad] that of the sway. slip (steps, B, 2) [m] and torque (steps, B) [m^2] are the values that
    the sticking and balance rows of the pushing residual take; 0 is the noise-free model. friction (4,) or (B, 4) is
    what `pushing.pushing` takes; its grip is of no account, for the contact sticks.
    """
    g = np.broadcast_to(touched, np.broadcast_shapes(np.shape(touched), np.shape(object_pose))).astype(np.float64)
    e = se2.compose(object_pose, g)
    slip = np.broadcast_to(slip, (steps, *g.shape[:-1], 2))
    torque = np.broadcast_to(torque, (steps, *g.shape[:-1]))
    sensors, touches = [e], [g]
    for step in range(steps):
        aim = se2.transform(se2.inverse(g), np.asarray(tip.friction_center))
        bearing = np.arctan2(aim[..., 1], aim[..., 0])
        turn = steering.aim * bearing + steering.sway * np.sin(2 * np.pi * step / steering.period + phase)
        forward = np.full_like(turn, steering.speed)
        e_next = se2.compose(e, se2.exp(np.stack([forward, np.zeros_like(turn), turn], axis=-1)))
        g = _pushed(g, e, e_next, tip, friction, np.concatenate([slip[step], torque[step][..., None]], axis=-1))
        e = e_next
        sensors.append(e)
        touches.append(g)
    world_T_sensor = np.stack(sensors)
    return se2.compose(world_T_sensor, se2.inverse(np.stack(touches))), world_T_sensor


def draw_residuals(
    tip: ContactModel, noise: GraphNoise, speed: float, outward: float, steps: int, count: int, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Draw what the model leaves open in count pushes on a straight side whose outward normal points to outward [rad].

    Returns the first gap between tip and side (count,) [m], and the slip (steps, count, 2) [m] and torque
    (steps, count) [m^2] that `push` takes. The graph has two Gaussians on the same gaps, one on each (contact) and one
    on their differences (the normal part of sticking), so they are drawn from the product of both.
    """
    ahead, moved, grip = np.zeros(1), np.array([speed]), noise.grip[0]
    sigmas = noise.pushing_weight(np.zeros((1, 4)), moved, tip, ahead, grip)[0, :3] ** -0.5
    differences = np.diff(np.eye(steps + 1), axis=0)
    information = np.eye(steps + 1) / noise.contact**2 + differences.T @ differences / sigmas[0] ** 2
    gaps = np.linalg.solve(np.linalg.cholesky(information).T, rng.normal(size=(steps + 1, count)))
    along_normal, along_side = -np.diff(gaps, axis=0), rng.normal(0.0, sigmas[1], (steps, count))
    normal, side = np.array([np.cos(outward), np.sin(outward)]), np.array([-np.sin(outward), np.cos(outward)])
    slip = along_normal[..., None] * normal + along_side[..., None] * side
    return gaps[0], slip, rng.normal(0.0, sigmas[2], (steps, count))


def _pushed(g: Array, e: Array, e_next: Array, tip: ContactModel, friction: ArrayLike, wanted: Array) -> Array:
    """The sensor-in-object pose after a step, by Newton's method on the rows of the pushing residual (Eq. 7)."""
    g_next = g
    for _ in range(_NEWTON_STEPS):
        residual, jacobian = pushing(g, e, g_next, e_next, touching(g_next, tip), tip, friction, side=0.0)
        change = np.linalg.solve(jacobian[..., :3, 6:9], (wanted - residual[..., :3])[..., None])[..., 0]
        g_next = se2.compose(g_next, se2.exp(change))
        if np.abs(change).max() < _CONVERGED:
            return g_next
    raise EstimationError("the step of a push has no solution near the last one; make it smaller")
