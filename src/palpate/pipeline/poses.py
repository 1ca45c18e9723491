"""Poses with their standard deviations, as people read them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.geometry import se2

Array = NDArray[np.float64]


def world_sigma(pose: ArrayLike, covariance: ArrayLike) -> Array:
    """Return the standard deviations (3,) [m, m, rad] of a pose (3,) along the world's x and y, and of its yaw.

    The covariance (3, 3) is in the tangent space at the pose (right, body frame), order x, y, theta.
    """
    covariance = np.asarray(covariance, dtype=np.float64)
    rotation = se2.rotation(np.asarray(pose, dtype=np.float64)[2])
    position = rotation @ covariance[:2, :2] @ rotation.T
    return np.sqrt([position[0, 0], position[1, 1], covariance[2, 2]])


def pose_words(pose: ArrayLike, sigma: ArrayLike) -> str:
    """Return a pose (3,) [m, m, rad] with its standard deviations (3,), in mm and degrees."""
    in_words = np.array((1e3, 1e3, 180.0 / np.pi))
    x, y, yaw = np.asarray(pose) * in_words
    sigma_x, sigma_y, sigma_yaw = np.asarray(sigma) * in_words
    return f"x {x:.1f} ± {sigma_x:.1f} mm, y {y:.1f} ± {sigma_y:.1f} mm, yaw {yaw:.1f} ± {sigma_yaw:.1f}°"
