"""Weigher: the probability of each hypothesis, by the costs of its steps and how usual its object is.

Errors of neighbouring steps are much the same, so that only a share of the costs counts.
"""

import numpy as np

from palpate.arrays import Array
from palpate.compiled import compiled
from palpate.hypotheses.bank import Hypotheses
from palpate.models.pushing.priors import ObjectPrior

LIKELY_WEIGHT = 0.1
"""Weight from which a hypothesis is likely: it makes an estimate ambiguous, and is watched for disturbances."""
_COUNTED_SHARE = 0.3
"""Share of the costs that counts: weights are then right as often as they say."""


class Weigher:
    """Weighs hypotheses against each other."""

    def __init__(self, prior: ObjectPrior) -> None:
        self._prior = prior

    def log_weights(self, rows: Hypotheses, step_costs: Array) -> Array:
        """Return the log probability of each hypothesis (B,), up to a constant.

        It is that before the contact, less the cost of the contact's steps (B, N, 3), see `Window.costs`, and half the
        squared distance of the object's variables from their priors [variances].
        """
        off = (rows.belief.values - self._prior.mean) / self._prior.deviation
        unusual = np.sum(np.square(off), axis=1)
        return rows.log_prior - cost_of_contact(step_costs) - 0.5 * unusual


def cost_of_contact(step_costs: Array) -> Array:
    """Return the share that counts of a contact's costs (B,), from those of its steps (B, N, 3); see `Window.costs`.

    Where one hypothesis ignores pushing in a step, the cost of pushing in it counts for none.
    """
    counted = np.zeros(len(step_costs))
    _add_costs(np.ascontiguousarray(step_costs), counted)
    return _COUNTED_SHARE * counted


@compiled(np.zeros((1, 1, 1)), np.zeros(1))
def _add_costs(step_costs: Array, counted: Array) -> None:
    """Add up the costs (B, N, 3) of all steps that count (B,)."""
    rows, steps, _ = step_costs.shape
    for step in range(steps):
        is_ignored = False
        for row in range(rows):
            is_ignored |= step_costs[row, step, 2] != 0.0
        for row in range(rows):
            counted[row] += step_costs[row, step, 0]
            if not is_ignored:
                counted[row] += step_costs[row, step, 1]
