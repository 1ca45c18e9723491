"""Reducer: merges hypotheses that have come to the same pose, and drops those that are hardly likely."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Integers
from palpate.compiled import compiled
from palpate.hypotheses.bank import Hypotheses
from palpate.manifolds.se2_kernels import position, rotation
from palpate.models.pushing.contact_geometry import ContactModel

POOR_WEIGHT = 1e-3
"""Weight, relative to the likeliest, below which a hypothesis is dropped."""
_STAYS_BEST = 0.2
"""Weight, relative to the likeliest, above which the last best stays the best: near ties would swap in every frame."""
_SAME_POSITION = 2e-3
"""[m] between poses that are the same for all that matters."""
_SAME_COSINE = math.cos(0.02)
"""Cosine of the angle between such poses."""


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
    order = np.argsort(-scores)
    # Those that take images differently, or in which something else moves the object now, stay apart.
    kind = np.where(rows.disturbed_steps_left == 0, rows.touch_sign, np.nan)
    is_first = _representatives(rows, order, kind, model) == order
    kept = order[is_first & (relative[order] >= POOR_WEIGHT)][:most]
    weights = relative[kept]
    return Reduction(kept, weights / weights.sum())


def merged(rows: Hypotheses, most: int, model: ContactModel) -> Hypotheses:
    """Return up to `most` hypotheses of different poses, with the probability of all that have the same pose.

    The hypotheses must be in the order of their log priors, the likeliest first.
    """
    order = np.arange(len(rows))
    representatives = _representatives(rows, order, np.zeros(len(rows)), model)
    kept = np.flatnonzero(representatives == order)[:most]
    log_prior = rows.log_prior.copy()
    for row in kept.tolist():
        log_prior[row] = np.logaddexp.reduce(rows.log_prior[representatives == row])
    return replace(rows, log_prior=log_prior).take(kept)


def _representatives(rows: Hypotheses, order: Integers, kind: Array, model: ContactModel) -> Integers:
    """Return the first row in an order (B,) that is the same as each of its rows for all that matters, (B,).

    Rows of different kinds (B,) are never the same, and one whose kind is NaN is like no other.
    """
    first = np.empty(len(rows), np.int64)
    _put_representatives(rows.belief.pose, model.friction_center, kind, order, first)
    return first


@compiled(np.zeros((1, 3)), 0j, np.zeros(1), np.zeros(1, np.int64), np.zeros(1, np.int64))
def _put_representatives(poses: Array, center: complex, kind: Array, order: Integers, first: Integers) -> None:
    """Write the first row that is the same as each, both in an order."""
    for i in range(len(order)):
        row = order[i]
        first[i] = row
        centroid = position(poses[row]) + rotation(poses[row, 2]) * center
        for k in range(i):
            other = order[k]
            if first[k] == other and kind[row] == kind[other]:
                off = centroid - position(poses[other]) - rotation(poses[other, 2]) * center
                is_near = off.real**2 + off.imag**2 < _SAME_POSITION**2
                if is_near and math.cos(poses[row, 2] - poses[other, 2]) > _SAME_COSINE:
                    first[i] = other
                    break
