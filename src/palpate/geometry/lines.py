"""Closed lines that figures and views draw: outlines, and the ellipses of covariances."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import Shape

Array = NDArray[np.float64]

_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 49)


def closed_outline(shape: Shape) -> Array:
    """Return the outline (P, 2) [m] in the object frame, its last point the first again."""
    outline = shape.outline(100)
    return np.concatenate((outline, outline[:1]))


def half_axes_95(covariance: ArrayLike) -> Array:
    """Return the half axes (N, 2, 2), in columns, of the ellipses that hold the objects' origins with 95 % probability.

    They are in the frame of the pose that covariances (N, 3, 3) are of: tangent space there, right, body frame.
    """
    square = 5.991  # 95 % of chi squared of two degrees of freedom
    values, vectors = np.linalg.eigh(np.asarray(covariance, dtype=np.float64)[..., :2, :2])
    return vectors * np.sqrt(square * np.maximum(values, 0.0))[..., None, :]


def ellipses_95(pose: ArrayLike, covariance: ArrayLike) -> Array:
    """Return these ellipses about poses (N, 3) as closed lines (N, P, 2) [m] in the world."""
    points = half_axes_95(covariance) @ np.stack((np.cos(_CIRCLE), np.sin(_CIRCLE)))
    return se2.transform(np.asarray(pose)[..., None, :], np.swapaxes(points, -1, -2))
