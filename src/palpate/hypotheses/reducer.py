"""Reducer: merges hypotheses that have come to the same pose, and drops those that are hardly likely."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Flags, Integers
from palpate.hypotheses.rows import Hypotheses
from palpate.models.pushing.contact_geometry import ContactModel

POOR_WEIGHT = 1e-3
"""Weight, relative to the likeliest, below which a hypothesis is dropped."""
_STAYS_BEST = 0.2
"""Weight, relative to the likeliest, above which the last best stays the best: near ties would swap in every frame."""
_SAME_POSITION = 2e-3
"""[m] between poses that are the same for all that matters."""
_SAME_YAW = 0.02
"""[rad] between such poses."""


class Reduction(NamedTuple):
    """Hypotheses that are worth keeping."""

    kept: Integers
    """Their rows (K,), the best first."""
    weights: Array
    """Probability of each among them, (K,)."""


def reduced(rows: Hypotheses, log_weights: Array, most: int, model: ContactModel) -> Reduction:
    """Return up to `most` hypotheses that are neither poor nor the same as a better one.

    `log_weights` (B,) are known up to a constant. The best stays the best until another one is far likelier.
    """
    relative = np.exp(log_weights - log_weights.max())
    best = 0 if relative[0] > _STAYS_BEST else int(relative.argmax())
    scores = log_weights.copy()
    scores[best] = np.inf
    poses = model.centroid_poses(rows.belief.pose)
    is_same = _may_be_merged(rows) & poses_agree(poses[:, None], poses[None])
    kept: list[int] = []
    for row in np.argsort(-scores).tolist():
        if relative[row] >= POOR_WEIGHT and not is_same[row, kept].any():
            kept.append(row)
    kept = kept[:most]
    return Reduction(np.array(kept), relative[kept] / sum(relative[kept]))


def _may_be_merged(rows: Hypotheses) -> Flags:
    """Return True (B, B) for pairs that take images the same way, and in which nothing else moves the object now."""
    is_settled = rows.disturbed_steps_left == 0
    takes_images_alike = rows.touch_sign[:, None] == rows.touch_sign
    return takes_images_alike & is_settled[:, None] & is_settled


def merged(rows: Hypotheses, most: int, model: ContactModel) -> Hypotheses:
    """Return up to `most` hypotheses of different poses, with the probability of all that have the same pose.

    The hypotheses must be in the order of their log priors, the likeliest first.
    """
    poses = model.centroid_poses(rows.belief.pose)
    log_prior = rows.log_prior.copy()
    left = np.arange(len(rows))
    kept: list[int] = []
    while len(left) and len(kept) < most:
        likeliest = left[0]
        is_same = poses_agree(poses[likeliest], poses[left])
        log_prior[likeliest] = np.logaddexp.reduce(rows.log_prior[left[is_same]])
        kept.append(int(likeliest))
        left = left[~is_same]
    return replace(rows, log_prior=log_prior).take(kept)


def poses_agree(pose: Array, others: Array) -> Flags:
    """Return True (...) where poses (..., 3) and others (..., 3) of centroids are the same for all that matters."""
    off = pose - others
    squared_distance = off[..., 0] * off[..., 0] + off[..., 1] * off[..., 1]
    return (squared_distance < _SAME_POSITION**2) & (np.cos(off[..., 2]) > math.cos(_SAME_YAW))
