"""Pushes drawn from the estimator's own model: sticking contact on an ellipsoidal limit surface.

They are as easy as the estimator assumes the world to be, for tests of consistency and the benchmark. The equations are
written here apart from the factors, so that they test each other.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.variables import FRICTION_CENTER, FRICTION_RATIO

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Steering:
    """Motion of the pushing sensor: forward, turning towards the object's centre and to and fro."""

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
    friction: Mapping[Any, ArrayLike] | None = None,
) -> tuple[Array, Array]:
    """Push B objects at once for a number of steps and return their poses and the sensors', (steps + 1, B, 3) each.

    object_pose (B, 3) are the first object poses in the world, touched (B, 3) the first sensor poses in the object
    frame, phase (B,) [rad] that of the sway. slip (steps, B, 2) [m] and torque (steps, B) [m^2] are the residuals of
    sticking and balance; 0 is the noise-free model. friction has values of FRICTION_RATIO and FRICTION_CENTER,
    (dimension,) or (dimension, B); without, they are the model's.

    A turn by omega in a step opens the gap by r omega^2 / 2, which is noise to sticking and would add up to millimetres
    in minutes. The slip of the next step takes it back.
    """
    g = np.broadcast_to(touched, np.broadcast_shapes(np.shape(touched), np.shape(object_pose))).astype(np.float64)
    e = se2.compose(object_pose, g)
    slip = np.broadcast_to(slip, (steps, len(g), 2))
    torque = np.broadcast_to(torque, (steps, len(g)))
    ratio, center = (
        np.asarray((friction or {}).get(each, np.zeros(each.dimension)), np.float64).reshape(each.dimension, -1)
        for each in (FRICTION_RATIO, FRICTION_CENTER)
    )
    c_squared = model.friction_radius**2 * np.exp(ratio[0])
    pivot = model.friction_center + model.friction_radius * (center[0] + 1j * center[1])
    sensors, touches = [e], [g]
    gap = model.touching(g[None])[0]["gap"]
    for step in range(steps):
        aim = se2.transform(se2.inverse(g), np.array([model.friction_center.real, model.friction_center.imag]))
        bearing = np.arctan2(aim[..., 1], aim[..., 0])
        turn = steering.aim * bearing + steering.sway * np.sin(2 * np.pi * step / steering.period + phase)
        forward = np.full_like(turn, steering.speed)
        e_next = se2.compose(e, se2.exp(np.stack([forward, np.zeros_like(turn), turn], axis=-1)))
        contact = model.touching(g[None])[0]
        normal = np.stack([contact["normal"].real, contact["normal"].imag], axis=-1)
        slid = slip[step] + (contact["gap"] - gap)[:, None] * normal
        gap = gap - np.sum(slip[step] * normal, axis=-1)
        wanted = np.concatenate([slid, torque[step][:, None]], axis=-1)
        g, e = _solved(model, g, e, e_next, c_squared, pivot, wanted), e_next
        sensors.append(e)
        touches.append(g)
    world_T_sensor = np.stack(sensors)
    return se2.compose(world_T_sensor, se2.inverse(np.stack(touches))), world_T_sensor


def _solved(
    model: ContactModel, g0: Array, e0: Array, e1: Array, c_squared: Array, pivot: Complex, wanted: Array
) -> Array:
    """Return the sensor-in-object poses (B, 3) after a step, by Newton's method on the residuals of pushing (Eq. 7).

    These are the sliding of the contact (2 rows, object frame) and the balance of force and torque on the limit
    surface, p x v - c^2 omega, about the centre of friction. Vectors are complex.
    """
    (place0, turn0), (e_place0, e_turn0), (e_place1, e_turn1) = (_complex(each) for each in (g0, e0, e1))
    pivot_in_sensor1 = (e_place0 + e_turn0 * ((pivot - place0) / turn0) - e_place1) / e_turn1
    g1 = np.ascontiguousarray(g0)
    residual, jacobian = np.empty((len(g1), 3)), np.empty((len(g1), 3, 3))
    for _ in range(8):
        contact = model.touching(g1[None])[0]
        slid = place0 + turn0 * contact["material"] - contact["point"]
        slid_by_g1 = turn0[:, None] * contact["material_by_g"] - contact["point_by_g"]
        place1, turn1 = _complex(g1)
        motion = pivot - place1 - turn1 * pivot_in_sensor1
        arm, omega = contact["point"] - pivot, se2.wrap(e1[:, 2] - e0[:, 2] - g1[:, 2] + g0[:, 2])
        moving = turn1[:, None] * np.stack([np.ones_like(arm), 1j * np.ones_like(arm), 1j * pivot_in_sensor1], axis=1)
        residual[:] = np.stack([slid.real, slid.imag, _cross(arm, motion) - c_squared * omega], axis=1)
        jacobian[:, 0], jacobian[:, 1] = slid_by_g1.real, slid_by_g1.imag
        jacobian[:, 2] = _cross(contact["point_by_g"], motion[:, None]) - _cross(arm[:, None], moving)
        jacobian[:, 2, 2] += c_squared
        change = np.linalg.solve(jacobian, (wanted - residual)[..., None])[..., 0]
        g1 = se2.compose(g1, se2.exp(change))
        if np.abs(change).max() < 1e-12:  # [m], [rad]
            return g1
    raise EstimationError("the step of a push has no solution near the last one; make it smaller")


def _complex(pose: Array) -> tuple[Complex, Complex]:
    """Return position and direction of poses (B, 3) as complex numbers (B,)."""
    return pose[:, 0] + 1j * pose[:, 1], np.exp(1j * pose[:, 2])


def _cross(a: Complex, b: Complex) -> Array:
    return (np.conj(a) * b).imag
