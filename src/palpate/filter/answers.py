"""Answers: all hypotheses as poses of the object, their spread and their ambiguity. Rows are best first."""

import numpy as np
from numpy.typing import NDArray

from palpate.filter.hypotheses import POOR
from palpate.geometry import se2
from palpate.types.estimate import Answer

Array = NDArray[np.float64]

LIKELY = 0.1
"""Weight from which a hypothesis makes an estimate ambiguous, and is watched for disturbances."""
_APART = np.array([0.01, 0.01, 0.09])  # [m, m, rad] distance between ambiguous poses


def answers_of(poses: Array, covariances: Array, weights: Array) -> tuple[Answer, ...]:
    """Return the hypotheses (B, ...) that have weight as answers."""
    rows = np.flatnonzero(weights)
    return tuple(Answer(poses[row].copy(), covariances[row].copy(), float(weights[row])) for row in rows)


def joint_covariance(poses: Array, covariances: Array, weights: Array) -> Array:
    """Return the covariance (3, 3) of all hypotheses about the best, tangent space at its pose (right, body frame)."""
    if len(poses) == 1:
        return covariances[0]
    total = np.zeros((3, 3))
    for weight, covariance, apart in zip(weights, covariances, _from_best(poses), strict=True):
        total += weight * (covariance + np.outer(apart, apart))
    return total


def is_ambiguous(poses: Array, covariances: Array, weights: Array) -> bool:
    """Return True if another hypothesis is likely and far from the best, or if all together are spread out."""
    if np.count_nonzero(weights > 0.0) < 2:
        return False
    is_far = (np.abs(_from_best(poses)) > _APART).any(axis=1)
    is_spread = (np.diagonal(joint_covariance(poses, covariances, weights)) > _APART**2).any()
    return bool(((weights > LIKELY) & is_far).any() or is_spread)


def ambiguity_in_words(poses: Array, weights: Array) -> str:
    """Return how many poses fit and how far they are apart; empty if there is one."""
    apart = np.abs(_from_best(poses)[weights > 0.5 * POOR])
    if len(apart) < 2:
        return ""
    far, turned = 1e3 * np.hypot(apart[:, 0], apart[:, 1]).max(), np.degrees(apart[:, 2].max())
    return f"{len(apart)} poses up to {far:.0f} mm and {turned:.0f} degrees from the best fit what was measured"


def _from_best(poses: Array) -> Array:
    """Return each pose (B, 3) in the tangent space at the first one."""
    return se2.log(se2.between(poses[0], poses))
