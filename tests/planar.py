"""Planar poses (x, y, theta) by complex numbers: an oracle apart from `palpate.geometry.se2`."""

from typing import Any

import numpy as np


def wrap(angle: Any) -> Any:
    """Return the angle in (-pi, pi]."""
    return np.angle(np.exp(1j * np.asarray(angle)))


def compose(a: Any, b: Any) -> Any:
    """Return a_T_c from a_T_b and b_T_c (..., 3)."""
    a, b = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float))
    at = a[..., 0] + 1j * a[..., 1] + (b[..., 0] + 1j * b[..., 1]) * np.exp(1j * a[..., 2])
    return np.stack([at.real, at.imag, wrap(a[..., 2] + b[..., 2])], axis=-1)


def inverse(a: Any) -> Any:
    """Return b_T_a from a_T_b (..., 3)."""
    a = np.asarray(a, float)
    at = -(a[..., 0] + 1j * a[..., 1]) * np.exp(-1j * a[..., 2])
    return np.stack([at.real, at.imag, wrap(-a[..., 2])], axis=-1)


def between(a: Any, b: Any) -> Any:
    """Return b seen from a (..., 3)."""
    return compose(inverse(a), b)


def exp(xi: Any) -> Any:
    """Return the pose to which a constant twist (..., 3) leads in a unit of time."""
    xi = np.asarray(xi, float)
    at = (xi[..., 0] + 1j * xi[..., 1]) * _chord(xi[..., 2])
    return np.stack([at.real, at.imag, wrap(xi[..., 2])], axis=-1)


def log(pose: Any) -> Any:
    """Return the twist (..., 3) that leads to a pose in a unit of time."""
    pose = np.asarray(pose, float)
    at = (pose[..., 0] + 1j * pose[..., 1]) / _chord(pose[..., 2])
    return np.stack([at.real, at.imag, pose[..., 2]], axis=-1)


def _chord(angle: Any) -> Any:
    """Return the chord over the arc of a turn by an angle."""
    small = np.abs(angle) < 1e-12
    return np.where(small, 1.0 + 0.0j, np.expm1(1j * angle) / np.where(small, 1j, 1j * angle))


def transform(pose: Any, points: Any) -> Any:
    """Return points (..., 2) of the frame of a pose in its parent frame."""
    points = np.asarray(points, float)
    return compose(pose, np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1))[..., :2]


def gaps(recording: Any) -> Any:
    """Return the distance of a round tip's surface from the outline (N,) [m], NaN without ground truth."""
    centers = np.array(recording.sensor.tips) - [recording.sensor.radius, 0.0]
    seen = transform(between(recording.object_pose, recording.sensor_pose)[:, None], centers)
    return recording.shape.signed_distance(seen).min(axis=1) - recording.sensor.radius
