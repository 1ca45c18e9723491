"""Hypotheses about one object as rows of arrays, their weights, and the selection of those worth keeping.

Costs of steps and of unusual friction judge a hypothesis. Errors of neighbouring steps are much the same, so that only
a small share of the costs counts.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Array, Flags, Integers
from palpate.config import COST_SHARE, OBSERVABLE_YAW, POOR, RECENT, STAYS, Priors
from palpate.estimation.rows import RowArrays
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.priors import object_prior


@dataclass(eq=False)
class Hypotheses(RowArrays):
    """State of B hypotheses, the best first."""

    belief: Belief
    """Belief about the object at the last frame, without its `unobservable_yaw`."""
    unobservable_yaw: Array
    """Variance of a round object's yaw that is kept out of the graph, (B,) [rad^2]."""
    displacement: Array
    """Least displacement of the object since it was last touched [m], (B,)."""
    apart: Array
    """Distance of measured poses from the estimate, and of the measured outline from the contact, at the last frames;
    0 where they agree, (B, 2, RECENT) [m]."""
    log_prior: Array
    """Log probability without the current contact, (B,)."""
    weight: Array
    """Probability among all hypotheses, (B,)."""
    sign: Array
    """(B,) -1.0 if touch images are taken as mirrored."""
    disturbed_steps_left: Integers
    """Steps for which something else may still move the object, (B,)."""
    next_alarm: Integers
    """First step of the contact at which an alarm is of something new, (B,)."""

    @property
    def whole_belief(self) -> Belief:
        """Belief with the unobservable yaw."""
        return self.belief.inflated(self.unobservable_yaw[:, None, None] * np.diag([0.0, 0.0, 1.0]))

    def hold_out_yaw(self, is_observable: bool) -> None:
        """Keep a large variance of yaw out of the graph, unless it is observable.

        The graph would otherwise learn the yaw of a round object from its own linearisation errors.
        """
        whole = self.whole_belief
        variance = whole.covariance[:, 2, 2]
        held_out = np.zeros_like(variance) if is_observable else np.maximum(variance - OBSERVABLE_YAW**2, 0.0)
        less = np.ones(whole.covariance.shape[:2])
        less[:, 2] = np.where(held_out > 0.0, OBSERVABLE_YAW / np.sqrt(variance), 1.0)
        self.belief = replace(whole, covariance=whole.covariance * (less[:, :, None] * less[:, None, :]))
        self.unobservable_yaw = held_out

    def displace(self, least: Array) -> None:
        """Take the object as moved by at least these distances (B,) [m]."""
        self.displacement = np.maximum(self.displacement, least)


def single(belief: Belief, sign: float) -> Hypotheses:
    """Return one hypothesis."""
    zero, none = np.zeros(1), np.zeros(1, np.int64)
    return Hypotheses(
        belief,
        unobservable_yaw=zero,
        displacement=zero,
        apart=np.zeros((1, 2, RECENT)),
        log_prior=zero,
        weight=np.ones(1),
        sign=np.full(1, sign),
        disturbed_steps_left=none,
        next_alarm=none,
    )


def costs_of_contact(costs: Array) -> Array:
    """Return the share that counts of a contact's costs (B,), from those of its steps (B, N, 3); see `Window.costs`."""
    costs = costs[..., 0] + np.where(costs[..., 2].any(axis=0), 0.0, costs[..., 1])
    return COST_SHARE * costs.sum(axis=1)


def worth_keeping(rows: Hypotheses, costs: Array, priors: Priors, most: int) -> tuple[Integers, Array]:
    """Return up to `most` rows worth keeping, the best first, and their weights.

    None is poor or the same as a better one. The best stays the best until another one is far likelier.
    """
    unusual = np.sum(
        np.square((rows.belief.values - object_prior(priors).mean) / object_prior(priors).deviation), axis=1
    )
    scores = rows.log_prior - costs_of_contact(costs) - 0.5 * unusual
    relative = np.exp(scores - scores.max())
    is_settled = rows.disturbed_steps_left == 0
    is_alike = (rows.sign[:, None] == rows.sign) & is_settled[:, None] & is_settled
    near = is_alike & are_near(rows.belief.pose[:, None], rows.belief.pose[None])
    scores[0 if relative[0] > STAYS else relative.argmax()] = np.inf
    kept: list[int] = []
    for row in np.argsort(-scores).tolist():
        if relative[row] >= POOR and not near[row, kept].any():
            kept.append(row)
    kept = kept[:most]
    return np.array(kept), relative[kept] / sum(relative[kept])


def are_near(pose: Array, others: Array) -> Flags:
    """Return True (...) where poses (..., 3) and others (..., 3) are the same for all that matters."""
    x, y, turn = (pose[..., i] - others[..., i] for i in range(3))
    return (x * x + y * y < 2e-3**2) & (np.cos(turn) > math.cos(0.02))  # [m], [rad]
