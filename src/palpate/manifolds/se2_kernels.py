"""Planar rigid motion in compiled code. Vectors are complex numbers, so that `exp(i theta)` rotates them.

The product of one's conjugate and another has their scalar product as real and their cross product as imaginary part.

A pose is three numbers x [m], y [m], theta [rad] of an array; perturbations are on the right (body frame), in that
order. Formulas: J. Sola et al., "A micro Lie theory for state estimation in robotics", 2018, with half angles, as in
`geometry.se2`.
"""

import math

import numpy as np

from palpate.arrays import Array
from palpate.compiled import kernel

_SERIES_BELOW = 0.1  # [rad]; here the series below is exact to rounding and the closed form loses three digits


@kernel
def wrap(angle: float) -> float:
    """Return the same angle in (-pi, pi]."""
    rest = angle if abs(angle) < math.pi else np.fmod(angle, 2.0 * math.pi)
    if abs(rest) > math.pi or rest == -math.pi:
        rest -= math.copysign(2.0 * math.pi, rest)
    return rest


@kernel
def rotation(theta: float) -> complex:
    """Return exp(i theta)."""
    return complex(math.cos(theta), math.sin(theta))


@kernel
def position(pose: Array) -> complex:
    """Return the position of a pose (3,) as a complex number [m]."""
    return complex(pose[0], pose[1])


@kernel
def between(a: Array, b: Array, out: Array) -> None:
    """Write the pose b (3,) as seen from a (3,) to out (3,)."""
    seen = (position(b) - position(a)) * rotation(-a[2])
    out[0], out[1], out[2] = seen.real, seen.imag, wrap(b[2] - a[2])


@kernel
def exp_onto(pose: Array, change: Array) -> None:
    """Perturb a pose (3,) by the tangent vector at the begin of a change (3 or more,): pose exp(change)."""
    dx, dy, turned = change[0], change[1], change[2]
    half = 0.5 * turned
    chord = math.sin(half) / half if half != 0.0 else 1.0
    moved = position(pose) + rotation(pose[2] + half) * chord * complex(dx, dy)
    pose[0], pose[1], pose[2] = moved.real, moved.imag, wrap(pose[2] + turned)


@kernel
def log(pose: Array, out: Array) -> None:
    """Write the tangent vector of a pose (3,) to out (3,): exp(out) = pose."""
    theta = wrap(pose[2])
    half = 0.5 * theta
    cot = half / math.tan(half) if half != 0.0 else 1.0
    x, y = pose[0], pose[1]
    out[0], out[1], out[2] = cot * x + half * y, cot * y - half * x, theta


@kernel
def log_by_pose(tangent: Array, out: Array) -> None:
    """Write J (3, 3) with log(T exp(d)) = log(T) + J d at tangent (3,) = log(T) to out: inverse right Jacobian."""
    vx, vy, omega = tangent[0], tangent[1], tangent[2]
    half = 0.5 * omega
    cot = half / math.tan(half) if half != 0.0 else 1.0
    if abs(omega) < _SERIES_BELOW:
        square = half * half
        e = half / 6.0 * (1.0 + square / 15.0 * (1.0 + square * (2.0 / 21.0) * (1.0 + square / 10.0)))
    else:
        e = (1.0 - cot) / omega
    out[0, 0], out[0, 1], out[0, 2] = cot, -half, e * vx + 0.5 * vy
    out[1, 0], out[1, 1], out[1, 2] = half, cot, e * vy - 0.5 * vx
    out[2, 0], out[2, 1], out[2, 2] = 0.0, 0.0, 1.0


@kernel
def adjoint(pose: Array, out: Array) -> None:
    """Write Ad (3, 3) with T exp(d) T^-1 = exp(Ad d) of a pose T (3,) to out."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    out[0, 0], out[0, 1], out[0, 2] = cos, -sin, pose[1]
    out[1, 0], out[1, 1], out[1, 2] = sin, cos, -pose[0]
    out[2, 0], out[2, 1], out[2, 2] = 0.0, 0.0, 1.0


@kernel
def cauchy(squared_error: float, scale: float) -> float:
    """Return the weight that the Cauchy kernel leaves to whitened rows of this squared length; inf is no kernel."""
    return 1.0 / (1.0 + squared_error / (scale * scale))
