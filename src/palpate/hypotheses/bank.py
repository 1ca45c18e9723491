"""Hypotheses about one object, one row of every array for each, and the bank that holds them with their window."""

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array, Flags, Integers, changed
from palpate.estimation.rows import Indices, RowArrays
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.window import ContactWindow
from palpate.types.estimate import Origin

CONTRADICTION_FRAMES = 10
"""Frames over which contradictions by measured poses are remembered."""
OBSERVABLE_YAW_SIGMA = 0.05
"""[rad] standard deviation of a round object's yaw that a graph may know of."""
_KINDS_OF_CONTRADICTION = 3
_YAW_ONLY = np.diag([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Hypotheses(RowArrays):
    """State of B hypotheses, the best first."""

    belief: Belief
    """Belief about the object at the last frame, without its `unobservable_yaw`."""
    unobservable_yaw: Array
    """Variance of a round object's yaw that is kept out of the graph, (B,) [rad^2]."""
    displacement: Array
    """Least displacement of the object since it was last touched, (B,) [m]."""
    contradictions: Array
    """Distance of measured poses from the estimate, of the measured outline from the contact, and possible error by a
    variable that is implausible, at the last frames; 0 where all agrees, (B, 3, CONTRADICTION_FRAMES) [m]."""
    log_prior: Array
    """Log probability without the current contact, (B,)."""
    weight: Array
    """Probability among all hypotheses, (B,)."""
    touch_sign: Array
    """-1.0 if touch images are taken as mirrored, else 1.0, (B,)."""
    disturbed_steps_left: Integers
    """Steps for which something else may still move the object, (B,)."""
    next_alarm: Integers
    """First step of the contact at which an alarm is of something new, (B,)."""
    origin: NDArray[np.str_]
    """Event that added it, an `Origin`, (B,)."""

    def __len__(self) -> int:
        return len(self.weight)

    @property
    def whole_belief(self) -> Belief:
        """Belief with the unobservable yaw."""
        if not np.count_nonzero(self.unobservable_yaw):
            return self.belief
        return self.belief.inflated(self.unobservable_yaw[:, None, None] * _YAW_ONLY)

    @property
    def is_mirror_of_best(self) -> Flags:
        """True where touch images are taken the other way round than in the best hypothesis, (B,)."""
        return np.asarray(self.touch_sign != self.touch_sign[0])

    @property
    def has_mirrors(self) -> bool:
        """True if some take touch images the other way round than others."""
        return len(self) > 1 and bool(self.is_mirror_of_best.any())

    @property
    def origins(self) -> list[Origin]:
        """Origin of each hypothesis as seen from the best one, from which others may differ by how images lie."""
        own = cast("list[Origin]", self.origin.tolist())
        if len(own) == 1:
            return own
        differs = self.is_mirror_of_best.tolist()
        return ["mirrored images" if is_mirror else origin for origin, is_mirror in zip(own, differs, strict=True)]

    def with_yaw_held_out(self, is_observable: bool) -> "Hypotheses":
        """Return the same with a large variance of yaw kept out of the graph, unless it is observable.

        The graph would otherwise learn the yaw of a round object from its own linearisation errors.
        """
        whole = self.whole_belief
        if is_observable:
            return changed(self, belief=whole, unobservable_yaw=np.zeros(len(self)))
        variance = whole.covariance[:, 2, 2]
        held_out = np.maximum(variance - OBSERVABLE_YAW_SIGMA**2, 0.0)
        scale = np.ones(whole.covariance.shape[:2])
        scale[:, 2] = np.where(held_out > 0.0, OBSERVABLE_YAW_SIGMA / np.sqrt(variance), 1.0)
        covariance = whole.covariance * (scale[:, :, None] * scale[:, None, :])
        return changed(self, belief=changed(whole, covariance=covariance), unobservable_yaw=held_out)

    @property
    def is_only_one(self) -> bool:
        """True for a single hypothesis that nothing competes with."""
        return bool(self.weight[0] == 1.0 and self.log_prior[0] == 0.0 and self.origin[0] == "as before")

    def as_only_one(self) -> "Hypotheses":
        """Return a single hypothesis that is left as one that nothing else competes with."""
        return changed(self, weight=np.ones(1), log_prior=np.zeros(1), origin=origins(1, "as before"))

    def displaced(self, least: Array) -> "Hypotheses":
        """Return the same with objects that have moved by at least these distances (B,) [m]."""
        return changed(self, displacement=np.maximum(self.displacement, least))


def single_hypothesis(belief: Belief, touch_sign: float) -> Hypotheses:
    """Return one hypothesis, of which nothing is known but this belief."""
    return Hypotheses(
        belief,
        unobservable_yaw=np.zeros(1),
        displacement=np.zeros(1),
        contradictions=np.zeros((1, _KINDS_OF_CONTRADICTION, CONTRADICTION_FRAMES)),
        log_prior=np.zeros(1),
        weight=np.ones(1),
        touch_sign=np.full(1, touch_sign),
        disturbed_steps_left=np.zeros(1, np.int64),
        next_alarm=np.zeros(1, np.int64),
        origin=origins(1, "as before"),
    )


def origins(count: int, origin: Origin) -> NDArray[np.str_]:
    """Return an origin for some hypotheses, (count,)."""
    return np.full(count, origin)


class HypothesisBank:
    """Holds all hypotheses, the best first. To branch, prune and reorder them is to take rows."""

    def __init__(self, rows: Hypotheses) -> None:
        self.rows = rows
        """State of each hypothesis."""
        self.window: ContactWindow | None = None
        """The graph of the contact, in all hypotheses; None between contacts."""

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, indices: Indices) -> None:
        """Keep these hypotheses, in this order; one may be taken several times."""
        present = np.arange(len(self.rows))
        taken = present[indices]
        if taken.tolist() == present.tolist():
            return
        self.rows = self.rows.take(taken)
        if self.window is not None:
            self.window.take(taken)

    def drop_lost(self) -> None:
        """Drop the hypotheses that have no solution."""
        if self.window is not None and self.window.has_lost_rows:
            self.take(~self.window.rows["is_lost"])
