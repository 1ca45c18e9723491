"""Planar poses as arrays: x [m], y [m], theta [rad] along the last axis.

Every function takes any leading axes and broadcasts them. `world_T_object` maps object coordinates to world
coordinates. A tangent vector has the order x, y, theta and sits on the right: T exp(xi).

Formulas: J. Sola, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in robotics", 2018,
example 3 and appendix C, written with the half angle h = theta / 2, which needs no series for exp and log:
V(theta) = sin(h) / h R(h), and sin(h) / h is accurate for every h but zero.
"""

import math
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array

Angle = TypeVar("Angle", float, Array)
Sigmas = tuple[float, float, float]
"""Standard deviations of a pose or of a motion [m, m, rad]."""

_TAU = 2.0 * math.pi
_TINY = 1e-300
_SERIES_BELOW = 0.1  # [rad]; below it the series is exact to rounding, and the closed form loses three digits


def wrap(angle: Angle) -> Angle:
    """Return the same angle [rad] in (-pi, pi], without rounding where the angle is already there."""
    if isinstance(angle, float):
        wrapped = math.remainder(angle, _TAU)
        return math.pi if wrapped == -math.pi else wrapped
    rest: Any = np.fmod(np.asarray(angle, dtype=np.float64), _TAU)
    not_above = np.where(rest > math.pi, rest - _TAU, rest)
    wrapped: Any = np.where(rest <= -math.pi, rest + _TAU, not_above)
    return wrapped + 0.0  # never a negative zero


def compose(a: ArrayLike, b: ArrayLike) -> Array:
    """Return a b: with a = world_T_object and b = object_T_sensor this is world_T_sensor."""
    ax, ay, a_theta = _split(a)
    bx, by, b_theta = _split(b)
    cos = np.cos(a_theta)
    sin = np.sin(a_theta)
    return _join(ax + cos * bx - sin * by, ay + sin * bx + cos * by, wrap(a_theta + b_theta))


def inverse(a: ArrayLike) -> Array:
    """Return a^-1."""
    x, y, theta = _split(a)
    cos = np.cos(theta)
    sin = np.sin(theta)
    return _join(-cos * x - sin * y, sin * x - cos * y, wrap(-theta))


def between(a: ArrayLike, b: ArrayLike) -> Array:
    """Return a^-1 b, the pose of b seen from a."""
    ax, ay, a_theta = _split(a)
    bx, by, b_theta = _split(b)
    cos = np.cos(a_theta)
    sin = np.sin(a_theta)
    x = bx - ax
    y = by - ay
    return _join(cos * x + sin * y, cos * y - sin * x, wrap(b_theta - a_theta))


def transform(pose: ArrayLike, points: ArrayLike) -> Array:
    """Return points (..., 2) [m], given in the frame of the pose, in its parent frame."""
    x, y, theta = _split(pose)
    px, py = _split(points)
    cos = np.cos(theta)
    sin = np.sin(theta)
    return _join(x + cos * px - sin * py, y + sin * px + cos * py)


def exp(xi: ArrayLike) -> Array:
    """Return the pose reached by the constant body velocity xi in unit time."""
    vx, vy, omega = _split(xi)
    half = 0.5 * omega
    chord = _chord_over_arc(half)
    a = chord * np.cos(half)
    b = chord * np.sin(half)
    return _join(a * vx - b * vy, b * vx + a * vy, wrap(omega))


def log(pose: ArrayLike) -> Array:
    """Return the tangent vector xi with exp(xi) = pose and its angle in (-pi, pi]."""
    x, y, theta = _split(pose)
    theta = wrap(theta)
    half = 0.5 * theta
    cot = _half_cot(half)
    return _join(cot * x + half * y, cot * y - half * x, theta)


def rotation(theta: ArrayLike) -> Array:
    """Return the rotation matrices (..., 2, 2) by theta [rad]."""
    cos = np.cos(theta)
    sin = np.sin(theta)
    return _matrices([[cos, -sin], [sin, cos]])


def adjoint(pose: ArrayLike) -> Array:
    """Return the matrices Ad (..., 3, 3) with T exp(xi) T^-1 = exp(Ad xi)."""
    x, y, theta = _split(pose)
    cos = np.cos(theta)
    sin = np.sin(theta)
    zero = np.zeros_like(theta)
    return _matrices([[cos, -sin, y], [sin, cos, -x], [zero, zero, zero + 1.0]])


def right_jacobian_inverse(xi: ArrayLike) -> Array:
    """Return J^-1 (..., 3, 3) with log(T exp(d)) = log(T) + J^-1 d to first order in d, at xi = log(T)."""
    vx, vy, omega = _split(xi)
    half = 0.5 * omega
    cot = _half_cot(half)
    square = half * half
    series = half / 6.0 * (1.0 + square / 15.0 * (1.0 + square * (2.0 / 21.0) * (1.0 + square / 10.0)))
    e = np.where(np.abs(omega) < _SERIES_BELOW, series, (1.0 - cot) * omega / (omega * omega + _TINY))
    zero = np.zeros_like(half)
    return _matrices([[cot, -half, e * vx + 0.5 * vy], [half, cot, e * vy - 0.5 * vx], [zero, zero, zero + 1.0]])


def interpolated(when: Array | float, time: Array, pose: Array) -> Array:
    """Return poses (M, 3) at times (M,) between poses (N, 3) at increasing times (N,), yaws the shorter way round.

    Before the first time they are the first pose, after the last time the last one.
    """
    x: Any = np.interp(when, time, pose[:, 0])
    y: Any = np.interp(when, time, pose[:, 1])
    theta: Any = np.interp(when, time, np.unwrap(pose[:, 2]))
    return np.stack((x, y, wrap(theta)), axis=-1)


def ellipses_95(pose: ArrayLike, covariance: ArrayLike) -> Array:
    """Return the ellipses that hold the objects' origins with 95 % probability, as closed lines (N, P, 2) [m].

    Covariances (N, 3, 3) are in the tangent space at poses (N, 3) (right, body frame).
    """
    square = 5.991  # 95 % of chi squared of two degrees of freedom
    values, vectors = np.linalg.eigh(np.asarray(covariance, dtype=np.float64)[..., :2, :2])
    half_axes = vectors * np.sqrt(square * np.maximum(values, 0.0))[..., None, :]
    circle = np.linspace(0.0, 2.0 * np.pi, 49)
    points = half_axes @ np.stack((np.cos(circle), np.sin(circle)))
    return transform(np.asarray(pose)[..., None, :], np.swapaxes(points, -1, -2))


def _split(array: ArrayLike) -> tuple[Any, ...]:
    """Return the parts along the last axis; for one pose Python floats, on which arithmetic is far faster."""
    array = np.asarray(array, dtype=np.float64)
    if array.ndim == 1:
        return tuple(array.tolist())
    return tuple(array[..., i] for i in range(array.shape[-1]))


def _join(*parts: Any) -> Array:
    """Return the parts stacked along a new last axis; the first has the shape to which all others broadcast."""
    first = parts[0]
    if isinstance(first, float):
        return np.array(parts)
    out = np.empty((*first.shape, len(parts)))
    for i, part in enumerate(parts):
        out[..., i] = part
    return out


def _matrices(rows: list[list[Any]]) -> Array:
    """Return the matrices whose elements, of one shape (...), are given in rows, as (..., rows, columns)."""
    matrices = np.array(rows)
    if matrices.ndim == 2:
        return matrices
    return np.ascontiguousarray(np.moveaxis(matrices, (0, 1), (-2, -1)))


def _chord_over_arc(half: Any) -> Any:
    """Return sin(h) / h of numbers or arrays, which is 1 at 0."""
    is_zero = half == 0.0
    return (np.sin(half) + is_zero) / (half + is_zero)


def _half_cot(half: Any) -> Any:
    """Return h / tan(h) of numbers or arrays, which is 1 at 0."""
    is_zero = half == 0.0
    return (half + is_zero) / (np.tan(half) + is_zero)
