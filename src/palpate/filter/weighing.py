"""How likely hypotheses are beside one another, and which of them are worth keeping.

A hypothesis is judged by what its steps cost (`Window.costs`), pushing left out in steps in which any of them lets go
of it, and by how odd the friction is that it needs. Errors of neighbouring steps are much the same error, so that costs
count in small part only, and no step decides by itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.config import Normal, Priors
from palpate.filter.contact_hypotheses import MOST_YOUNG, are_near
from palpate.filter.estimator import Estimator
from palpate.graph.variables import GRIP, IN_OBJECT

Array = NDArray[np.float64]

SLIPPERY: Normal = (0.15, 0.05)
"""Grip of a smooth tip: where it slides, a hypothesis with more grip is lost."""
POOR = 1e-3
"""Weight against the best one's from which a hypothesis hardly counts."""
_GRACE = 25  # frames after which one that is poor goes
_COUNTS = 0.1  # share of costs that counts, for those of neighbouring steps are much the same
_MOST_OF_A_STEP = 10.0  # what a step may cost one hypothesis more than the best
_PRIOR_COUNTS = 0.3  # share of what odd friction costs, for the prior is that of some objects only
_NEW = 4  # frames in which a hypothesis is not yet compared with others
_YOUNG = 12  # frames of a contact in which there may be as many as it may begin with
_LOST = 2.0  # [m] standard deviation from which a graph holds on to nothing: its solution has run away


@dataclass(eq=False)
class Hypothesis:
    """An estimator that takes some things to be true."""

    estimator: Estimator
    """What it makes of all that is measured."""
    log_prior: float = 0.0
    """Log of how likely it is without this contact."""
    without_pushing: list[tuple[int, int]] = field(default_factory=list)
    """Steps of this contact, from one to before another, in which nothing of pushing holds."""
    knock_steps_left: int = 0
    """Steps for which something may move the object on, so that nothing of pushing holds in them either."""
    next_alarm_from: int = 0
    """Step of this contact from which an alarm is of something new."""
    slippery: bool = False
    """Whether the contact is taken to be more slippery than was thought."""
    age: int = 0
    """Frames of contact since it was added."""
    weight: float = 1.0
    """How likely it is among all, from 0 to 1."""


class Weighing:
    """Weighs the hypotheses of one object by what is usual for it."""

    def __init__(self, priors: Priors) -> None:
        """Take what is usual of its friction and all else that belongs to it."""
        self._usual = priors.mean, priors.deviation
        self._slippery = priors.mean, priors.deviation
        for part, value in zip(self._slippery, SLIPPERY, strict=True):
            part[IN_OBJECT[GRIP]] = value

    def scores(self, hypotheses: Sequence[Hypothesis], steps: int) -> Array:
        """Return the log of how likely each is, but for a constant, after so many steps of a contact."""
        costs = np.array([one.estimator.costs() for one in hypotheses])
        forgotten = steps - costs.shape[1]
        for one in hypotheses:
            for first, end in one.without_pushing:
                costs[:, max(first - forgotten, 0) : max(end - forgotten, 0), 1] = 0.0
        costs = costs.sum(axis=2)
        costs = np.minimum(costs, costs.min(axis=0) + _MOST_OF_A_STEP).sum(axis=1)
        return np.array(
            [one.log_prior - _COUNTS * cost - self.oddness(one) for one, cost in zip(hypotheses, costs, strict=True)]
        )

    def oddness(self, one: Hypothesis) -> float:
        """Return what it costs that friction and all else that belongs to the object is unlike its prior."""
        mean, deviation = self._slippery if one.slippery else self._usual
        return 0.5 * _PRIOR_COUNTS * float(np.sum(np.square((one.estimator.known.values - mean) / deviation)))

    def kept(self, hypotheses: Sequence[Hypothesis], steps: int, most: int) -> list[Hypothesis]:
        """Return those worth keeping, weighed, the best first: none is poor, the same as a better one or one too many.

        Where all are young there may be as many as a contact may begin with, whatever `most` is.
        """
        scores = self.scores(hypotheses, steps)
        lost = np.array([is_lost(one) for one in hypotheses])
        if not lost.all():
            scores[lost] = -np.inf  # they may come back
        poses = np.array([one.estimator.known.pose for one in hypotheses])
        is_compared = np.zeros(len(hypotheses), np.bool_)  # with those that are worse
        kept: list[Hypothesis] = []
        for index in np.argsort(-scores):
            one = hypotheses[index]
            one.weight = float(np.exp(scores[index] - scores.max()))
            is_poor = one.age > _GRACE and one.weight < POOR
            is_new = one.knock_steps_left or one.age < _NEW
            is_same = not is_new and are_near(poses[index], poses[is_compared]).any()
            if not is_poor and not is_same:
                is_compared[index] = not one.knock_steps_left
                kept.append(one)
        is_young = all(one.age <= _YOUNG for one in kept)
        kept = kept[: max(most, MOST_YOUNG) if is_young else most]
        total = sum(one.weight for one in kept)
        for one in kept:
            one.weight /= total
        return kept


def shared_out(hypotheses: Sequence[Hypothesis], most: int) -> list[Hypothesis]:
    """Return those likeliest by their `log_prior`, the best first, and weigh them by it."""
    best = sorted(hypotheses, key=lambda one: -one.log_prior)[:most]
    likely = np.exp([one.log_prior - best[0].log_prior for one in best])
    for one, weight in zip(best, likely / likely.sum(), strict=True):
        one.weight = float(weight)
    return best


def is_lost(one: Hypothesis) -> bool:
    """Return whether the graph of a hypothesis holds on to nothing."""
    return bool((np.diagonal(one.estimator.known.pose_covariance)[:2] > _LOST**2).any())
