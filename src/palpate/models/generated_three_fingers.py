"""Compiled code of the model in `palpate.models.pushing`: written by `make kernels`, not by hand.

Each function writes the linearised rows of a factor to `out` and returns their number; see
`estimation.records.linear_type`.

Columns of a Jacobian:

- 0 to 2: sensor_in_object of the step before
- 3 to 5: sensor of the step before
- 6 to 8: sensor_in_object of the step now
- 9 to 11: sensor of the step now
- 12: turn_offset
- 13: corner_bias
- 14: sinking
- 15: turn_offset_1
- 16: corner_bias_1
- 17: sinking_1
- 18: turn_offset_2
- 19: corner_bias_2
- 20: sinking_2
- 21: direction_bias
- 22: direction_scale
- 23: place_bias
- 24: depth
- 25: outline_scale
- 26: friction_ratio
- 27 to 28: friction_center
- 29: grip
- 30: direction_bias_1
- 31: direction_scale_1
- 32: place_bias_1
- 33: depth_1
- 34: direction_bias_2
- 35: direction_scale_2
- 36: place_bias_2
- 37: depth_2
"""

import math

from palpate.arrays import Array, Records
from palpate.compiled import kernel
from palpate.manifolds.function_kernels import (
    beyond,
    bearing,
    clamp,
    half_cotangent,
    half_cotangent_slope,
    inverse_square,
    is_within,
    larger,
    side,
    wrap,
)
from palpate.manifolds.se2_kernels import between, cauchy, exp_onto, log, rotation
from palpate.estimation.whitening import whiten
from palpate.models.pushing.corner import nearest_corner_of


@kernel
def move_step(now: Records, change: Array) -> None:
    """Perturb the variables of a step by a tangent vector."""
    exp_onto(now.g, change[0:])
    exp_onto(now.e, change[3:])


@kernel
def copy_step(now: Records, past: Records) -> None:
    """Copy the variables of a step to a past one."""
    past.g = now.g
    past.e = now.e


@kernel
def difference(past: Records, now: Records, error: Array, change: Array) -> None:
    """Write the tangent vector from a past step to this one; `error` is room."""
    between(past.g, now.g, error)
    log(error, change[0 : 3])
    between(past.e, now.e, error)
    log(error, change[3 : 6])


@kernel
def put_rotations(now: Records) -> None:
    """Write the rotations of the poses of a step."""
    now.turn_g = rotation(now.g[2])
    now.turn_e = rotation(now.e[2])


@kernel
def sticking(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return the slide along x and y of the object, less the expected one along the outline [m]."""
    if not (before.touches[0] > 0.5 and now.touches[0] > 0.5):
        return 0
    applies = (now.spread <= 0.0)
    if not applies:
        return 0
    before_finger_cos = before.turn_finger[0].real
    before_finger_sin = before.turn_finger[0].imag
    before_finger_x = before.finger[0][0]
    before_finger_y = before.finger[0][1]
    before_g_cos = before.turn_g.real
    before_g_sin = before.turn_g.imag
    now_material_x = now.touch_of[0].material.real
    now_material_x_by_g0 = now.touch_of[0].material_by_g[0].real
    now_material_x_by_g1 = now.touch_of[0].material_by_g[1].real
    now_material_x_by_g2 = now.touch_of[0].material_by_g[2].real
    now_material_y = now.touch_of[0].material.imag
    now_material_y_by_g0 = now.touch_of[0].material_by_g[0].imag
    now_material_y_by_g1 = now.touch_of[0].material_by_g[1].imag
    now_material_y_by_g2 = now.touch_of[0].material_by_g[2].imag
    now_moved = now.moved
    now_sliding = now.sliding
    t0 = before_finger_cos*before_g_cos - before_finger_sin*before_g_sin
    t1 = before_finger_cos*before_g_sin + before_finger_sin*before_g_cos
    t2 = settings.sticking.expected_share*now_moved*now_sliding
    t3 = settings.sticking.still**2
    t4 = now_moved**2
    t5 = settings.sticking.share**2*t4 + t3
    t7 = side(now_sliding)
    t8 = t5*((settings.sticking.sliding_share**2*t4 + t3)/t5)**(now_sliding*t7)
    t9 = 0.16000000000000003*now_moved*now.pinched*now.touching*(-now_moved + 2.0*now.way) + t3
    t10 = larger(t8, t9)
    out.residual[0] = before_finger_x*before_g_cos - before_finger_y*before_g_sin + before.g[0] + now_material_x*t0 - now_material_y*t1 + now.touch_of[0].normal.imag*t2 - now.touch_of[0].point.real
    out.residual[1] = before_finger_x*before_g_sin + before_finger_y*before_g_cos + before.g[1] + now_material_x*t1 + now_material_y*t0 - now.touch_of[0].normal.real*t2 - now.touch_of[0].point.imag
    out.jacobian[0, 0] = before_g_cos
    out.jacobian[0, 1] = -before_g_sin
    out.jacobian[0, 2] = before_g_cos*(-before_finger_cos*now_material_y - before_finger_sin*now_material_x - before_finger_y) - before_g_sin*(before_finger_cos*now_material_x - before_finger_sin*now_material_y + before_finger_x)
    out.jacobian[0, 6] = now_material_x_by_g0*t0 - now_material_y_by_g0*t1 + now.touch_of[0].normal_by_g[0].imag*t2 - now.touch_of[0].point_by_g[0].real
    out.jacobian[0, 7] = now_material_x_by_g1*t0 - now_material_y_by_g1*t1 + now.touch_of[0].normal_by_g[1].imag*t2 - now.touch_of[0].point_by_g[1].real
    out.jacobian[0, 8] = now_material_x_by_g2*t0 - now_material_y_by_g2*t1 + now.touch_of[0].normal_by_g[2].imag*t2 - now.touch_of[0].point_by_g[2].real
    out.jacobian[1, 0] = before_g_sin
    out.jacobian[1, 1] = before_g_cos
    out.jacobian[1, 2] = before_g_cos*(before_finger_cos*now_material_x - before_finger_sin*now_material_y + before_finger_x) - before_g_sin*(before_finger_cos*now_material_y + before_finger_sin*now_material_x + before_finger_y)
    out.jacobian[1, 6] = now_material_x_by_g0*t1 + now_material_y_by_g0*t0 - now.touch_of[0].normal_by_g[0].real*t2 - now.touch_of[0].point_by_g[0].imag
    out.jacobian[1, 7] = now_material_x_by_g1*t1 + now_material_y_by_g1*t0 - now.touch_of[0].normal_by_g[1].real*t2 - now.touch_of[0].point_by_g[1].imag
    out.jacobian[1, 8] = now_material_x_by_g2*t1 + now_material_y_by_g2*t0 - now.touch_of[0].normal_by_g[2].real*t2 - now.touch_of[0].point_by_g[2].imag
    information0 = 1.0 / (t10)
    left = cauchy(information0 * out.residual[0]**2 + information0 * out.residual[1]**2, settings.sticking.kernel)
    out.information[0] = information0
    out.weight[0] = information0 * left
    out.information[1] = information0
    out.weight[1] = information0 * left
    return 2


@kernel
def balance(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return `p x v - c^2 omega` [m^2]."""
    applies = (now.spread <= 0.0)
    if not applies:
        return 0
    before_e_cos = before.turn_e.real
    before_e_sin = before.turn_e.imag
    before_g_cos = before.turn_g.real
    before_g_sin = before.turn_g.imag
    now_e_cos = now.turn_e.real
    now_e_sin = now.turn_e.imag
    now_g_cos = now.turn_g.real
    now_g_sin = now.turn_g.imag
    now_g_x = now.g[0]
    now_g_y = now.g[1]
    now_point_x = now.touch.point.real
    now_point_y = now.touch.point.imag
    support_center_y = settings.support.center.imag
    support_radius = settings.support.radius
    t0 = row.shared[16]*support_radius
    t1 = support_center_y + t0
    t2 = -before.g[1] + t1
    t3 = row.shared[15]*support_radius + settings.support.center.real
    t4 = -before.g[0] + t3
    t5 = before_g_cos*t2 - before_g_sin*t4
    t6 = before_g_cos*t4 + before_g_sin*t2
    t7 = before_e_cos*t5 + before_e_sin*t6 + before.e[1] - now.e[1]
    t8 = before_e_cos*t6 - before_e_sin*t5 + before.e[0] - now.e[0]
    t9 = now_e_cos*t7 - now_e_sin*t8
    t10 = now_e_cos*t8 + now_e_sin*t7
    t11 = support_radius**2
    t12 = now.moved**2
    t13 = math.exp(row.shared[14])
    t14 = -before.e[2] + before.g[2] + now.e[2] - now.g[2]
    t15 = wrap(t14)
    d0 = -t11*t13
    d1 = -t11*t15
    d2 = now_g_cos*(now_point_y - t1) - now_g_sin*(now_point_x - t3)
    d3 = -now_g_cos*(now_point_x - t3) - now_g_sin*(now_point_y - t1)
    d4 = d2*now_e_cos - d3*now_e_sin
    d5 = d2*now_e_sin + d3*now_e_cos
    d6 = before_e_cos*d4 + before_e_sin*d5
    d7 = before_e_cos*d5 - before_e_sin*d4
    d8 = before_g_cos*d6 - before_g_sin*d7
    d9 = d8 + now_g_cos*t9 + now_g_sin*t10 + now_g_y - now_point_y - support_center_y - t0 + t1
    d10 = before_g_cos*d7 + before_g_sin*d6
    d11 = d10 - now_g_cos*t10 + now_g_sin*t9 - now_g_x + t3
    d12 = d11 + now_point_x - t3
    d13 = now_point_y - t1
    d14 = -now_point_x + t3
    d15 = -now_g_cos*t9 - now_g_sin*t10 - now_g_y + support_center_y + t0
    d16 = now_g_cos*t10 - now_g_sin*t9 + now_g_x - t3
    out.residual[0] = -t11*t13*t15 + (now_point_x - t3)*(-now_g_cos*t9 - now_g_sin*t10 - now_g_y + support_center_y + t0) - (now_point_y - t1)*(-now_g_cos*t10 + now_g_sin*t9 - now_g_x + t3)
    out.jacobian[0, 0] = -before_g_cos*d8 - before_g_sin*d10
    out.jacobian[0, 1] = -before_g_cos*d10 + before_g_sin*d8
    out.jacobian[0, 2] = before_g_cos*(d6*t2 - d7*t4) - before_g_sin*(d6*t4 + d7*t2) + d0
    out.jacobian[0, 3] = before_e_cos*d4 + before_e_sin*d5
    out.jacobian[0, 4] = before_e_cos*d5 - before_e_sin*d4
    out.jacobian[0, 5] = before_e_cos*(-d4*t5 + d5*t6) - before_e_sin*(d4*t6 + d5*t5) - d0
    out.jacobian[0, 6] = d13*now_g_cos + d14*now_g_sin + d15*now.touch.point_by_g[0].real + d16*now.touch.point_by_g[0].imag
    out.jacobian[0, 7] = -d13*now_g_sin + d14*now_g_cos + d15*now.touch.point_by_g[1].real + d16*now.touch.point_by_g[1].imag
    out.jacobian[0, 8] = -d0 + d15*now.touch.point_by_g[2].real + d16*now.touch.point_by_g[2].imag + now_g_cos*(-t10*(now_point_x - t3) - t9*(now_point_y - t1)) - now_g_sin*(t10*(now_point_y - t1) - t9*(now_point_x - t3))
    out.jacobian[0, 9] = -d4*now_e_cos - d5*now_e_sin
    out.jacobian[0, 10] = d4*now_e_sin - d5*now_e_cos
    out.jacobian[0, 11] = d0 + now_e_cos*(d2*t7 - d3*t8) - now_e_sin*(d2*t8 + d3*t7)
    out.jacobian[0, 26] = d1*t13
    out.jacobian[0, 27] = d9*support_radius
    out.jacobian[0, 28] = d12*support_radius
    information0 = 1.0 / (settings.balance.share**2*t11*t12 + settings.balance.still**2 + 16.0*now.apart**2*t12)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.balance.kernel)
    return 1


@kernel
def friction_cone(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return the distance of the motion v outside the cone [m], on the side on which the contact slides."""
    noise_share = settings.friction_cone.share
    applies = (now.spread <= 0.0) and (noise_share < 1e+300)
    if not applies:
        return 0
    before_e_cos = before.turn_e.real
    before_e_sin = before.turn_e.imag
    before_g_cos = before.turn_g.real
    before_g_sin = before.turn_g.imag
    friction_center_y = row.shared[16]
    now_e_cos = now.turn_e.real
    now_e_sin = now.turn_e.imag
    now_force_angle = now.force_angle
    now_g_cos = now.turn_g.real
    now_g_sin = now.turn_g.imag
    now_normal_x = now.touch.normal.real
    now_normal_y = now.touch.normal.imag
    support_center_y = settings.support.center.imag
    support_radius = settings.support.radius
    t0 = -before.g[1] + friction_center_y*support_radius + support_center_y
    t1 = row.shared[15]*support_radius + settings.support.center.real
    t2 = -before.g[0] + t1
    t3 = before_g_cos*t0 - before_g_sin*t2
    t4 = before_g_cos*t2 + before_g_sin*t0
    t5 = before_e_cos*t3 + before_e_sin*t4 + before.e[1] - now.e[1]
    t6 = before_e_cos*t4 - before_e_sin*t3 + before.e[0] - now.e[0]
    t7 = now_e_cos*t5 - now_e_sin*t6
    t8 = now_e_cos*t6 + now_e_sin*t5
    t9 = -now_g_cos*t8 + now_g_sin*t7 - now.g[0] + t1
    t10 = friction_center_y*support_radius - now_g_cos*t7 - now_g_sin*t8 - now.g[1] + support_center_y
    t12 = math.exp(row.shared[17])
    t13 = side(now_force_angle)
    t14 = math.atan(t12)
    t15 = beyond(now_force_angle, t14, settings.friction_cone.width)
    d0 = now_normal_x*t9 + now_normal_y*t10
    d1 = -now_normal_x*t13 + now_normal_y*t12
    d2 = now_normal_x*t12 + now_normal_y*t13
    d3 = -d1*now_g_sin - d2*now_g_cos
    d4 = -d1*now_g_cos + d2*now_g_sin
    d5 = d3*now_e_cos - d4*now_e_sin
    d6 = d3*now_e_sin + d4*now_e_cos
    d7 = before_e_cos*d5 + before_e_sin*d6
    d8 = before_e_cos*d6 - before_e_sin*d5
    d9 = before_g_cos*d7 - before_g_sin*d8
    d10 = d2 + d9
    d11 = before_g_cos*d8 + before_g_sin*d7
    d12 = -t10*t13 + t12*t9
    d13 = t10*t12 + t13*t9
    out.residual[0] = -t12*(-now_normal_x*t9 - now_normal_y*t10) + t13*(-now_normal_x*t10 + now_normal_y*t9)
    out.jacobian[0, 0] = -before_g_cos*d9 - before_g_sin*d11
    out.jacobian[0, 1] = -before_g_cos*d11 + before_g_sin*d9
    out.jacobian[0, 2] = before_g_cos*(d7*t0 - d8*t2) - before_g_sin*(d7*t2 + d8*t0)
    out.jacobian[0, 3] = before_e_cos*d5 + before_e_sin*d6
    out.jacobian[0, 4] = before_e_cos*d6 - before_e_sin*d5
    out.jacobian[0, 5] = before_e_cos*(-d5*t3 + d6*t4) - before_e_sin*(d5*t4 + d6*t3)
    out.jacobian[0, 6] = -d1*now_g_sin + d12*now.touch.normal_by_g[0].real + d13*now.touch.normal_by_g[0].imag - d2*now_g_cos
    out.jacobian[0, 7] = -d1*now_g_cos + d12*now.touch.normal_by_g[1].real + d13*now.touch.normal_by_g[1].imag + d2*now_g_sin
    out.jacobian[0, 8] = d12*now.touch.normal_by_g[2].real + d13*now.touch.normal_by_g[2].imag + now_g_cos*(-d1*t8 + d2*t7) - now_g_sin*(-d1*t7 - d2*t8)
    out.jacobian[0, 9] = -d5*now_e_cos - d6*now_e_sin
    out.jacobian[0, 10] = d5*now_e_sin - d6*now_e_cos
    out.jacobian[0, 11] = now_e_cos*(d3*t5 - d4*t6) - now_e_sin*(d3*t6 + d4*t5)
    out.jacobian[0, 27] = d10*support_radius
    out.jacobian[0, 28] = d1*support_radius + d11*support_radius
    out.jacobian[0, 29] = d0*t12
    information0 = t15 / (noise_share**2*now.moved**2 + settings.friction_cone.still**2)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.friction_cone.kernel)
    return 1


@kernel
def disturbed_slide(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return the slide along the outline, counter-clockwise, less the guessed one, and that across it [m]."""
    if not (before.touches[0] > 0.5 and now.touches[0] > 0.5):
        return 0
    now_spread = now.spread
    applies = (now_spread > 0.0)
    if not applies:
        return 0
    before_finger_cos = before.turn_finger[0].real
    before_finger_sin = before.turn_finger[0].imag
    before_finger_x = before.finger[0][0]
    before_finger_y = before.finger[0][1]
    before_g_cos = before.turn_g.real
    before_g_sin = before.turn_g.imag
    now_material_x = now.touch_of[0].material.real
    now_material_x_by_g0 = now.touch_of[0].material_by_g[0].real
    now_material_x_by_g1 = now.touch_of[0].material_by_g[1].real
    now_material_x_by_g2 = now.touch_of[0].material_by_g[2].real
    now_material_y = now.touch_of[0].material.imag
    now_material_y_by_g0 = now.touch_of[0].material_by_g[0].imag
    now_material_y_by_g1 = now.touch_of[0].material_by_g[1].imag
    now_material_y_by_g2 = now.touch_of[0].material_by_g[2].imag
    now_normal_x = now.touch_of[0].normal.real
    now_normal_x_by_g0 = now.touch_of[0].normal_by_g[0].real
    now_normal_x_by_g1 = now.touch_of[0].normal_by_g[1].real
    now_normal_x_by_g2 = now.touch_of[0].normal_by_g[2].real
    now_normal_y = now.touch_of[0].normal.imag
    now_normal_y_by_g0 = now.touch_of[0].normal_by_g[0].imag
    now_normal_y_by_g1 = now.touch_of[0].normal_by_g[1].imag
    now_normal_y_by_g2 = now.touch_of[0].normal_by_g[2].imag
    now_point_x_by_g0 = now.touch_of[0].point_by_g[0].real
    now_point_x_by_g1 = now.touch_of[0].point_by_g[1].real
    now_point_x_by_g2 = now.touch_of[0].point_by_g[2].real
    now_point_y_by_g0 = now.touch_of[0].point_by_g[0].imag
    now_point_y_by_g1 = now.touch_of[0].point_by_g[1].imag
    now_point_y_by_g2 = now.touch_of[0].point_by_g[2].imag
    t0 = before_finger_cos*before_g_cos - before_finger_sin*before_g_sin
    t1 = before_finger_cos*before_g_sin + before_finger_sin*before_g_cos
    t2 = before_finger_x*before_g_cos - before_finger_y*before_g_sin + before.g[0] + now_material_x*t0 - now_material_y*t1 - now.touch_of[0].point.real
    t3 = before_finger_x*before_g_sin + before_finger_y*before_g_cos + before.g[1] + now_material_x*t1 + now_material_y*t0 - now.touch_of[0].point.imag
    d0 = now_material_x*now_normal_x + now_material_y*now_normal_y
    d1 = -now_material_x*now_normal_y + now_material_y*now_normal_x
    d2 = now_normal_x*t1 - now_normal_y*t0
    d3 = now_normal_x*t0 + now_normal_y*t1
    d4 = -now_material_x*now_normal_y + now_material_y*now_normal_x
    d5 = -now_material_x*now_normal_x - now_material_y*now_normal_y
    d6 = -now_normal_x*t0 - now_normal_y*t1
    d7 = now_normal_x*t1 - now_normal_y*t0
    out.residual[0] = now_normal_x*t3 - now_normal_y*t2 - now.slide
    out.residual[1] = -now_normal_x*t2 - now_normal_y*t3
    out.jacobian[0, 0] = -before_g_cos*now_normal_y + before_g_sin*now_normal_x
    out.jacobian[0, 1] = before_g_cos*now_normal_x + before_g_sin*now_normal_y
    out.jacobian[0, 2] = before_g_cos*(before_finger_cos*d0 - before_finger_sin*d1 + before_finger_x*now_normal_x + before_finger_y*now_normal_y) - before_g_sin*(before_finger_cos*d1 + before_finger_sin*d0 - before_finger_x*now_normal_y + before_finger_y*now_normal_x)
    out.jacobian[0, 6] = d2*now_material_x_by_g0 + d3*now_material_y_by_g0 - now_normal_x*now_point_y_by_g0 + now_normal_x_by_g0*t3 + now_normal_y*now_point_x_by_g0 - now_normal_y_by_g0*t2
    out.jacobian[0, 7] = d2*now_material_x_by_g1 + d3*now_material_y_by_g1 - now_normal_x*now_point_y_by_g1 + now_normal_x_by_g1*t3 + now_normal_y*now_point_x_by_g1 - now_normal_y_by_g1*t2
    out.jacobian[0, 8] = d2*now_material_x_by_g2 + d3*now_material_y_by_g2 - now_normal_x*now_point_y_by_g2 + now_normal_x_by_g2*t3 + now_normal_y*now_point_x_by_g2 - now_normal_y_by_g2*t2
    out.jacobian[1, 0] = -before_g_cos*now_normal_x - before_g_sin*now_normal_y
    out.jacobian[1, 1] = -before_g_cos*now_normal_y + before_g_sin*now_normal_x
    out.jacobian[1, 2] = before_g_cos*(before_finger_cos*d4 - before_finger_sin*d5 - before_finger_x*now_normal_y + before_finger_y*now_normal_x) - before_g_sin*(before_finger_cos*d5 + before_finger_sin*d4 - before_finger_x*now_normal_x - before_finger_y*now_normal_y)
    out.jacobian[1, 6] = d6*now_material_x_by_g0 + d7*now_material_y_by_g0 + now_normal_x*now_point_x_by_g0 - now_normal_x_by_g0*t2 + now_normal_y*now_point_y_by_g0 - now_normal_y_by_g0*t3
    out.jacobian[1, 7] = d6*now_material_x_by_g1 + d7*now_material_y_by_g1 + now_normal_x*now_point_x_by_g1 - now_normal_x_by_g1*t2 + now_normal_y*now_point_y_by_g1 - now_normal_y_by_g1*t3
    out.jacobian[1, 8] = d6*now_material_x_by_g2 + d7*now_material_y_by_g2 + now_normal_x*now_point_x_by_g2 - now_normal_x_by_g2*t2 + now_normal_y*now_point_y_by_g2 - now_normal_y_by_g2*t3
    information0 = 1.0 / (now_spread**2)
    information1 = 1.0 / (4e-06)
    out.information[0] = information0
    out.weight[0] = information0
    out.information[1] = information1
    out.weight[1] = information1
    return 2


@kernel
def disturbed_turn(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return `-c^2 omega` [m^2], with the nominal c."""
    now_spread = now.spread
    applies = (now_spread > 0.0)
    if not applies:
        return 0
    t0 = settings.support.radius**2
    t1 = -before.e[2] + before.g[2] + now.e[2] - now.g[2]
    t2 = wrap(t1)
    out.residual[0] = -t0*t2
    out.jacobian[0, 2] = -t0
    out.jacobian[0, 5] = t0
    out.jacobian[0, 8] = t0
    out.jacobian[0, 11] = -t0
    information0 = 1.0 / (9.0*now_spread**2*t0)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.balance.kernel)
    return 1


@kernel
def sticking_1(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return the slide along x and y of the object, less the expected one along the outline [m]."""
    if not (before.touches[1] > 0.5 and now.touches[1] > 0.5):
        return 0
    applies = (now.spread <= 0.0)
    if not applies:
        return 0
    before_finger_cos = before.turn_finger[1].real
    before_finger_sin = before.turn_finger[1].imag
    before_finger_x = before.finger[1][0]
    before_finger_y = before.finger[1][1]
    before_g_cos = before.turn_g.real
    before_g_sin = before.turn_g.imag
    now_material_x = now.touch_of[1].material.real
    now_material_x_by_g0 = now.touch_of[1].material_by_g[0].real
    now_material_x_by_g1 = now.touch_of[1].material_by_g[1].real
    now_material_x_by_g2 = now.touch_of[1].material_by_g[2].real
    now_material_y = now.touch_of[1].material.imag
    now_material_y_by_g0 = now.touch_of[1].material_by_g[0].imag
    now_material_y_by_g1 = now.touch_of[1].material_by_g[1].imag
    now_material_y_by_g2 = now.touch_of[1].material_by_g[2].imag
    now_moved = now.moved
    now_sliding = now.sliding
    t0 = before_finger_cos*before_g_cos - before_finger_sin*before_g_sin
    t1 = before_finger_cos*before_g_sin + before_finger_sin*before_g_cos
    t2 = settings.sticking.expected_share*now_moved*now_sliding
    t3 = settings.sticking.still**2
    t4 = now_moved**2
    t5 = settings.sticking.share**2*t4 + t3
    t7 = side(now_sliding)
    t8 = t5*((settings.sticking.sliding_share**2*t4 + t3)/t5)**(now_sliding*t7)
    t9 = 0.16000000000000003*now_moved*now.pinched*now.touching*(-now_moved + 2.0*now.way) + t3
    t10 = larger(t8, t9)
    out.residual[0] = before_finger_x*before_g_cos - before_finger_y*before_g_sin + before.g[0] + now_material_x*t0 - now_material_y*t1 + now.touch_of[1].normal.imag*t2 - now.touch_of[1].point.real
    out.residual[1] = before_finger_x*before_g_sin + before_finger_y*before_g_cos + before.g[1] + now_material_x*t1 + now_material_y*t0 - now.touch_of[1].normal.real*t2 - now.touch_of[1].point.imag
    out.jacobian[0, 0] = before_g_cos
    out.jacobian[0, 1] = -before_g_sin
    out.jacobian[0, 2] = before_g_cos*(-before_finger_cos*now_material_y - before_finger_sin*now_material_x - before_finger_y) - before_g_sin*(before_finger_cos*now_material_x - before_finger_sin*now_material_y + before_finger_x)
    out.jacobian[0, 6] = now_material_x_by_g0*t0 - now_material_y_by_g0*t1 + now.touch_of[1].normal_by_g[0].imag*t2 - now.touch_of[1].point_by_g[0].real
    out.jacobian[0, 7] = now_material_x_by_g1*t0 - now_material_y_by_g1*t1 + now.touch_of[1].normal_by_g[1].imag*t2 - now.touch_of[1].point_by_g[1].real
    out.jacobian[0, 8] = now_material_x_by_g2*t0 - now_material_y_by_g2*t1 + now.touch_of[1].normal_by_g[2].imag*t2 - now.touch_of[1].point_by_g[2].real
    out.jacobian[1, 0] = before_g_sin
    out.jacobian[1, 1] = before_g_cos
    out.jacobian[1, 2] = before_g_cos*(before_finger_cos*now_material_x - before_finger_sin*now_material_y + before_finger_x) - before_g_sin*(before_finger_cos*now_material_y + before_finger_sin*now_material_x + before_finger_y)
    out.jacobian[1, 6] = now_material_x_by_g0*t1 + now_material_y_by_g0*t0 - now.touch_of[1].normal_by_g[0].real*t2 - now.touch_of[1].point_by_g[0].imag
    out.jacobian[1, 7] = now_material_x_by_g1*t1 + now_material_y_by_g1*t0 - now.touch_of[1].normal_by_g[1].real*t2 - now.touch_of[1].point_by_g[1].imag
    out.jacobian[1, 8] = now_material_x_by_g2*t1 + now_material_y_by_g2*t0 - now.touch_of[1].normal_by_g[2].real*t2 - now.touch_of[1].point_by_g[2].imag
    information0 = 1.0 / (t10)
    left = cauchy(information0 * out.residual[0]**2 + information0 * out.residual[1]**2, settings.sticking.kernel)
    out.information[0] = information0
    out.weight[0] = information0 * left
    out.information[1] = information0
    out.weight[1] = information0 * left
    return 2


@kernel
def disturbed_slide_1(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return the slide along the outline, counter-clockwise, less the guessed one, and that across it [m]."""
    if not (before.touches[1] > 0.5 and now.touches[1] > 0.5):
        return 0
    now_spread = now.spread
    applies = (now_spread > 0.0)
    if not applies:
        return 0
    before_finger_cos = before.turn_finger[1].real
    before_finger_sin = before.turn_finger[1].imag
    before_finger_x = before.finger[1][0]
    before_finger_y = before.finger[1][1]
    before_g_cos = before.turn_g.real
    before_g_sin = before.turn_g.imag
    now_material_x = now.touch_of[1].material.real
    now_material_x_by_g0 = now.touch_of[1].material_by_g[0].real
    now_material_x_by_g1 = now.touch_of[1].material_by_g[1].real
    now_material_x_by_g2 = now.touch_of[1].material_by_g[2].real
    now_material_y = now.touch_of[1].material.imag
    now_material_y_by_g0 = now.touch_of[1].material_by_g[0].imag
    now_material_y_by_g1 = now.touch_of[1].material_by_g[1].imag
    now_material_y_by_g2 = now.touch_of[1].material_by_g[2].imag
    now_normal_x = now.touch_of[1].normal.real
    now_normal_x_by_g0 = now.touch_of[1].normal_by_g[0].real
    now_normal_x_by_g1 = now.touch_of[1].normal_by_g[1].real
    now_normal_x_by_g2 = now.touch_of[1].normal_by_g[2].real
    now_normal_y = now.touch_of[1].normal.imag
    now_normal_y_by_g0 = now.touch_of[1].normal_by_g[0].imag
    now_normal_y_by_g1 = now.touch_of[1].normal_by_g[1].imag
    now_normal_y_by_g2 = now.touch_of[1].normal_by_g[2].imag
    now_point_x_by_g0 = now.touch_of[1].point_by_g[0].real
    now_point_x_by_g1 = now.touch_of[1].point_by_g[1].real
    now_point_x_by_g2 = now.touch_of[1].point_by_g[2].real
    now_point_y_by_g0 = now.touch_of[1].point_by_g[0].imag
    now_point_y_by_g1 = now.touch_of[1].point_by_g[1].imag
    now_point_y_by_g2 = now.touch_of[1].point_by_g[2].imag
    t0 = before_finger_cos*before_g_cos - before_finger_sin*before_g_sin
    t1 = before_finger_cos*before_g_sin + before_finger_sin*before_g_cos
    t2 = before_finger_x*before_g_cos - before_finger_y*before_g_sin + before.g[0] + now_material_x*t0 - now_material_y*t1 - now.touch_of[1].point.real
    t3 = before_finger_x*before_g_sin + before_finger_y*before_g_cos + before.g[1] + now_material_x*t1 + now_material_y*t0 - now.touch_of[1].point.imag
    d0 = now_material_x*now_normal_x + now_material_y*now_normal_y
    d1 = -now_material_x*now_normal_y + now_material_y*now_normal_x
    d2 = now_normal_x*t1 - now_normal_y*t0
    d3 = now_normal_x*t0 + now_normal_y*t1
    d4 = -now_material_x*now_normal_y + now_material_y*now_normal_x
    d5 = -now_material_x*now_normal_x - now_material_y*now_normal_y
    d6 = -now_normal_x*t0 - now_normal_y*t1
    d7 = now_normal_x*t1 - now_normal_y*t0
    out.residual[0] = now_normal_x*t3 - now_normal_y*t2 - now.slide
    out.residual[1] = -now_normal_x*t2 - now_normal_y*t3
    out.jacobian[0, 0] = -before_g_cos*now_normal_y + before_g_sin*now_normal_x
    out.jacobian[0, 1] = before_g_cos*now_normal_x + before_g_sin*now_normal_y
    out.jacobian[0, 2] = before_g_cos*(before_finger_cos*d0 - before_finger_sin*d1 + before_finger_x*now_normal_x + before_finger_y*now_normal_y) - before_g_sin*(before_finger_cos*d1 + before_finger_sin*d0 - before_finger_x*now_normal_y + before_finger_y*now_normal_x)
    out.jacobian[0, 6] = d2*now_material_x_by_g0 + d3*now_material_y_by_g0 - now_normal_x*now_point_y_by_g0 + now_normal_x_by_g0*t3 + now_normal_y*now_point_x_by_g0 - now_normal_y_by_g0*t2
    out.jacobian[0, 7] = d2*now_material_x_by_g1 + d3*now_material_y_by_g1 - now_normal_x*now_point_y_by_g1 + now_normal_x_by_g1*t3 + now_normal_y*now_point_x_by_g1 - now_normal_y_by_g1*t2
    out.jacobian[0, 8] = d2*now_material_x_by_g2 + d3*now_material_y_by_g2 - now_normal_x*now_point_y_by_g2 + now_normal_x_by_g2*t3 + now_normal_y*now_point_x_by_g2 - now_normal_y_by_g2*t2
    out.jacobian[1, 0] = -before_g_cos*now_normal_x - before_g_sin*now_normal_y
    out.jacobian[1, 1] = -before_g_cos*now_normal_y + before_g_sin*now_normal_x
    out.jacobian[1, 2] = before_g_cos*(before_finger_cos*d4 - before_finger_sin*d5 - before_finger_x*now_normal_y + before_finger_y*now_normal_x) - before_g_sin*(before_finger_cos*d5 + before_finger_sin*d4 - before_finger_x*now_normal_x - before_finger_y*now_normal_y)
    out.jacobian[1, 6] = d6*now_material_x_by_g0 + d7*now_material_y_by_g0 + now_normal_x*now_point_x_by_g0 - now_normal_x_by_g0*t2 + now_normal_y*now_point_y_by_g0 - now_normal_y_by_g0*t3
    out.jacobian[1, 7] = d6*now_material_x_by_g1 + d7*now_material_y_by_g1 + now_normal_x*now_point_x_by_g1 - now_normal_x_by_g1*t2 + now_normal_y*now_point_y_by_g1 - now_normal_y_by_g1*t3
    out.jacobian[1, 8] = d6*now_material_x_by_g2 + d7*now_material_y_by_g2 + now_normal_x*now_point_x_by_g2 - now_normal_x_by_g2*t2 + now_normal_y*now_point_y_by_g2 - now_normal_y_by_g2*t3
    information0 = 1.0 / (now_spread**2)
    information1 = 1.0 / (4e-06)
    out.information[0] = information0
    out.weight[0] = information0
    out.information[1] = information1
    out.weight[1] = information1
    return 2


@kernel
def sticking_2(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return the slide along x and y of the object, less the expected one along the outline [m]."""
    if not (before.touches[2] > 0.5 and now.touches[2] > 0.5):
        return 0
    applies = (now.spread <= 0.0)
    if not applies:
        return 0
    before_finger_cos = before.turn_finger[2].real
    before_finger_sin = before.turn_finger[2].imag
    before_finger_x = before.finger[2][0]
    before_finger_y = before.finger[2][1]
    before_g_cos = before.turn_g.real
    before_g_sin = before.turn_g.imag
    now_material_x = now.touch_of[2].material.real
    now_material_x_by_g0 = now.touch_of[2].material_by_g[0].real
    now_material_x_by_g1 = now.touch_of[2].material_by_g[1].real
    now_material_x_by_g2 = now.touch_of[2].material_by_g[2].real
    now_material_y = now.touch_of[2].material.imag
    now_material_y_by_g0 = now.touch_of[2].material_by_g[0].imag
    now_material_y_by_g1 = now.touch_of[2].material_by_g[1].imag
    now_material_y_by_g2 = now.touch_of[2].material_by_g[2].imag
    now_moved = now.moved
    now_sliding = now.sliding
    t0 = before_finger_cos*before_g_cos - before_finger_sin*before_g_sin
    t1 = before_finger_cos*before_g_sin + before_finger_sin*before_g_cos
    t2 = settings.sticking.expected_share*now_moved*now_sliding
    t3 = settings.sticking.still**2
    t4 = now_moved**2
    t5 = settings.sticking.share**2*t4 + t3
    t7 = side(now_sliding)
    t8 = t5*((settings.sticking.sliding_share**2*t4 + t3)/t5)**(now_sliding*t7)
    t9 = 0.16000000000000003*now_moved*now.pinched*now.touching*(-now_moved + 2.0*now.way) + t3
    t10 = larger(t8, t9)
    out.residual[0] = before_finger_x*before_g_cos - before_finger_y*before_g_sin + before.g[0] + now_material_x*t0 - now_material_y*t1 + now.touch_of[2].normal.imag*t2 - now.touch_of[2].point.real
    out.residual[1] = before_finger_x*before_g_sin + before_finger_y*before_g_cos + before.g[1] + now_material_x*t1 + now_material_y*t0 - now.touch_of[2].normal.real*t2 - now.touch_of[2].point.imag
    out.jacobian[0, 0] = before_g_cos
    out.jacobian[0, 1] = -before_g_sin
    out.jacobian[0, 2] = before_g_cos*(-before_finger_cos*now_material_y - before_finger_sin*now_material_x - before_finger_y) - before_g_sin*(before_finger_cos*now_material_x - before_finger_sin*now_material_y + before_finger_x)
    out.jacobian[0, 6] = now_material_x_by_g0*t0 - now_material_y_by_g0*t1 + now.touch_of[2].normal_by_g[0].imag*t2 - now.touch_of[2].point_by_g[0].real
    out.jacobian[0, 7] = now_material_x_by_g1*t0 - now_material_y_by_g1*t1 + now.touch_of[2].normal_by_g[1].imag*t2 - now.touch_of[2].point_by_g[1].real
    out.jacobian[0, 8] = now_material_x_by_g2*t0 - now_material_y_by_g2*t1 + now.touch_of[2].normal_by_g[2].imag*t2 - now.touch_of[2].point_by_g[2].real
    out.jacobian[1, 0] = before_g_sin
    out.jacobian[1, 1] = before_g_cos
    out.jacobian[1, 2] = before_g_cos*(before_finger_cos*now_material_x - before_finger_sin*now_material_y + before_finger_x) - before_g_sin*(before_finger_cos*now_material_y + before_finger_sin*now_material_x + before_finger_y)
    out.jacobian[1, 6] = now_material_x_by_g0*t1 + now_material_y_by_g0*t0 - now.touch_of[2].normal_by_g[0].real*t2 - now.touch_of[2].point_by_g[0].imag
    out.jacobian[1, 7] = now_material_x_by_g1*t1 + now_material_y_by_g1*t0 - now.touch_of[2].normal_by_g[1].real*t2 - now.touch_of[2].point_by_g[1].imag
    out.jacobian[1, 8] = now_material_x_by_g2*t1 + now_material_y_by_g2*t0 - now.touch_of[2].normal_by_g[2].real*t2 - now.touch_of[2].point_by_g[2].imag
    information0 = 1.0 / (t10)
    left = cauchy(information0 * out.residual[0]**2 + information0 * out.residual[1]**2, settings.sticking.kernel)
    out.information[0] = information0
    out.weight[0] = information0 * left
    out.information[1] = information0
    out.weight[1] = information0 * left
    return 2


@kernel
def disturbed_slide_2(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return the slide along the outline, counter-clockwise, less the guessed one, and that across it [m]."""
    if not (before.touches[2] > 0.5 and now.touches[2] > 0.5):
        return 0
    now_spread = now.spread
    applies = (now_spread > 0.0)
    if not applies:
        return 0
    before_finger_cos = before.turn_finger[2].real
    before_finger_sin = before.turn_finger[2].imag
    before_finger_x = before.finger[2][0]
    before_finger_y = before.finger[2][1]
    before_g_cos = before.turn_g.real
    before_g_sin = before.turn_g.imag
    now_material_x = now.touch_of[2].material.real
    now_material_x_by_g0 = now.touch_of[2].material_by_g[0].real
    now_material_x_by_g1 = now.touch_of[2].material_by_g[1].real
    now_material_x_by_g2 = now.touch_of[2].material_by_g[2].real
    now_material_y = now.touch_of[2].material.imag
    now_material_y_by_g0 = now.touch_of[2].material_by_g[0].imag
    now_material_y_by_g1 = now.touch_of[2].material_by_g[1].imag
    now_material_y_by_g2 = now.touch_of[2].material_by_g[2].imag
    now_normal_x = now.touch_of[2].normal.real
    now_normal_x_by_g0 = now.touch_of[2].normal_by_g[0].real
    now_normal_x_by_g1 = now.touch_of[2].normal_by_g[1].real
    now_normal_x_by_g2 = now.touch_of[2].normal_by_g[2].real
    now_normal_y = now.touch_of[2].normal.imag
    now_normal_y_by_g0 = now.touch_of[2].normal_by_g[0].imag
    now_normal_y_by_g1 = now.touch_of[2].normal_by_g[1].imag
    now_normal_y_by_g2 = now.touch_of[2].normal_by_g[2].imag
    now_point_x_by_g0 = now.touch_of[2].point_by_g[0].real
    now_point_x_by_g1 = now.touch_of[2].point_by_g[1].real
    now_point_x_by_g2 = now.touch_of[2].point_by_g[2].real
    now_point_y_by_g0 = now.touch_of[2].point_by_g[0].imag
    now_point_y_by_g1 = now.touch_of[2].point_by_g[1].imag
    now_point_y_by_g2 = now.touch_of[2].point_by_g[2].imag
    t0 = before_finger_cos*before_g_cos - before_finger_sin*before_g_sin
    t1 = before_finger_cos*before_g_sin + before_finger_sin*before_g_cos
    t2 = before_finger_x*before_g_cos - before_finger_y*before_g_sin + before.g[0] + now_material_x*t0 - now_material_y*t1 - now.touch_of[2].point.real
    t3 = before_finger_x*before_g_sin + before_finger_y*before_g_cos + before.g[1] + now_material_x*t1 + now_material_y*t0 - now.touch_of[2].point.imag
    d0 = now_material_x*now_normal_x + now_material_y*now_normal_y
    d1 = -now_material_x*now_normal_y + now_material_y*now_normal_x
    d2 = now_normal_x*t1 - now_normal_y*t0
    d3 = now_normal_x*t0 + now_normal_y*t1
    d4 = -now_material_x*now_normal_y + now_material_y*now_normal_x
    d5 = -now_material_x*now_normal_x - now_material_y*now_normal_y
    d6 = -now_normal_x*t0 - now_normal_y*t1
    d7 = now_normal_x*t1 - now_normal_y*t0
    out.residual[0] = now_normal_x*t3 - now_normal_y*t2 - now.slide
    out.residual[1] = -now_normal_x*t2 - now_normal_y*t3
    out.jacobian[0, 0] = -before_g_cos*now_normal_y + before_g_sin*now_normal_x
    out.jacobian[0, 1] = before_g_cos*now_normal_x + before_g_sin*now_normal_y
    out.jacobian[0, 2] = before_g_cos*(before_finger_cos*d0 - before_finger_sin*d1 + before_finger_x*now_normal_x + before_finger_y*now_normal_y) - before_g_sin*(before_finger_cos*d1 + before_finger_sin*d0 - before_finger_x*now_normal_y + before_finger_y*now_normal_x)
    out.jacobian[0, 6] = d2*now_material_x_by_g0 + d3*now_material_y_by_g0 - now_normal_x*now_point_y_by_g0 + now_normal_x_by_g0*t3 + now_normal_y*now_point_x_by_g0 - now_normal_y_by_g0*t2
    out.jacobian[0, 7] = d2*now_material_x_by_g1 + d3*now_material_y_by_g1 - now_normal_x*now_point_y_by_g1 + now_normal_x_by_g1*t3 + now_normal_y*now_point_x_by_g1 - now_normal_y_by_g1*t2
    out.jacobian[0, 8] = d2*now_material_x_by_g2 + d3*now_material_y_by_g2 - now_normal_x*now_point_y_by_g2 + now_normal_x_by_g2*t3 + now_normal_y*now_point_x_by_g2 - now_normal_y_by_g2*t2
    out.jacobian[1, 0] = -before_g_cos*now_normal_x - before_g_sin*now_normal_y
    out.jacobian[1, 1] = -before_g_cos*now_normal_y + before_g_sin*now_normal_x
    out.jacobian[1, 2] = before_g_cos*(before_finger_cos*d4 - before_finger_sin*d5 - before_finger_x*now_normal_y + before_finger_y*now_normal_x) - before_g_sin*(before_finger_cos*d5 + before_finger_sin*d4 - before_finger_x*now_normal_x - before_finger_y*now_normal_y)
    out.jacobian[1, 6] = d6*now_material_x_by_g0 + d7*now_material_y_by_g0 + now_normal_x*now_point_x_by_g0 - now_normal_x_by_g0*t2 + now_normal_y*now_point_y_by_g0 - now_normal_y_by_g0*t3
    out.jacobian[1, 7] = d6*now_material_x_by_g1 + d7*now_material_y_by_g1 + now_normal_x*now_point_x_by_g1 - now_normal_x_by_g1*t2 + now_normal_y*now_point_y_by_g1 - now_normal_y_by_g1*t3
    out.jacobian[1, 8] = d6*now_material_x_by_g2 + d7*now_material_y_by_g2 + now_normal_x*now_point_x_by_g2 - now_normal_x_by_g2*t2 + now_normal_y*now_point_y_by_g2 - now_normal_y_by_g2*t3
    information0 = 1.0 / (now_spread**2)
    information1 = 1.0 / (4e-06)
    out.information[0] = information0
    out.weight[0] = information0
    out.information[1] = information1
    out.weight[1] = information1
    return 2


@kernel
def first_pose(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return `Log(believed^-1 e g^-1)` [m, m, rad], and the differences of the object's variables."""
    belief_cos = row.first_turn.real
    belief_sin = row.first_turn.imag
    now_e_cos = now.turn_e.real
    now_e_sin = now.turn_e.imag
    now_g_cos = now.turn_g.real
    now_g_sin = now.turn_g.imag
    now_g_x = now.g[0]
    now_g_y = now.g[1]
    t0 = -now_g_cos*now_g_y + now_g_sin*now_g_x
    t1 = -now_g_cos*now_g_x - now_g_sin*now_g_y
    t2 = -row.first_pose[0] + now_e_cos*t1 - now_e_sin*t0 + now.e[0]
    t3 = -row.first_pose[1] + now_e_cos*t0 + now_e_sin*t1 + now.e[1]
    t4 = belief_cos*t2 + belief_sin*t3
    t9 = now.e[2] - now.g[2]
    t10 = wrap(t9)
    t11 = -row.first_pose[2] + t10
    t12 = wrap(t11)
    t13 = half_cotangent(t12)
    t7 = belief_cos*t3 - belief_sin*t2
    t8 = 0.5*t12
    d0 = half_cotangent_slope(t12)
    d1 = d0*t4 + 0.5*t7
    d2 = belief_cos*t8 + belief_sin*t13
    d3 = belief_cos*t13 - belief_sin*t8
    d4 = d2*now_e_sin + d3*now_e_cos
    d5 = d2*now_e_cos - d3*now_e_sin
    d6 = -d4*now_g_cos + d5*now_g_sin
    d7 = -d4*now_g_sin - d5*now_g_cos
    d8 = d0*t7 - 0.5*t4
    d9 = belief_cos*t13 - belief_sin*t8
    d10 = -belief_cos*t8 - belief_sin*t13
    d11 = d10*now_e_cos + d9*now_e_sin
    d12 = -d10*now_e_sin + d9*now_e_cos
    d13 = -d11*now_g_cos + d12*now_g_sin
    d14 = -d11*now_g_sin - d12*now_g_cos
    out.residual[0] = t13*t4 + t7*t8
    out.residual[1] = t13*t7 - t4*t8
    out.residual[2] = t12
    for k in range(17):
        out.residual[3 + k] = row.shared[9 + k] - row.first_values[k]
        out.jacobian[3 + k, 21 + k] = 1.0
    out.jacobian[0, 6] = d6*now_g_cos + d7*now_g_sin
    out.jacobian[0, 7] = -d6*now_g_sin + d7*now_g_cos
    out.jacobian[0, 8] = -d1 + now_g_cos*(-d4*now_g_y + d5*now_g_x) - now_g_sin*(-d4*now_g_x - d5*now_g_y)
    out.jacobian[0, 9] = d2*now_e_sin + d3*now_e_cos
    out.jacobian[0, 10] = d2*now_e_cos - d3*now_e_sin
    out.jacobian[0, 11] = d1 + now_e_cos*(d2*t1 - d3*t0) - now_e_sin*(d2*t0 + d3*t1)
    out.jacobian[1, 6] = d13*now_g_cos + d14*now_g_sin
    out.jacobian[1, 7] = -d13*now_g_sin + d14*now_g_cos
    out.jacobian[1, 8] = -d8 + now_g_cos*(-d11*now_g_y + d12*now_g_x) - now_g_sin*(-d11*now_g_x - d12*now_g_y)
    out.jacobian[1, 9] = d10*now_e_cos + d9*now_e_sin
    out.jacobian[1, 10] = -d10*now_e_sin + d9*now_e_cos
    out.jacobian[1, 11] = d8 + now_e_cos*(-d10*t0 + d9*t1) - now_e_sin*(d10*t1 + d9*t0)
    out.jacobian[2, 8] = -1.0
    out.jacobian[2, 11] = 1.0
    whiten(20, row.first_root, out)
    return 20


@kernel
def sensor_pose(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return `Log(measured^-1 e)` [m, m, rad]."""
    applies = (now.is_resting < 0.5)
    if not applies:
        return 0
    now_e_cos = now.turn_e.real
    now_e_sin = now.turn_e.imag
    now_measured_cos = now.turn_measured.real
    now_measured_sin = now.turn_measured.imag
    t0 = now.e[0] - now.measured[0]
    t1 = now.e[1] - now.measured[1]
    t2 = now_measured_cos*t0 + now_measured_sin*t1
    t7 = now.e[2] - now.measured[2]
    t8 = wrap(t7)
    t9 = half_cotangent(t8)
    t5 = now_measured_cos*t1 - now_measured_sin*t0
    t6 = 0.5*t8
    d0 = half_cotangent_slope(t8)
    d1 = d0*t2 + 0.5*t5
    d2 = now_measured_cos*t6 + now_measured_sin*t9
    d3 = now_measured_cos*t9 - now_measured_sin*t6
    d4 = d0*t5 - 0.5*t2
    d5 = now_measured_cos*t9 - now_measured_sin*t6
    d6 = -now_measured_cos*t6 - now_measured_sin*t9
    out.residual[0] = t2*t9 + t5*t6
    out.residual[1] = -t2*t6 + t5*t9
    out.residual[2] = t8
    out.jacobian[0, 9] = d2*now_e_sin + d3*now_e_cos
    out.jacobian[0, 10] = d2*now_e_cos - d3*now_e_sin
    out.jacobian[0, 11] = d1
    out.jacobian[1, 9] = d5*now_e_sin + d6*now_e_cos
    out.jacobian[1, 10] = d5*now_e_cos - d6*now_e_sin
    out.jacobian[1, 11] = d4
    out.jacobian[2, 11] = 1.0
    information0 = 1.0 / (settings.sensor_pose.deviation[0]**2)
    information1 = 1.0 / (settings.sensor_pose.deviation[1]**2)
    information2 = 1.0 / (settings.sensor_pose.deviation[2]**2)
    out.information[0] = information0
    out.weight[0] = information0
    out.information[1] = information1
    out.weight[1] = information1
    out.information[2] = information2
    out.weight[2] = information2
    return 3


@kernel
def contact(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return `gap + depth + sinking sunk - scale extent` [m], positive if sensor and object are too far apart."""
    if not (now.touches[0] > 0.5):
        return 0
    applies = (now.is_resting < 0.5)
    if not applies:
        return 0
    now_gap = now.touch_of[0].gap
    now_normal_x = now.touch_of[0].normal.real
    now_normal_y = now.touch_of[0].normal.imag
    now_point_x = now.touch_of[0].point.real
    now_point_y = now.touch_of[0].point.imag
    now_sunk = now.sunk[0]
    outline_scale = row.shared[13]
    support_center_x = settings.support.center.real
    support_center_y = settings.support.center.imag
    d0 = outline_scale + 1.0
    d1 = -outline_scale*(now_point_x - support_center_x)
    d2 = -outline_scale*(now_point_y - support_center_y)
    d3 = -now_normal_x*outline_scale
    d4 = -now_normal_y*outline_scale
    out.residual[0] = row.shared[12] + now_gap + now_sunk*row.shared[2] - outline_scale*(-now_gap + now_normal_x*(now_point_x - support_center_x) + now_normal_y*(now_point_y - support_center_y))
    out.jacobian[0, 6] = d0*now.touch_of[0].gap_by_g[0] + d1*now.touch_of[0].normal_by_g[0].real + d2*now.touch_of[0].normal_by_g[0].imag + d3*now.touch_of[0].point_by_g[0].real + d4*now.touch_of[0].point_by_g[0].imag
    out.jacobian[0, 7] = d0*now.touch_of[0].gap_by_g[1] + d1*now.touch_of[0].normal_by_g[1].real + d2*now.touch_of[0].normal_by_g[1].imag + d3*now.touch_of[0].point_by_g[1].real + d4*now.touch_of[0].point_by_g[1].imag
    out.jacobian[0, 8] = d0*now.touch_of[0].gap_by_g[2] + d1*now.touch_of[0].normal_by_g[2].real + d2*now.touch_of[0].normal_by_g[2].imag + d3*now.touch_of[0].point_by_g[2].real + d4*now.touch_of[0].point_by_g[2].imag
    out.jacobian[0, 14] = now_sunk
    out.jacobian[0, 24] = 1.0
    out.jacobian[0, 25] = now_gap - now_normal_x*(now_point_x - support_center_x) - now_normal_y*(now_point_y - support_center_y)
    information0 = 1.0 / (settings.contact.deviation**2 + 0.04000000000000001*now_sunk**2)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.contact.kernel)
    return 1


@kernel
def contact_1(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return `gap + depth + sinking sunk - scale extent` [m], positive if sensor and object are too far apart."""
    if not (now.touches[1] > 0.5):
        return 0
    applies = (now.is_resting < 0.5)
    if not applies:
        return 0
    now_gap = now.touch_of[1].gap
    now_normal_x = now.touch_of[1].normal.real
    now_normal_y = now.touch_of[1].normal.imag
    now_point_x = now.touch_of[1].point.real
    now_point_y = now.touch_of[1].point.imag
    now_sunk = now.sunk[1]
    outline_scale = row.shared[13]
    support_center_x = settings.support.center.real
    support_center_y = settings.support.center.imag
    d0 = outline_scale + 1.0
    d1 = -outline_scale*(now_point_x - support_center_x)
    d2 = -outline_scale*(now_point_y - support_center_y)
    d3 = -now_normal_x*outline_scale
    d4 = -now_normal_y*outline_scale
    out.residual[0] = row.shared[21] + now_gap + now_sunk*row.shared[5] - outline_scale*(-now_gap + now_normal_x*(now_point_x - support_center_x) + now_normal_y*(now_point_y - support_center_y))
    out.jacobian[0, 6] = d0*now.touch_of[1].gap_by_g[0] + d1*now.touch_of[1].normal_by_g[0].real + d2*now.touch_of[1].normal_by_g[0].imag + d3*now.touch_of[1].point_by_g[0].real + d4*now.touch_of[1].point_by_g[0].imag
    out.jacobian[0, 7] = d0*now.touch_of[1].gap_by_g[1] + d1*now.touch_of[1].normal_by_g[1].real + d2*now.touch_of[1].normal_by_g[1].imag + d3*now.touch_of[1].point_by_g[1].real + d4*now.touch_of[1].point_by_g[1].imag
    out.jacobian[0, 8] = d0*now.touch_of[1].gap_by_g[2] + d1*now.touch_of[1].normal_by_g[2].real + d2*now.touch_of[1].normal_by_g[2].imag + d3*now.touch_of[1].point_by_g[2].real + d4*now.touch_of[1].point_by_g[2].imag
    out.jacobian[0, 17] = now_sunk
    out.jacobian[0, 25] = now_gap - now_normal_x*(now_point_x - support_center_x) - now_normal_y*(now_point_y - support_center_y)
    out.jacobian[0, 33] = 1.0
    information0 = 1.0 / (settings.contact.deviation**2 + 0.04000000000000001*now_sunk**2)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.contact.kernel)
    return 1


@kernel
def contact_2(before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Return `gap + depth + sinking sunk - scale extent` [m], positive if sensor and object are too far apart."""
    if not (now.touches[2] > 0.5):
        return 0
    applies = (now.is_resting < 0.5)
    if not applies:
        return 0
    now_gap = now.touch_of[2].gap
    now_normal_x = now.touch_of[2].normal.real
    now_normal_y = now.touch_of[2].normal.imag
    now_point_x = now.touch_of[2].point.real
    now_point_y = now.touch_of[2].point.imag
    now_sunk = now.sunk[2]
    outline_scale = row.shared[13]
    support_center_x = settings.support.center.real
    support_center_y = settings.support.center.imag
    d0 = outline_scale + 1.0
    d1 = -outline_scale*(now_point_x - support_center_x)
    d2 = -outline_scale*(now_point_y - support_center_y)
    d3 = -now_normal_x*outline_scale
    d4 = -now_normal_y*outline_scale
    out.residual[0] = row.shared[25] + now_gap + now_sunk*row.shared[8] - outline_scale*(-now_gap + now_normal_x*(now_point_x - support_center_x) + now_normal_y*(now_point_y - support_center_y))
    out.jacobian[0, 6] = d0*now.touch_of[2].gap_by_g[0] + d1*now.touch_of[2].normal_by_g[0].real + d2*now.touch_of[2].normal_by_g[0].imag + d3*now.touch_of[2].point_by_g[0].real + d4*now.touch_of[2].point_by_g[0].imag
    out.jacobian[0, 7] = d0*now.touch_of[2].gap_by_g[1] + d1*now.touch_of[2].normal_by_g[1].real + d2*now.touch_of[2].normal_by_g[1].imag + d3*now.touch_of[2].point_by_g[1].real + d4*now.touch_of[2].point_by_g[1].imag
    out.jacobian[0, 8] = d0*now.touch_of[2].gap_by_g[2] + d1*now.touch_of[2].normal_by_g[2].real + d2*now.touch_of[2].normal_by_g[2].imag + d3*now.touch_of[2].point_by_g[2].real + d4*now.touch_of[2].point_by_g[2].imag
    out.jacobian[0, 20] = now_sunk
    out.jacobian[0, 25] = now_gap - now_normal_x*(now_point_x - support_center_x) - now_normal_y*(now_point_y - support_center_y)
    out.jacobian[0, 37] = 1.0
    information0 = 1.0 / (settings.contact.deviation**2 + 0.04000000000000001*now_sunk**2)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.contact.kernel)
    return 1


@kernel
def direction(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `psi + scale sin(psi) + bias - angle` [rad], wrapped."""
    if not (now.touches[0] > 0.5):
        return 0
    direction_scale = row.shared[10]
    now_finger_cos = now.turn_finger[0].real
    now_finger_sin = now.turn_finger[0].imag
    now_g_cos = now.turn_g.real
    now_g_sin = now.turn_g.imag
    now_normal_x = now.touch_of[0].normal.real
    now_normal_y = now.touch_of[0].normal.imag
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = now_finger_cos*now_g_cos - now_finger_sin*now_g_sin
    t1 = now_finger_cos*now_g_sin + now_finger_sin*now_g_cos
    t3 = -now_normal_x*t0 - now_normal_y*t1
    t4 = now_normal_x*t1 - now_normal_y*t0
    t5 = bearing(t3, t4)
    t6 = math.sin(t5)
    t7 = row.shared[9] + direction_scale*t6 - term.data[0]*sign + t5
    t8 = wrap(t7)
    t9 = settings.direction.floor**2
    t10 = larger(term.variance, t9)
    d0 = math.cos(t5)
    d1 = d0*direction_scale + 1.0
    d2 = inverse_square(t3, t4)
    d3 = d1*d2*t3
    d4 = -d1*d2*t4
    d5 = d3*now_normal_x - d4*now_normal_y
    d6 = -d3*now_normal_y - d4*now_normal_x
    d7 = d3*t1 - d4*t0
    d8 = -d3*t0 - d4*t1
    out.residual[0] = t8
    out.jacobian[0, 6] = d7*now.touch_of[0].normal_by_g[0].real + d8*now.touch_of[0].normal_by_g[0].imag
    out.jacobian[0, 7] = d7*now.touch_of[0].normal_by_g[1].real + d8*now.touch_of[0].normal_by_g[1].imag
    out.jacobian[0, 8] = d7*now.touch_of[0].normal_by_g[2].real + d8*now.touch_of[0].normal_by_g[2].imag + now_g_cos*(d5*now_finger_cos - d6*now_finger_sin) - now_g_sin*(d5*now_finger_sin + d6*now_finger_cos)
    out.jacobian[0, 21] = 1.0
    out.jacobian[0, 22] = t6
    information0 = 1.0 / (settings.direction.share*t10)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.direction.kernel)
    return 1


@kernel
def place(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `y of the material point + bias - place` [m]."""
    if not (now.touches[0] > 0.5):
        return 0
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = settings.place.floor**2
    t1 = larger(term.variance, t0)
    out.residual[0] = -term.data[0]*sign + now.touch_of[0].material.imag + row.shared[11]
    out.jacobian[0, 6] = now.touch_of[0].material_by_g[0].imag
    out.jacobian[0, 7] = now.touch_of[0].material_by_g[1].imag
    out.jacobian[0, 8] = now.touch_of[0].material_by_g[2].imag
    out.jacobian[0, 23] = 1.0
    information0 = 1.0 / (settings.place.share*t1)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.place.kernel)
    return 1


@kernel
def turn(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `theta - offset - angle` [rad], wrapped, with theta the yaw of g."""
    if not (now.touches[0] > 0.5):
        return 0
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = now.finger[0][2] + now.g[2]
    t1 = wrap(t0)
    t2 = -term.data[0]*sign + t1 - row.shared[0]
    t3 = wrap(t2)
    t4 = settings.turn.floor**2
    t5 = larger(term.variance, t4)
    out.residual[0] = t3
    out.jacobian[0, 8] = 1.0
    out.jacobian[0, 12] = -1.0
    information0 = 1.0 / (settings.turn.share*t5)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.turn.kernel)
    return 1


@kernel
def corner(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `psi - angle - slope (h - 45 deg) - bias` [rad], with psi within -h to h."""
    if not (now.touches[0] > 0.5):
        return 0
    known_cos, known_sin, known_half = nearest_corner_of(now, 0, places)
    applies = (known_half > 0.0)
    if not applies:
        return 0
    now_normal_x = now.touch_of[0].normal.real
    now_normal_y = now.touch_of[0].normal.imag
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = -known_cos*now_normal_x - known_sin*now_normal_y
    t1 = -known_cos*now_normal_y + known_sin*now_normal_x
    t2 = bearing(t0, t1)
    t3 = clamp(t2, known_half)
    t4 = settings.corner.floor**2
    t5 = larger(term.variance, t4)
    d0 = is_within(t2, known_half)
    d1 = inverse_square(t0, t1)
    d2 = d0*d1*t0
    d3 = -d0*d1*t1
    d4 = d2*known_sin - d3*known_cos
    d5 = -d2*known_cos - d3*known_sin
    out.residual[0] = -row.shared[1] - sign*(term.data[0] + term.data[1]*(known_half - 0.7853981633974483)) + t3
    out.jacobian[0, 6] = d4*now.touch_of[0].normal_by_g[0].real + d5*now.touch_of[0].normal_by_g[0].imag
    out.jacobian[0, 7] = d4*now.touch_of[0].normal_by_g[1].real + d5*now.touch_of[0].normal_by_g[1].imag
    out.jacobian[0, 8] = d4*now.touch_of[0].normal_by_g[2].real + d5*now.touch_of[0].normal_by_g[2].imag
    out.jacobian[0, 13] = -1.0
    information0 = 1.0 / (settings.corner.share*t5)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.corner.kernel)
    return 1


@kernel
def object_pose(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `Log(measured^-1 e g^-1)` [m, m, rad], which the measurement's covariance whitens."""
    measured_cos = term.data[2]
    measured_sin = term.data[3]
    now_e_cos = now.turn_e.real
    now_e_sin = now.turn_e.imag
    now_g_cos = now.turn_g.real
    now_g_sin = now.turn_g.imag
    now_g_x = now.g[0]
    now_g_y = now.g[1]
    t0 = -now_g_cos*now_g_y + now_g_sin*now_g_x
    t1 = -now_g_cos*now_g_x - now_g_sin*now_g_y
    t2 = -term.data[0] + now_e_cos*t1 - now_e_sin*t0 + now.e[0]
    t3 = -term.data[1] + now_e_cos*t0 + now_e_sin*t1 + now.e[1]
    t4 = measured_cos*t2 + measured_sin*t3
    t9 = now.e[2] - now.g[2]
    t10 = wrap(t9)
    t11 = -term.data[4] + t10
    t12 = wrap(t11)
    t13 = half_cotangent(t12)
    t7 = measured_cos*t3 - measured_sin*t2
    t8 = 0.5*t12
    d0 = half_cotangent_slope(t12)
    d1 = d0*t4 + 0.5*t7
    d2 = measured_cos*t8 + measured_sin*t13
    d3 = measured_cos*t13 - measured_sin*t8
    d4 = d2*now_e_sin + d3*now_e_cos
    d5 = d2*now_e_cos - d3*now_e_sin
    d6 = -d4*now_g_cos + d5*now_g_sin
    d7 = -d4*now_g_sin - d5*now_g_cos
    d8 = d0*t7 - 0.5*t4
    d9 = measured_cos*t13 - measured_sin*t8
    d10 = -measured_cos*t8 - measured_sin*t13
    d11 = d10*now_e_cos + d9*now_e_sin
    d12 = -d10*now_e_sin + d9*now_e_cos
    d13 = -d11*now_g_cos + d12*now_g_sin
    d14 = -d11*now_g_sin - d12*now_g_cos
    out.residual[0] = t13*t4 + t7*t8
    out.residual[1] = t13*t7 - t4*t8
    out.residual[2] = t12
    out.jacobian[0, 6] = d6*now_g_cos + d7*now_g_sin
    out.jacobian[0, 7] = -d6*now_g_sin + d7*now_g_cos
    out.jacobian[0, 8] = -d1 + now_g_cos*(-d4*now_g_y + d5*now_g_x) - now_g_sin*(-d4*now_g_x - d5*now_g_y)
    out.jacobian[0, 9] = d2*now_e_sin + d3*now_e_cos
    out.jacobian[0, 10] = d2*now_e_cos - d3*now_e_sin
    out.jacobian[0, 11] = d1 + now_e_cos*(d2*t1 - d3*t0) - now_e_sin*(d2*t0 + d3*t1)
    out.jacobian[1, 6] = d13*now_g_cos + d14*now_g_sin
    out.jacobian[1, 7] = -d13*now_g_sin + d14*now_g_cos
    out.jacobian[1, 8] = -d8 + now_g_cos*(-d11*now_g_y + d12*now_g_x) - now_g_sin*(-d11*now_g_x - d12*now_g_y)
    out.jacobian[1, 9] = d10*now_e_cos + d9*now_e_sin
    out.jacobian[1, 10] = -d10*now_e_sin + d9*now_e_cos
    out.jacobian[1, 11] = d8 + now_e_cos*(-d10*t0 + d9*t1) - now_e_sin*(d10*t1 + d9*t0)
    out.jacobian[2, 8] = -1.0
    out.jacobian[2, 11] = 1.0
    whiten(3, term.root, out)
    return 3


@kernel
def direction_1(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `psi + scale sin(psi) + bias - angle` [rad], wrapped."""
    if not (now.touches[1] > 0.5):
        return 0
    direction_scale_1 = row.shared[19]
    now_finger_cos = now.turn_finger[1].real
    now_finger_sin = now.turn_finger[1].imag
    now_g_cos = now.turn_g.real
    now_g_sin = now.turn_g.imag
    now_normal_x = now.touch_of[1].normal.real
    now_normal_y = now.touch_of[1].normal.imag
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = now_finger_cos*now_g_cos - now_finger_sin*now_g_sin
    t1 = now_finger_cos*now_g_sin + now_finger_sin*now_g_cos
    t3 = -now_normal_x*t0 - now_normal_y*t1
    t4 = now_normal_x*t1 - now_normal_y*t0
    t5 = bearing(t3, t4)
    t6 = math.sin(t5)
    t7 = row.shared[18] + direction_scale_1*t6 - term.data[0]*sign + t5
    t8 = wrap(t7)
    t9 = settings.direction.floor**2
    t10 = larger(term.variance, t9)
    d0 = math.cos(t5)
    d1 = d0*direction_scale_1 + 1.0
    d2 = inverse_square(t3, t4)
    d3 = d1*d2*t3
    d4 = -d1*d2*t4
    d5 = d3*now_normal_x - d4*now_normal_y
    d6 = -d3*now_normal_y - d4*now_normal_x
    d7 = d3*t1 - d4*t0
    d8 = -d3*t0 - d4*t1
    out.residual[0] = t8
    out.jacobian[0, 6] = d7*now.touch_of[1].normal_by_g[0].real + d8*now.touch_of[1].normal_by_g[0].imag
    out.jacobian[0, 7] = d7*now.touch_of[1].normal_by_g[1].real + d8*now.touch_of[1].normal_by_g[1].imag
    out.jacobian[0, 8] = d7*now.touch_of[1].normal_by_g[2].real + d8*now.touch_of[1].normal_by_g[2].imag + now_g_cos*(d5*now_finger_cos - d6*now_finger_sin) - now_g_sin*(d5*now_finger_sin + d6*now_finger_cos)
    out.jacobian[0, 30] = 1.0
    out.jacobian[0, 31] = t6
    information0 = 1.0 / (settings.direction.share*t10)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.direction.kernel)
    return 1


@kernel
def place_1(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `y of the material point + bias - place` [m]."""
    if not (now.touches[1] > 0.5):
        return 0
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = settings.place.floor**2
    t1 = larger(term.variance, t0)
    out.residual[0] = -term.data[0]*sign + now.touch_of[1].material.imag + row.shared[20]
    out.jacobian[0, 6] = now.touch_of[1].material_by_g[0].imag
    out.jacobian[0, 7] = now.touch_of[1].material_by_g[1].imag
    out.jacobian[0, 8] = now.touch_of[1].material_by_g[2].imag
    out.jacobian[0, 32] = 1.0
    information0 = 1.0 / (settings.place.share*t1)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.place.kernel)
    return 1


@kernel
def turn_1(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `theta - offset - angle` [rad], wrapped, with theta the yaw of g."""
    if not (now.touches[1] > 0.5):
        return 0
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = now.finger[1][2] + now.g[2]
    t1 = wrap(t0)
    t2 = -term.data[0]*sign + t1 - row.shared[3]
    t3 = wrap(t2)
    t4 = settings.turn.floor**2
    t5 = larger(term.variance, t4)
    out.residual[0] = t3
    out.jacobian[0, 8] = 1.0
    out.jacobian[0, 15] = -1.0
    information0 = 1.0 / (settings.turn.share*t5)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.turn.kernel)
    return 1


@kernel
def corner_1(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `psi - angle - slope (h - 45 deg) - bias` [rad], with psi within -h to h."""
    if not (now.touches[1] > 0.5):
        return 0
    known_cos, known_sin, known_half = nearest_corner_of(now, 1, places)
    applies = (known_half > 0.0)
    if not applies:
        return 0
    now_normal_x = now.touch_of[1].normal.real
    now_normal_y = now.touch_of[1].normal.imag
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = -known_cos*now_normal_x - known_sin*now_normal_y
    t1 = -known_cos*now_normal_y + known_sin*now_normal_x
    t2 = bearing(t0, t1)
    t3 = clamp(t2, known_half)
    t4 = settings.corner.floor**2
    t5 = larger(term.variance, t4)
    d0 = is_within(t2, known_half)
    d1 = inverse_square(t0, t1)
    d2 = d0*d1*t0
    d3 = -d0*d1*t1
    d4 = d2*known_sin - d3*known_cos
    d5 = -d2*known_cos - d3*known_sin
    out.residual[0] = -row.shared[4] - sign*(term.data[0] + term.data[1]*(known_half - 0.7853981633974483)) + t3
    out.jacobian[0, 6] = d4*now.touch_of[1].normal_by_g[0].real + d5*now.touch_of[1].normal_by_g[0].imag
    out.jacobian[0, 7] = d4*now.touch_of[1].normal_by_g[1].real + d5*now.touch_of[1].normal_by_g[1].imag
    out.jacobian[0, 8] = d4*now.touch_of[1].normal_by_g[2].real + d5*now.touch_of[1].normal_by_g[2].imag
    out.jacobian[0, 16] = -1.0
    information0 = 1.0 / (settings.corner.share*t5)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.corner.kernel)
    return 1


@kernel
def direction_2(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `psi + scale sin(psi) + bias - angle` [rad], wrapped."""
    if not (now.touches[2] > 0.5):
        return 0
    direction_scale_2 = row.shared[23]
    now_finger_cos = now.turn_finger[2].real
    now_finger_sin = now.turn_finger[2].imag
    now_g_cos = now.turn_g.real
    now_g_sin = now.turn_g.imag
    now_normal_x = now.touch_of[2].normal.real
    now_normal_y = now.touch_of[2].normal.imag
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = now_finger_cos*now_g_cos - now_finger_sin*now_g_sin
    t1 = now_finger_cos*now_g_sin + now_finger_sin*now_g_cos
    t3 = -now_normal_x*t0 - now_normal_y*t1
    t4 = now_normal_x*t1 - now_normal_y*t0
    t5 = bearing(t3, t4)
    t6 = math.sin(t5)
    t7 = row.shared[22] + direction_scale_2*t6 - term.data[0]*sign + t5
    t8 = wrap(t7)
    t9 = settings.direction.floor**2
    t10 = larger(term.variance, t9)
    d0 = math.cos(t5)
    d1 = d0*direction_scale_2 + 1.0
    d2 = inverse_square(t3, t4)
    d3 = d1*d2*t3
    d4 = -d1*d2*t4
    d5 = d3*now_normal_x - d4*now_normal_y
    d6 = -d3*now_normal_y - d4*now_normal_x
    d7 = d3*t1 - d4*t0
    d8 = -d3*t0 - d4*t1
    out.residual[0] = t8
    out.jacobian[0, 6] = d7*now.touch_of[2].normal_by_g[0].real + d8*now.touch_of[2].normal_by_g[0].imag
    out.jacobian[0, 7] = d7*now.touch_of[2].normal_by_g[1].real + d8*now.touch_of[2].normal_by_g[1].imag
    out.jacobian[0, 8] = d7*now.touch_of[2].normal_by_g[2].real + d8*now.touch_of[2].normal_by_g[2].imag + now_g_cos*(d5*now_finger_cos - d6*now_finger_sin) - now_g_sin*(d5*now_finger_sin + d6*now_finger_cos)
    out.jacobian[0, 34] = 1.0
    out.jacobian[0, 35] = t6
    information0 = 1.0 / (settings.direction.share*t10)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.direction.kernel)
    return 1


@kernel
def place_2(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `y of the material point + bias - place` [m]."""
    if not (now.touches[2] > 0.5):
        return 0
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = settings.place.floor**2
    t1 = larger(term.variance, t0)
    out.residual[0] = -term.data[0]*sign + now.touch_of[2].material.imag + row.shared[24]
    out.jacobian[0, 6] = now.touch_of[2].material_by_g[0].imag
    out.jacobian[0, 7] = now.touch_of[2].material_by_g[1].imag
    out.jacobian[0, 8] = now.touch_of[2].material_by_g[2].imag
    out.jacobian[0, 36] = 1.0
    information0 = 1.0 / (settings.place.share*t1)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.place.kernel)
    return 1


@kernel
def turn_2(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `theta - offset - angle` [rad], wrapped, with theta the yaw of g."""
    if not (now.touches[2] > 0.5):
        return 0
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = now.finger[2][2] + now.g[2]
    t1 = wrap(t0)
    t2 = -term.data[0]*sign + t1 - row.shared[6]
    t3 = wrap(t2)
    t4 = settings.turn.floor**2
    t5 = larger(term.variance, t4)
    out.residual[0] = t3
    out.jacobian[0, 8] = 1.0
    out.jacobian[0, 18] = -1.0
    information0 = 1.0 / (settings.turn.share*t5)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.turn.kernel)
    return 1


@kernel
def corner_2(now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Return `psi - angle - slope (h - 45 deg) - bias` [rad], with psi within -h to h."""
    if not (now.touches[2] > 0.5):
        return 0
    known_cos, known_sin, known_half = nearest_corner_of(now, 2, places)
    applies = (known_half > 0.0)
    if not applies:
        return 0
    now_normal_x = now.touch_of[2].normal.real
    now_normal_y = now.touch_of[2].normal.imag
    sign = row.sign if term.from_touch == 1.0 else 1.0
    t0 = -known_cos*now_normal_x - known_sin*now_normal_y
    t1 = -known_cos*now_normal_y + known_sin*now_normal_x
    t2 = bearing(t0, t1)
    t3 = clamp(t2, known_half)
    t4 = settings.corner.floor**2
    t5 = larger(term.variance, t4)
    d0 = is_within(t2, known_half)
    d1 = inverse_square(t0, t1)
    d2 = d0*d1*t0
    d3 = -d0*d1*t1
    d4 = d2*known_sin - d3*known_cos
    d5 = -d2*known_cos - d3*known_sin
    out.residual[0] = -row.shared[7] - sign*(term.data[0] + term.data[1]*(known_half - 0.7853981633974483)) + t3
    out.jacobian[0, 6] = d4*now.touch_of[2].normal_by_g[0].real + d5*now.touch_of[2].normal_by_g[0].imag
    out.jacobian[0, 7] = d4*now.touch_of[2].normal_by_g[1].real + d5*now.touch_of[2].normal_by_g[1].imag
    out.jacobian[0, 8] = d4*now.touch_of[2].normal_by_g[2].real + d5*now.touch_of[2].normal_by_g[2].imag
    out.jacobian[0, 19] = -1.0
    information0 = 1.0 / (settings.corner.share*t5)
    out.information[0] = information0
    out.weight[0] = information0 * cauchy(information0 * out.residual[0]**2, settings.corner.kernel)
    return 1


@kernel
def linearise_step(kind: int, before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Write the linearised rows of the factor of this place, and return their number."""
    if kind == 0:
        return sticking(before, now, row, settings, out)
    if kind == 1:
        return balance(before, now, row, settings, out)
    if kind == 2:
        return friction_cone(before, now, row, settings, out)
    if kind == 3:
        return disturbed_slide(before, now, row, settings, out)
    if kind == 4:
        return disturbed_turn(before, now, row, settings, out)
    if kind == 5:
        return sticking_1(before, now, row, settings, out)
    if kind == 6:
        return disturbed_slide_1(before, now, row, settings, out)
    if kind == 7:
        return sticking_2(before, now, row, settings, out)
    if kind == 8:
        return disturbed_slide_2(before, now, row, settings, out)
    if kind == 9:
        return first_pose(before, now, row, settings, out)
    if kind == 10:
        return sensor_pose(before, now, row, settings, out)
    if kind == 11:
        return contact(before, now, row, settings, out)
    if kind == 12:
        return contact_1(before, now, row, settings, out)
    if kind == 13:
        return contact_2(before, now, row, settings, out)
    return 0


@kernel
def linearise_measured(kind: int, now: Records, row: Records, term: Records, settings: Records, places: Array, out: Records) -> int:
    """Write the linearised rows of the factor of this place, and return their number."""
    if kind == 14:
        return direction(now, row, term, settings, places, out)
    if kind == 15:
        return place(now, row, term, settings, places, out)
    if kind == 16:
        return turn(now, row, term, settings, places, out)
    if kind == 17:
        return corner(now, row, term, settings, places, out)
    if kind == 18:
        return object_pose(now, row, term, settings, places, out)
    if kind == 19:
        return direction_1(now, row, term, settings, places, out)
    if kind == 20:
        return place_1(now, row, term, settings, places, out)
    if kind == 21:
        return turn_1(now, row, term, settings, places, out)
    if kind == 22:
        return corner_1(now, row, term, settings, places, out)
    if kind == 23:
        return direction_2(now, row, term, settings, places, out)
    if kind == 24:
        return place_2(now, row, term, settings, places, out)
    if kind == 25:
        return turn_2(now, row, term, settings, places, out)
    if kind == 26:
        return corner_2(now, row, term, settings, places, out)
    return 0
