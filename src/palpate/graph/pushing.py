"""Kernels of quasi-static pushing over one step: sticking, balance and friction cone.

The object's motion is taken at the centre of friction and expressed in the object frame at step 1, in which the centre
was at `g1 e1^-1 e0 g0^-1 center` at step 0. On the limit surface the pushing force points along it. A kernel writes the
linearised rows of a factor and returns their number; see `factors.LINEAR`.
"""

import math
from typing import NamedTuple

from palpate.arrays import Array, Records
from palpate.compiled import kernel
from palpate.config import ACROSS, REACH, TURNED
from palpate.graph.measured import put_row
from palpate.graph.se2_kernels import cauchy, position, wrap
from palpate.graph.variables import FRICTION_CENTER, FRICTION_RATIO, GRIP, STEP_SIZE, column

_G0, _E0, _G1, _E1 = 0, 3, STEP_SIZE, STEP_SIZE + 3  # columns
_SHARED = 2 * STEP_SIZE
_RATIO, _CENTER, _GRIP = column(FRICTION_RATIO), column(FRICTION_CENTER), column(GRIP)


class Motion(NamedTuple):
    """Motion of the centre of friction in a step, object frame at its end."""

    way: complex
    """Motion [m]."""
    by_center: complex
    """Derivative by the centre."""
    turn0: complex
    """Rotation of sensor frame 0 into this frame."""
    arm0: complex
    """Centre in sensor frame 0 [m]."""
    turn1: complex
    """Rotation of sensor frame 1 into this frame."""
    arm1: complex
    """Former centre in sensor frame 1 [m]."""


@kernel
def _center(row: Records, settings: Records) -> complex:
    """Return the centre of friction [m], object frame."""
    shift = complex(row.shared[_CENTER - _SHARED], row.shared[_CENTER - _SHARED + 1])
    return settings.friction_center + settings.friction_radius * shift


@kernel
def _motion(before: Records, now: Records, center: complex) -> Motion:
    arm0 = before.turn_g.conjugate() * (center - position(before.g))
    in_world = position(before.e) + before.turn_e * arm0
    arm1 = now.turn_e.conjugate() * (in_world - position(now.e))
    turn0 = now.turn_g * now.turn_e.conjugate() * before.turn_e
    way = center - (position(now.g) + now.turn_g * arm1)
    return Motion(way, 1.0 - turn0 * before.turn_g.conjugate(), turn0, arm0, now.turn_g, arm1)


@kernel
def _put_by_poses(lever: complex, motion: Motion, jacobian: Array) -> None:
    """Write the derivatives by g0, e0, g1 and e1 of Im(lever times the motion)."""
    by0, by1 = lever * motion.turn0, lever * motion.turn1
    jacobian[_G0], jacobian[_G0 + 1], jacobian[_G0 + 2] = by0.imag, by0.real, (by0 * motion.arm0).real
    jacobian[_E1], jacobian[_E1 + 1], jacobian[_E1 + 2] = by1.imag, by1.real, (by1 * motion.arm1).real
    for c in range(3):
        jacobian[_E0 + c], jacobian[_G1 + c] = -jacobian[_G0 + c], -jacobian[_E1 + c]


@kernel
def force_angle(steps: Records, k: int, row: Records, settings: Records) -> float:
    """Return the angle of the pushing force at step k, from the outline's inward normal, counter-clockwise [rad].

    The motion is taken over some steps before and after, since over one step it is mostly noise. NaN at the first step.
    """
    if k == 0:
        return math.nan
    center, now = _center(row, settings), steps[k]
    last, first = steps[min(k + REACH, len(steps)) - 1], steps[max(k - REACH, 0)]
    moved = _in_world(last, center) - _in_world(first, center)
    along = moved * (-now.touch.normal * now.turn_e * now.turn_g.conjugate()).conjugate()
    return math.atan2(along.imag, along.real)


@kernel
def _in_world(now: Records, point: complex) -> complex:
    """Return a point of the object [m] in the world at a step."""
    return position(now.e) + now.turn_e * now.turn_g.conjugate() * (point - position(now.g))


@kernel
def _beyond(angle: float, limit: float, width: float) -> float:
    """Return 0 where |angle| is inside a limit and 1 where it is outside, smoothly within 1.5 widths of it.

    Farther inside it is exactly 0: in a contact that sticks for minutes, many small values would add up and shrink the
    friction cone to the force.
    """
    part = min(max(0.5 + (abs(angle) - limit) / (3.0 * width), 0.0), 1.0)
    return part * part * (3.0 - 2.0 * part)


@kernel
def sticking(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Inside the friction cone the sensor's material point stays on the object (paper Eqs. 7 to 10, two rows).

    The residual [m] is the sliding of the object along the sensor, in the object frame. The sensor's material point m
    that touches the outline point p at step 1 was at `g0 g1^-1 p` at step 0, so the residual is `g0 m - p`. Rolling by
    a small angle keeps the point in place up to r angle^2 / 2. This is the paper's `V + omega x p - Vp` without
    linearising the rotation, which would let the object drift by omega^2 p / 2 a step.

    The standard deviation depends on the angle of the pushing force: inside the cone a step slides by a small share of
    the sensor's motion, at the cone's edge by any amount. In a step with a disturbance the object slides along the
    outline by the disturbance's mean, within its deviation.
    """
    noise, moved, touch, turn0 = settings.sticking, now.moved, now.touch, before.turn_g
    is_disturbed = now.spread > 0.0
    # Rows of a disturbed step are along the outline and across it, else along x and y of the object.
    axis = (1j * touch.normal).conjugate() if is_disturbed else 1.0 + 0.0j
    slid = position(before.g) + turn0 * touch.material - touch.point
    error = slid * axis
    out.residual[0], out.residual[1] = error.real - (now.slide if is_disturbed else 0.0), error.imag
    for c in range(3):
        by_g0 = turn0 * axis if c == 0 else 1j * turn0 * axis if c == 1 else 1j * turn0 * touch.material * axis
        by_g1 = (turn0 * touch.material_by_g[c] - touch.point_by_g[c]) * axis
        if is_disturbed:
            by_g1 += slid * (1j * touch.normal_by_g[c]).conjugate()
        out.jacobian[0, _G0 + c], out.jacobian[1, _G0 + c] = by_g0.real, by_g0.imag
        out.jacobian[0, _G1 + c], out.jacobian[1, _G1 + c] = by_g1.real, by_g1.imag
    if is_disturbed:
        out.information[0] = out.weight[0] = 1.0 / now.spread**2
        out.information[1] = out.weight[1] = 1.0 / ACROSS**2
        return 2
    deviation = math.hypot(noise.still, noise.share * moved)
    slides = _beyond(now.force_angle, math.atan(math.exp(row.shared[_GRIP - _SHARED])) - noise.margin, noise.width)
    deviation *= (math.hypot(noise.still, noise.sliding_share * moved) / deviation) ** slides
    inverse_variance = 1.0 / deviation**2
    left = cauchy(inverse_variance * (error.real**2 + error.imag**2), noise.kernel)
    for r in range(2):
        out.information[r], out.weight[r] = inverse_variance, inverse_variance * left
    return 2


@kernel
def balance(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Balance of force and torque on the ellipsoidal limit surface (paper Eq. 7, torque row; Lynch 1992, Zhou 2017).

    The residual [m^2] is `p x v - c^2 omega`, with the object's motion v [m], omega [rad] in the step and the pushed
    point p, both relative to the centre of friction. It holds while sliding, too. c^2 is that of the assumed pressure
    distribution times `exp(friction_ratio)`.

    In a step with a disturbance only the object's turn is limited, by the residual `-c^2 omega` with the nominal c: a
    hand turns an object by some tenths of a radian while sliding it by a centimetre.
    """
    noise, c, jacobian = settings.balance, settings.friction_radius, out.jacobian[0]
    omega = wrap(now.e[2] - before.e[2] - now.g[2] + before.g[2])
    if now.spread > 0.0:
        deviation, torque = TURNED * c * now.spread, c * c
        error = -torque * omega
    else:
        load = noise.load * settings.span
        deviation = math.hypot(math.hypot(noise.still, noise.share * now.moved * c), load * now.moved)
        center, torque = _center(row, settings), c * c * math.exp(row.shared[_RATIO - _SHARED])
        motion, arm = _motion(before, now, center), now.touch.point - center
        lever = arm.conjugate()
        error = (lever * motion.way).imag - torque * omega
        _put_by_poses(lever, motion, jacobian)
        for k in range(3):
            jacobian[_G1 + k] += (now.touch.point_by_g[k].conjugate() * motion.way).imag
        jacobian[_RATIO] = -torque * omega
        jacobian[_CENTER] = c * ((lever * motion.by_center).imag - motion.way.imag)
        jacobian[_CENTER + 1] = c * ((lever * motion.by_center).real + motion.way.real)
    jacobian[_G0 + 2] -= torque  # omega grows with the turns of g0 and e1,
    jacobian[_E1 + 2] -= torque
    jacobian[_E0 + 2] += torque  # and shrinks with those of e0 and g1
    jacobian[_G1 + 2] += torque
    return put_row(out, error, 1.0 / deviation**2, noise.kernel)


@kernel
def friction_cone(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """While the contact slides, the pushing force stays at the cone's edge (Coulomb; Lynch 1992).

    The residual [m] is the distance of the motion v outside the cone, on its side (+1 counter-clockwise of the
    outline's inward normal, -1 clockwise): the part of v along the outline minus the coefficient of friction times that
    into the object. The term counts only while the force is beyond the edge, and not in a step with a disturbance.
    """
    if math.isinf(settings.friction_cone.share):
        return 0
    noise, c, jacobian, touch = settings.friction_cone, settings.friction_radius, out.jacobian[0], now.touch
    force, friction = now.force_angle, math.exp(row.shared[_GRIP - _SHARED])
    side = 1.0 if force > 0.0 else -1.0 if force < 0.0 else 0.0
    motion = _motion(before, now, _center(row, settings))
    edge = side - 1j * friction
    lever = edge * -touch.normal.conjugate()
    _put_by_poses(lever, motion, jacobian)
    for k in range(3):
        jacobian[_G1 + k] += (edge * motion.way * -touch.normal_by_g[k].conjugate()).imag
    jacobian[_CENTER] = c * (lever * motion.by_center).imag
    jacobian[_CENTER + 1] = c * (lever * motion.by_center).real
    jacobian[_GRIP] = friction * (touch.normal.conjugate() * motion.way).real
    outside = _beyond(force, math.atan(friction), noise.width) if now.spread == 0.0 else 0.0
    deviation = math.hypot(noise.still, noise.share * now.moved)
    return put_row(out, (lever * motion.way).imag, outside / deviation**2, noise.kernel)
