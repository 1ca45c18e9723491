"""Pushes drawn from the estimator's own model: sticking contact on an ellipsoidal limit surface.

They are as easy as the estimator assumes the world to be, for tests of consistency and the benchmarks. The equations
are written here apart from the factors, so that they test each other.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.variables import FRICTION_CENTER, FRICTION_RATIO

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class Steering(NamedTuple):
    """Motion of the sensor per frame: forward [m], share of the bearing of the object's centre turned off, and sway."""

    speed: float = 1.0e-3
    aim: float = 0.04
    sway: float = 6e-3  # amplitude [rad]
    period: float = 90.0  # [frames]


def push(
    model: ContactModel,
    object_pose: Array,
    touched: Array,
    steps: int,
    steering: Steering,
    phase: Array | float = 0.0,
    slip: Array | float = 0.0,
    torque: Array | float = 0.0,
    friction: Mapping[Any, ArrayLike] | None = None,
    grip: float = np.inf,
) -> tuple[Array, Array]:
    """Push B objects at once for a number of steps and return their poses and the sensors', (steps + 1, B, 3) each.

    object_pose (B, 3) are the first object poses in the world, touched (B, 3) the first sensor poses in the object
    frame, phase (B,) [rad] that of the sway. slip (steps, B, 2) [m] and torque (steps, B) [m^2] are the residuals of
    sticking and balance; 0 is the noise-free model. friction has values of FRICTION_RATIO and FRICTION_CENTER,
    (dimension,) or (dimension, B); without, they are the model's. `grip` is the coefficient of friction at the contact,
    which slides along the outline where it cannot stick.

    A turn by omega in a step opens the gap by r omega^2 / 2, which is noise to sticking and would add up to millimetres
    in minutes. The slip of the next step takes it back.
    """
    g = np.broadcast_to(touched, np.broadcast_shapes(np.shape(touched), np.shape(object_pose))).astype(np.float64)
    e = se2.compose(object_pose, g)
    slip = np.broadcast_to(slip, (steps, len(g), 2))
    torque = np.broadcast_to(torque, (steps, len(g)))
    ratio = _value_of(FRICTION_RATIO, friction)
    center = _value_of(FRICTION_CENTER, friction)
    c_squared = model.friction_radius**2 * np.exp(ratio[0])
    pivot = model.friction_center + model.friction_radius * (center[0] + 1j * center[1])
    sensors = [e]
    touches = [g]
    contact = model.touching(g[None])[0]
    gap = contact["gap"]
    for step in range(steps):
        aim = se2.transform(se2.inverse(g), np.array([model.friction_center.real, model.friction_center.imag]))
        turn = steering.aim * np.arctan2(aim[..., 1], aim[..., 0])
        turn = turn + steering.sway * np.sin(2 * np.pi * step / steering.period + phase)
        ahead = np.stack([np.full_like(turn, steering.speed), np.zeros_like(turn), turn], axis=-1)
        e_next = se2.compose(e, se2.exp(ahead))
        normal = np.stack([np.real(contact["normal"]), np.imag(contact["normal"])], axis=-1)
        slid = slip[step] + (contact["gap"] - gap)[:, None] * normal
        gap = gap - np.sum(slip[step] * normal, axis=-1)
        wanted = np.concatenate([slid, torque[step][:, None]], axis=-1)
        g, contact = _solved(model, g, e, e_next, c_squared, pivot, wanted, grip)
        e = e_next
        sensors.append(e)
        touches.append(g)
    world_T_sensor = np.stack(sensors)
    return se2.compose(world_T_sensor, se2.inverse(np.stack(touches))), world_T_sensor


def _value_of(variable: Any, friction: Mapping[Any, ArrayLike] | None) -> Array:
    """Return the value of a variable (dimension, 1 or B), by default zeros."""
    given = (friction or {}).get(variable, np.zeros(variable.dimension))
    return np.asarray(given, np.float64).reshape(variable.dimension, -1)


def _solved(
    model: ContactModel, g0: Array, e0: Array, e1: Array, c_squared: Array, pivot: Complex, wanted: Array, grip: float
) -> tuple[Array, NDArray[np.void]]:
    """Return the sensor-in-object poses (B, 3) after a step, and the contact there, by Newton's method on Eq. 7.

    Residuals of pushing are the sliding of the contact (2 rows, object frame) and the balance of force and torque on
    the limit surface, p x v - c^2 omega, about the centre of friction. Where the motion of that centre, and so the
    force, is outside the friction cone, its distance from the edge takes the place of sliding along the outline.
    """
    o0 = se2.compose(e0, se2.inverse(g0))
    changes = 1e-6 * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    g1 = g0
    place0 = g0[:, :1] + 1j * g0[:, 1:2]
    turn0 = np.exp(1j * g0[:, 2:])
    slip = wanted[:, :1] + 1j * wanted[:, 1:2]
    side = np.zeros((len(g0), 1))
    for _ in range(16):
        tried = np.ascontiguousarray(se2.compose(g1[:, None], se2.exp(changes)))  # (B, 7, 3)
        touch = model.touching(tried)
        # The object before the step, in its frame after it.
        before = se2.between(se2.compose(e1[:, None], se2.inverse(tried)), o0[:, None])
        moved = pivot[:, None] - (before[..., 0] + 1j * before[..., 1] + np.exp(1j * before[..., 2]) * pivot[:, None])
        inward = -touch["normal"].conjugate()
        slid = (place0 + turn0 * touch["material"] - touch["point"] - slip) * inward
        force = moved * inward
        along = np.where(side == 0.0, slid.imag, force.imag - side * grip * force.real) if side.any() else slid.imag
        torque = ((touch["point"] - pivot[:, None]).conjugate() * moved).imag + c_squared[:, None] * before[..., 2]
        rows = np.stack([slid.real, along, torque - wanted[:, 2:]], axis=-1)
        jacobian = (rows[:, 1:4] - rows[:, 4:]).transpose(0, 2, 1) / 2e-6
        change = np.linalg.solve(jacobian, -rows[:, 0, :, None])[..., 0]
        g1 = se2.compose(g1, se2.exp(change))
        if np.abs(change).max() < 1e-12:  # [m], [rad]
            slides = (side == 0.0) & (np.abs(force.imag) > grip * force.real)[:, :1]
            if not slides.any():
                return g1, model.touching(g1[None])[0]
            side = np.where(slides, np.sign(force.imag[:, :1]), side)
    raise EstimationError("the step of a push has no solution near the last one; make it smaller")
