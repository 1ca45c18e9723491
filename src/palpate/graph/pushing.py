"""Quasi-static pushing over one step: sticking, the balance of force and torque, and the friction cone.

The conventions are those of `graph.factors`. What nobody knows of friction is unknown in the graph, `friction`
(..., 4): the logarithm of the ratio of c^2 to the model's; where the centre of friction is besides, x and y in c of the
model; and the Coulomb friction between sensor and object, the tangent of the friction cone's half angle.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.geometry import se2
from palpate.graph.factors import (
    Array,
    Complex,
    ContactModel,
    Touching,
    cross,
    moving,
    position,
    real_rows,
)

ANGLE_STEPS = 3
"""Steps before and after the one at which the angle of the pushing force is sought."""


def pushing(
    g0: Array,
    e0: Array,
    g1: Array,
    e1: Array,
    touch: Touching,
    model: ContactModel,
    friction: ArrayLike,
    side: ArrayLike,
) -> tuple[Array, Array]:
    """Error of quasi-static pushing over one step from 0 to 1 (Eqs. 7 to 10), and of the friction cone.

    Rows 1 and 2 [m]: how far the object slid along the sensor, object frame. The sensor's material point that touches
    the outline point p at step 1 was at `g0 g1^-1 p` at step 0; sticking left it in place, and so does rolling by
    a small angle (up to r angle^2 / 2). This is the paper's `V + omega x p - Vp` without linearising the rotation,
    which would let the object drift by omega^2 p / 2 a step. With r > 0 it is the material point that pushes, while p
    moves over the tip as the sensor turns.

    Row 3 [m^2]: balance of force and torque on the ellipsoidal limit surface, `p x v - c^2 omega`, with the object's
    motion v, omega over the step and p both taken at the centre of friction (Lynch 1992; Zhou 2017). Sliding does not
    break it.

    Row 4 [m]: how far v, along which the force points, is outside the friction cone on one side (+1
    counter-clockwise of the inward normal, -1 clockwise): its part along the outline less friction times its part into
    the object. It is at the edge while the contact slides.

    touch is how they touch at g1, side is (...). Returns the residual (..., 4) and its Jacobian (..., 4, 16) with
    respect to g0, e0, g1, e1 and friction.
    """
    ratio, _, _, grip = np.moveaxis(np.asarray(friction, dtype=np.float64), -1, 0)
    c_squared = model.friction_radius**2 * np.exp(ratio)
    center = _center(model, friction)
    motion = _motion(g0, e0, g1, e1, center)
    residual, jacobian = np.zeros((*g1.shape[:-1], 4)), np.zeros((*g1.shape[:-1], 4, 16))

    turn0: Complex = np.exp(1j * g0[..., 2])
    slid = position(g0) + turn0 * touch.material - touch.point
    residual[..., 0], residual[..., 1] = slid.real, slid.imag
    jacobian[..., :2, 0:3] = real_rows(moving(turn0, touch.material))
    jacobian[..., :2, 6:9] = real_rows(turn0[..., None] * touch.material_by_g - touch.point_by_g)

    arm = touch.point - center
    omega = se2.wrap(e1[..., 2] - e0[..., 2] - g1[..., 2] + g0[..., 2])
    residual[..., 2] = cross(arm, motion.way) - c_squared * omega
    jacobian[..., 2, :] = motion.seen_by(np.conj(arm), model.friction_radius)
    jacobian[..., 2, 6:9] += cross(touch.point_by_g, motion.way[..., None])
    jacobian[..., 2, [2, 11]] -= c_squared[..., None]  # omega grows with the turns of g0 and e1,
    jacobian[..., 2, [5, 8]] += c_squared[..., None]  # and shrinks with those of e0 and g1
    jacobian[..., 2, 12] = -c_squared * omega
    jacobian[..., 2, 13] += model.friction_radius * -motion.way.imag
    jacobian[..., 2, 14] += model.friction_radius * motion.way.real

    edge = np.asarray(side) - 1j * grip
    lever = edge * np.conj(-touch.normal)
    residual[..., 3] = (lever * motion.way).imag
    jacobian[..., 3, :] = motion.seen_by(lever, model.friction_radius)
    jacobian[..., 3, 6:9] += ((edge * motion.way)[..., None] * np.conj(-touch.normal_by_g)).imag
    jacobian[..., 3, 15] = (np.conj(touch.normal) * motion.way).real
    return residual, jacobian


def pushing_angle(g: Array, e: Array, touch: Touching, model: ContactModel, friction: ArrayLike) -> Array:
    """Angle of the pushing force from the outline's inward normal, counter-clockwise, at steps 1 to N - 1 (N - 1,).

    On the limit surface the force points along the motion of the centre of friction, which is taken over the steps
    nearby, for one step of it is mostly noise. g and e are (N, 3), touch is how they touch at g.
    """
    steps = np.arange(1, len(g))
    first, last = np.maximum(steps - ANGLE_STEPS, 0), np.minimum(steps + ANGLE_STEPS - 1, len(g) - 1)
    objects = se2.compose(e, se2.inverse(g))
    centers = position(objects) + np.exp(1j * objects[:, 2]) * _center(model, friction)
    inward = -touch.normal[1:] * np.exp(1j * objects[1:, 2])
    return np.angle((centers[last] - centers[first]) * np.conj(inward))


@dataclass(frozen=True)
class _Motion:
    """How far the centre of friction moved over a step, seen from the object at its end."""

    way: Complex
    """(...) [m]"""
    by_sensor0: Complex
    """Derivative by g0, and the negative of that by e0, (..., 3)."""
    by_sensor1: Complex
    """Derivative by e1, and the negative of that by g1, (..., 3)."""
    by_center: Complex
    """Derivative by the place of the centre, (...); it turns vectors and scales them."""

    def seen_by(self, lever: Complex, c: float) -> Array:
        """Derivative (..., 16) of the imaginary part of lever times way; the centre is in units of c."""
        jacobian = np.zeros((*lever.shape, 16))
        by_sensor0, by_sensor1 = (lever[..., None] * self.by_sensor0).imag, (lever[..., None] * self.by_sensor1).imag
        jacobian[..., 0:3], jacobian[..., 3:6] = by_sensor0, -by_sensor0
        jacobian[..., 6:9], jacobian[..., 9:12] = -by_sensor1, by_sensor1
        by_center = lever * self.by_center
        jacobian[..., 13], jacobian[..., 14] = c * by_center.imag, c * by_center.real
        return jacobian


def _motion(g0: Array, e0: Array, g1: Array, e1: Array, center: Complex) -> _Motion:
    """The centre was at `g1 e1^-1 e0 g0^-1 center` at step 0, seen from the object at step 1."""
    turn_g0, turn_e0, turn_e1, turn_g1 = (np.exp(1j * pose[..., 2]) for pose in (g0, e0, e1, g1))
    in_sensor0 = np.conj(turn_g0) * (center - position(g0))
    in_world = position(e0) + turn_e0 * in_sensor0
    in_sensor1 = np.conj(turn_e1) * (in_world - position(e1))
    turn_sensor0 = turn_g1 * np.conj(turn_e1) * turn_e0
    return _Motion(
        center - (position(g1) + turn_g1 * in_sensor1),
        moving(turn_sensor0, in_sensor0),
        moving(turn_g1, in_sensor1),
        1.0 + 0.0j - turn_sensor0 * np.conj(turn_g0),
    )


def _center(model: ContactModel, friction: ArrayLike) -> Complex:
    """Where the centre of friction is, object frame, complex (...) [m]."""
    _, aside_x, aside_y, _ = np.moveaxis(np.asarray(friction, dtype=np.float64), -1, 0)
    return np.asarray(complex(*model.friction_center) + model.friction_radius * (aside_x + 1j * aside_y))
