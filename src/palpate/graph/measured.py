"""Kernels of the factors that depend on one step: contact, and all that is measured.

A kernel writes the linearised rows of a factor and returns their number; see `factors.LINEAR`.
"""

import math

from palpate.arrays import Array, Records
from palpate.compiled import kernel
from palpate.graph.contact_geometry import RIGHT_ANGLE
from palpate.graph.se2_kernels import adjoint, between, cauchy, log, log_by_pose, position, rotation, wrap
from palpate.graph.variables import (
    CONTACT_SIZE,
    CORNER_BIAS,
    DEPTH,
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    OBJECT_SIZE,
    OUTLINE_SCALE,
    PLACE_BIAS,
    STEP_SIZE,
    TURN_OFFSET,
    column,
)

_G, _E, _SHARED = STEP_SIZE, STEP_SIZE + 3, 2 * STEP_SIZE  # columns
_BIAS, _SCALE, _PLACE = column(DIRECTION_BIAS), column(DIRECTION_SCALE), column(PLACE_BIAS)
_DEPTH, _SIZE, _OFFSET, _CORNER = column(DEPTH), column(OUTLINE_SCALE), column(TURN_OFFSET), column(CORNER_BIAS)
_NO_GRADIENT = 1e-12  # squared length of a gradient without direction


@kernel
def put_row(out: Records, error: float, inverse_variance: float, kernel: float) -> int:
    """Write the error of a single row and its weight under a Cauchy kernel; return the number of rows."""
    out.residual[0], out.information[0] = error, inverse_variance
    out.weight[0] = inverse_variance * cauchy(inverse_variance * error**2, kernel)
    return 1


@kernel
def _inverse_variance(term: Records, noise: Records) -> float:
    """Return the inverse variance of a measurement, which is no better than the contact model."""
    return 1.0 / (max(term.variance, noise.floor**2) * noise.share)


@kernel
def sensor_pose(now: Records, settings: Records, out: Records) -> int:
    """Measured sensor pose, `Log(measured^-1 e)` (paper Eq. 12)."""
    between(now.measured, now.e, out.error)
    log(out.error, out.error)
    log_by_pose(out.error, out.by_pose)
    for r in range(3):
        out.residual[r] = out.error[r]
        for c in range(3):
            out.jacobian[r, _E + c] = out.by_pose[r, c]
        out.information[r] = out.weight[r] = 1.0 / settings.sensor_pose.deviation[r] ** 2
    return 3


@kernel
def contact(now: Records, row: Records, settings: Records, out: Records) -> int:
    """The sensor's surface lies on the outline, except for an indentation (paper Eq. 11, two-sided).

    The residual is `gap + depth - scale reach` [m]: positive if sensor and object are further apart than the
    indentation says. The reach is the distance of the outline from its centroid along its normal: an object larger than
    its outline by a small relative scale reaches farther by that share.
    """
    touch, jacobian = now.touch, out.jacobian[0]
    depth, scale = row.shared[_DEPTH - _SHARED], row.shared[_SIZE - _SHARED]
    arm = touch.point - settings.friction_center
    reach = (touch.normal.conjugate() * arm).real - touch.gap
    for c in range(3):
        turned, moved = touch.normal_by_g[c].conjugate() * arm, touch.normal.conjugate() * touch.point_by_g[c]
        reach_by = turned.real + moved.real - touch.gap_by_g[c]
        jacobian[_G + c] = touch.gap_by_g[c] - scale * reach_by
    jacobian[_DEPTH], jacobian[_SIZE] = 1.0, -reach
    error = touch.gap + depth - scale * reach
    return put_row(out, error, 1.0 / settings.contact.deviation**2, settings.contact.kernel)


@kernel
def direction(now: Records, row: Records, term: Records, angle: float, settings: Records, out: Records) -> int:
    """Contact direction: touch measures the direction in which a round tip is touched.

    The true direction points from the tip's centre to the nearest outline point, opposite to the outward normal n
    there, seen in the sensor frame at psi, the angle of `-n exp(-i theta)`. The residual [rad] is
    `psi + scale sin(psi) + bias - angle`, wrapped to (-pi, pi]. The scale multiplies what is predicted and not the
    measured angle, whose noise would look like a scale, and the sine, since psi jumps behind the tip. The direction is
    absolute and does not drift: it determines yaw on a straight edge, and the place on a round one.
    """
    touch, jacobian = now.touch, out.jacobian[0]
    bias, scale = row.shared[_BIAS - _SHARED], row.shared[_SCALE - _SHARED]
    seen = -touch.normal * rotation(-now.g[2])
    psi = math.atan2(seen.imag, seen.real)
    by_psi = 1.0 + scale * math.cos(psi)
    # The spline's gradient has length 1 except near the medial axis, where it may vanish.
    square = max(touch.normal.real**2 + touch.normal.imag**2, _NO_GRADIENT)
    for c in range(3):
        jacobian[_G + c] = by_psi * (touch.normal.conjugate() * touch.normal_by_g[c]).imag / square
    jacobian[_G + 2] -= by_psi  # the direction stays while the sensor turns
    jacobian[_BIAS], jacobian[_SCALE] = 1.0, math.sin(psi)
    error = wrap(psi + scale * math.sin(psi) + bias - angle)
    return put_row(out, error, _inverse_variance(term, settings.direction), settings.direction.kernel)


@kernel
def place(now: Records, row: Records, term: Records, y: float, settings: Records, out: Records) -> int:
    """Contact place: touch measures the position along y at which a flat pad is touched.

    The true place is that of the sensor's material point, the load-weighted mean over the pad's parts, so the residual
    [m] is `y of material + bias - place`. On a flat pad a round outline always has its normal along x; the place is to
    a flat pad what the contact direction is to a round tip.
    """
    touch = now.touch
    for c in range(3):
        out.jacobian[0, _G + c] = touch.material_by_g[c].imag
    out.jacobian[0, _PLACE] = 1.0
    error = touch.material.imag + row.shared[_PLACE - _SHARED] - y
    return put_row(out, error, _inverse_variance(term, settings.place), settings.place.kernel)


@kernel
def turn(now: Records, row: Records, term: Records, angle: float, settings: Records, out: Records) -> int:
    """Turn: touch measures the sensor's yaw in the object frame, up to an offset that is constant within a contact.

    The residual [rad] is `theta - offset - angle`, wrapped to (-pi, pi], with theta the yaw of g.
    """
    out.jacobian[0, _G + 2], out.jacobian[0, _OFFSET] = 1.0, -1.0
    error = wrap(now.g[2] - row.shared[_OFFSET - _SHARED] - angle)
    return put_row(out, error, _inverse_variance(term, settings.turn), settings.turn.kernel)


@kernel
def corner(
    now: Records, row: Records, term: Records, sign: float, settings: Records, corners: Array, out: Records
) -> int:
    """Corner: touch measures the angle of the contact's inward normal -n off the bisector of the corner touched.

    The corner is the one nearest to the contact, and h is half the angle between the normals of its sides. The residual
    [rad] is `psi - angle - slope (h - 45 deg) - bias`, with psi the angle of -n off the bisector, in [-h, h]. At a
    corner psi follows the sensor's position; on its sides it is constant, so that a measured angle inside the cone
    speaks against them. Outlines without corners have no residual.
    """
    touch, nearest, least = now.touch, -1, math.inf
    for i in range(len(corners)):
        away = abs(touch.point - complex(corners[i, 0], corners[i, 1]))
        if away < least:
            nearest, least = i, away
    if nearest < 0:
        return 0
    off, most = -touch.normal * rotation(-corners[nearest, 2]), corners[nearest, 3]
    psi = math.atan2(off.imag, off.real)
    if abs(psi) < most:
        square = max(touch.normal.real**2 + touch.normal.imag**2, _NO_GRADIENT)
        for c in range(3):
            out.jacobian[0, _G + c] = (touch.normal.conjugate() * touch.normal_by_g[c]).imag / square
    out.jacobian[0, _CORNER] = -1.0
    angle = sign * (term.value + term.slope * (most - RIGHT_ANGLE))
    error = min(max(psi, -most), most) - angle - row.shared[_CORNER - _SHARED]
    return put_row(out, error, _inverse_variance(term, settings.corner), settings.corner.kernel)


@kernel
def object_pose(now: Records, term: Records, out: Records) -> int:
    """Object pose measured by another source, such as a camera: `Log(measured^-1 e g^-1)`, whitened."""
    _put_object_pose(now, term.pose, out)
    for r in range(3):
        _whiten(term.root[r], r, out)
    return 3


@kernel
def first_pose(now: Records, row: Records, out: Records) -> int:
    """Belief about the object at the beginning of a contact: a joint Gaussian on its pose o = e g^-1 and variables.

    The residual is `Log(believed^-1 e g^-1)` followed by the differences of the variables, whitened together. It takes
    the place of the paper's rest factor once the past is marginalised.
    """
    _put_object_pose(now, row.first_pose, out)
    for r in range(3 + OBJECT_SIZE):
        _whiten(row.first_root[r], r, out)
        for k in range(OBJECT_SIZE):
            by_value, here = row.first_root[r, 3 + k], CONTACT_SIZE + k
            out.residual[r] += by_value * (row.shared[here] - row.first_values[k])
            out.jacobian[r, _SHARED + here] = by_value
    return 3 + OBJECT_SIZE


@kernel
def _put_object_pose(now: Records, known: Array, out: Records) -> None:
    """Write the error `Log(known^-1 e g^-1)`, its derivative by e g^-1, and that pose's derivative by e.

    With o = e g^-1: e exp(d) g^-1 = o exp(Ad_g d), and e (g exp(d))^-1 = o exp(-Ad_g d).
    """
    g, e, error = now.g, now.e, out.error
    off = (position(e) - rotation(e[2] - g[2]) * position(g) - position(known)) * rotation(-known[2])
    error[0], error[1], error[2] = off.real, off.imag, wrap(e[2] - g[2] - known[2])
    log(error, error)
    log_by_pose(error, out.by_pose)
    adjoint(g, out.adjoint)


@kernel
def _whiten(root: Array, r: int, out: Records) -> None:
    """Write row r of what is whitened by a root, of which this is the row (3 or more,), and its derivatives."""
    error, by_pose = out.error, out.by_pose
    out.information[r] = out.weight[r] = 1.0
    out.residual[r] = root[0] * error[0] + root[1] * error[1] + root[2] * error[2]
    for k in range(3):
        by = root[0] * by_pose[0, k] + root[1] * by_pose[1, k] + root[2] * by_pose[2, k]
        for c in range(3):
            out.jacobian[r, _E + c] += by * out.adjoint[k, c]
            out.jacobian[r, _G + c] -= by * out.adjoint[k, c]
