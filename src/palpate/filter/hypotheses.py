"""Hypotheses about one object as rows of arrays, their weights, and which of them are worth keeping.

A hypothesis is judged by the costs of its steps, without pushing in steps in which any of them ignores it, and by the
cost of unusual friction. Errors of neighbouring steps are much the same, so that only a small share of the costs counts
and no single step decides.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.config import Priors
from palpate.filter.consistency import Consistency
from palpate.filter.contact_hypotheses import MOST_YOUNG, are_near
from palpate.filter.paths import Paths, no_paths
from palpate.graph.belief import Belief, RowArrays

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]

POOR = 1e-3
"""Weight, relative to the best hypothesis, below which one hardly counts."""
_GRACE = 25  # frames after which a poor hypothesis goes
_COST_SHARE, _MOST_OF_A_STEP = 0.1, 10.0  # share of the costs that counts; largest cost of a step beyond the best one's
_PRIOR_SHARE = 0.3  # share of the cost of unusual friction that counts, since the prior is that of some objects only
_NEW, _YOUNG = 4, 12  # frames in which a hypothesis is not compared with others, and in which there may be many
_LOST = 2.0  # [m] standard deviation at which a solution has diverged


@dataclass(frozen=True, eq=False)
class Hypotheses(RowArrays):
    """State of B hypotheses, the best first."""

    belief: Belief
    """Belief about the object at the last frame, without its `unobservable_yaw`."""
    unobservable_yaw: Array
    """Variance of a round object's yaw that is kept out of the graph, (B,) [rad^2]."""
    consistency: Consistency
    """State of the consistency tests."""
    log_prior: Array
    """Log probability without the current contact, (B,)."""
    weight: Array
    """Probability among all hypotheses, (B,)."""
    sign: Array
    """(B,) -1.0 if touch images are taken as mirrored."""
    is_mirror: Flags
    """True for the second group of hypotheses that takes images as mirrored, until this is decided, (B,)."""
    age: Counts
    """Frames of contact since it was added, (B,)."""
    disturbed_steps_left: Counts
    """Steps for which something else may still move the object, (B,)."""
    next_alarm: Counts
    """First step of the contact at which an alarm is of something new, (B,)."""
    ignored_motion: Flags
    """True in steps of the contact in which pushing is ignored, (B, N) for the steps of `Window.costs`."""
    path: Paths
    """Poses up to the current window, (B,)."""
    online: Paths
    """Poses in the current contact as they were estimated at their frames, (B,)."""

    def __len__(self) -> int:
        return len(self.weight)

    @staticmethod
    def one(belief: Belief, sign: float) -> "Hypotheses":
        """Return a single hypothesis."""
        no, none = np.zeros(1, np.bool_), np.zeros(1, np.int64)
        return Hypotheses(
            belief,
            unobservable_yaw=np.zeros(1),
            consistency=Consistency.begin(1),
            log_prior=np.zeros(1),
            weight=np.ones(1),
            sign=np.full(1, sign),
            is_mirror=no,
            age=none,
            disturbed_steps_left=none,
            next_alarm=none,
            ignored_motion=np.zeros((1, 0), np.bool_),
            path=no_paths(1),
            online=no_paths(1),
        )

    @property
    def whole_belief(self) -> Belief:
        """Belief with the unobservable yaw."""
        return self.belief.inflated(self.unobservable_yaw[:, None, None] * np.diag([0.0, 0.0, 1.0]))

    @property
    def is_lost(self) -> Flags:
        """True where the solution has diverged, (B,)."""
        variances = np.diagonal(self.belief.pose_covariance, axis1=1, axis2=2)
        return np.any(variances[:, :2] > _LOST**2, axis=1)


def costs_of_contact(rows: Hypotheses, costs: Array) -> Array:
    """Return the share that counts of a contact's costs (B,), from those of its steps (B, N, 2); see `Window.costs`."""
    costs = costs.copy()
    costs[:, rows.ignored_motion.any(axis=0), 1] = 0.0
    costs = costs.sum(axis=2)
    return _COST_SHARE * np.minimum(costs, costs.min(axis=0) + _MOST_OF_A_STEP).sum(axis=1)


def worth_keeping(rows: Hypotheses, costs: Array, priors: Priors, most: int) -> tuple[Counts, Array]:
    """Return the rows that are worth keeping, the best first, and their weights.

    None of them is poor, the same as a better one, or one too many. While all are young there may be as many as at the
    beginning of a contact.
    """
    if len(rows) == 1:
        return np.zeros(1, np.int64), np.ones(1)
    unusual = np.sum(np.square((rows.belief.values - priors.mean) / priors.deviation), axis=1)
    scores = rows.log_prior - costs_of_contact(rows, costs) - 0.5 * _PRIOR_SHARE * unusual
    if not (lost := rows.is_lost).all():
        scores[lost] = -np.inf  # they may come back
    relative = np.exp(scores - scores.max())
    is_poor = (rows.age > _GRACE) & (relative < POOR)
    is_settled = rows.disturbed_steps_left == 0
    is_compared = is_settled & (rows.age >= _NEW)
    near = are_near(rows.belief.pose[:, None], rows.belief.pose[None])
    kept: list[int] = []
    for row in np.argsort(-scores):
        is_same = is_compared[row] and any(near[row, better] and is_settled[better] for better in kept)
        if not is_poor[row] and not is_same:
            kept.append(int(row))
    if (rows.age[kept] <= _YOUNG).all():
        most = max(most, MOST_YOUNG)
    kept = kept[:most]
    return np.array(kept), relative[kept] / sum(relative[kept])
