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
    out[0] = seen.real
    out[1] = seen.imag
    out[2] = wrap(b[2] - a[2])


@kernel
def exp_onto(pose: Array, change: Array) -> None:
    """Perturb a pose (3,) by the tangent vector at the begin of a change (3 or more,): pose exp(change)."""
    half = 0.5 * change[2]
    chord = math.sin(half) / half if half != 0.0 else 1.0
    moved = position(pose) + rotation(pose[2] + half) * chord * complex(change[0], change[1])
    pose[0] = moved.real
    pose[1] = moved.imag
    pose[2] = wrap(pose[2] + change[2])


@kernel
def log(pose: Array, out: Array) -> None:
    """Write the tangent vector of a pose (3,) to out (3,): exp(out) = pose."""
    theta = wrap(pose[2])
    half = 0.5 * theta
    cot = half / math.tan(half) if half != 0.0 else 1.0
    x = pose[0]
    y = pose[1]
    out[0] = cot * x + half * y
    out[1] = cot * y - half * x
    out[2] = theta


@kernel
def adjoint(pose: Array, out: Array) -> None:
    """Write Ad (3, 3) with T exp(d) T^-1 = exp(Ad d) of a pose T (3,) to out."""
    cos = math.cos(pose[2])
    sin = math.sin(pose[2])
    out[0, 0] = cos
    out[0, 1] = -sin
    out[0, 2] = pose[1]
    out[1, 0] = sin
    out[1, 1] = cos
    out[1, 2] = -pose[0]
    out[2, 0] = 0.0
    out[2, 1] = 0.0
    out[2, 2] = 1.0


@kernel
def cauchy(squared_error: float, scale: float) -> float:
    """Return the weight that the Cauchy kernel leaves to whitened rows of this squared length; inf is no kernel."""
    return 1.0 / (1.0 + squared_error / (scale * scale))
