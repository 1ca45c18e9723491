"""What several hypotheses say together: all poses that may be the object's, how far these are apart, and how likely."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.filter.weighing import POOR, Hypothesis
from palpate.geometry import se2
from palpate.types.estimate import Answer

Array = NDArray[np.float64]

LIKELY_WEIGHT = 0.1
"""Weight from which a hypothesis counts: is watched, or makes an estimate ambiguous."""
_APART = np.array([0.01, 0.01, 0.09])  # [m, m, rad]


def answers_of(hypotheses: Sequence[Hypothesis]) -> tuple[Answer, ...]:
    """Return those that have weight as answers, in their order."""
    return tuple(
        Answer(one.estimator.known.pose.copy(), one.estimator.covariance, one.weight)
        for one in hypotheses
        if one.weight
    )


def joint_covariance(hypotheses: Sequence[Hypothesis]) -> Array:
    """Return the covariance (3, 3) of all about the first, the best, tangent space at its pose (right, body frame)."""
    if len(hypotheses) == 1:
        return hypotheses[0].estimator.covariance
    total = np.zeros((3, 3))
    for one, apart in zip(hypotheses, _from_best(hypotheses), strict=True):
        total += one.weight * (one.estimator.covariance + np.outer(apart, apart))
    return total


def is_ambiguous(hypotheses: Sequence[Hypothesis]) -> bool:
    """Return whether another than the best is likely and far from it, or all together are spread out."""
    if sum(one.weight > 0.0 for one in hypotheses) < 2:
        return False
    is_likely = np.array([one.weight > LIKELY_WEIGHT for one in hypotheses])
    is_far = (np.abs(_from_best(hypotheses)) > _APART).any(axis=1)
    return bool((is_likely & is_far).any() or (np.diagonal(joint_covariance(hypotheses)) > _APART**2).any())


def ambiguity_in_words(hypotheses: Sequence[Hypothesis]) -> str:
    """Say how many fit and how far they are apart; nothing where there is one."""
    apart = np.abs(_from_best(hypotheses)[[one.weight > 0.5 * POOR for one in hypotheses]])
    if len(apart) < 2:
        return ""
    far, turned = 1e3 * np.hypot(apart[:, 0], apart[:, 1]).max(), np.degrees(apart[:, 2].max())
    return f"{len(apart)} poses up to {far:.0f} mm and {turned:.0f} degrees from the best fit what was measured"


def _from_best(hypotheses: Sequence[Hypothesis]) -> Array:
    """How far the pose of each is from that of the best (H, 3), tangent space there."""
    poses = np.array([one.estimator.known.pose for one in hypotheses])
    return se2.log(se2.between(poses[0], poses))
