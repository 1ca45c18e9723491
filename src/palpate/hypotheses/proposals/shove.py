"""Proposal at an alarm: something else has moved the object while it was touched, by one of several slides.

An alarm is a contradiction between touch and pushing. The hypothesis in which nothing happened is kept.
"""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from palpate.arrays import Array, Flags, Integers
from palpate.estimation.model import Model
from palpate.hypotheses.bank import Hypotheses, origins
from palpate.hypotheses.weigher import LIKELY_WEIGHT
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.hand import names_of
from palpate.models.pushing.window import ContactWindow

SHOVE_SIGMA = 0.012
"""[m] standard deviation of the slide over the sensor by which a hand moves the object."""
STEPS_BEFORE_ALARM = 10
"""Steps before an alarm in which a hand may have moved the object: a shove lasts half a second."""
STEPS_AFTER_ALARM = 6
"""Steps after an alarm in which it may still move it."""
_SLIDES = np.array((0.0, 0.018, -0.018, 0.036, -0.036))
"""[m] slides that become hypotheses, at steps of 1.5 SHOVE_SIGMA."""
ALARM_LIMITS = {"contact": 0.3, "direction": 0.2, "place": 0.2, "turn": 0.3}
"""Mean squares of the innovations of the last steps [variances] from which something else may have moved the object.
Where nothing did, directions reach theirs 2.6 times a minute of contact, others less (`docs/study/alarms.json`)."""


@dataclass(frozen=True, eq=False)
class Shove:
    """K hypotheses that something else has moved the object, to be added after B others."""

    parents: Integers
    """Row of the hypothesis that each is a copy of at first, (K,)."""
    slides: Array
    """Slide of the object over the sensor, counter-clockwise along the outline, (K,) [m]."""

    def taken(self, count: int) -> Integers:
        """Return the rows to take: all B hypotheses, and the parents of those that are added."""
        return np.concatenate([np.arange(count), self.parents])

    def added(self, count: int) -> Integers:
        """Return the rows (K,) of those that are added to B hypotheses."""
        return np.arange(count, count + len(self.parents))


def disturbance_alarms(window: ContactWindow) -> Flags:
    """Return True (B,) where touch and pushing contradict each other."""
    return np.asarray((window.rows["surprise"] > _limits(window.model)).any(axis=1))


@cache
def _limits(model: Model) -> Array:
    """Return the limit of each factor's mean square, (K,); infinite for those that are not watched."""
    limits = np.full(len(model.names), np.inf)
    for name, limit in ALARM_LIMITS.items():
        for own in names_of([name], model):
            limits[model.names.index(own)] = limit
    return limits


def propose_shove(rows: Hypotheses, alarms: Flags, step: int) -> Shove | None:
    """Return the hypotheses to add at a step of the contact, given alarms (B,); None if there is no new alarm.

    They are added to the likeliest hypothesis that has a new alarm, and to the likeliest that takes images the other
    way. A contradiction of the less likely way to take images speaks against it, not for a disturbance.
    """
    if not np.count_nonzero(alarms):
        return None
    is_likely = rows.weight > LIKELY_WEIGHT
    is_settled = (rows.disturbed_steps_left == 0) & (step >= rows.next_alarm)
    alarmed = np.flatnonzero(alarms & is_likely & is_settled & ~rows.is_mirror_of_best)
    if not len(alarmed):
        return None
    mirrors = np.flatnonzero(is_likely & rows.is_mirror_of_best)
    parents = np.concatenate([alarmed[:1], mirrors[:1]])
    return Shove(np.repeat(parents, len(_SLIDES)), np.tile(_SLIDES, len(parents)))


def shoved(rows: Hypotheses, shove: Shove, belief: Belief, step: int, expected_shoves: float) -> Hypotheses:
    """Return hypotheses, the last of which are those of a shove, that the window has solved with their slides.

    `rows` are those of `Shove.taken`, `belief` that of the window. `expected_shoves` is their number in the steps for
    which something else may have moved the object, each slide being as likely as another.
    """
    count = len(rows) - len(shove.parents)
    is_new = np.arange(len(rows)) >= count
    alarms = rows.next_alarm.copy()
    alarms[shove.parents] = step + STEPS_BEFORE_ALARM + STEPS_AFTER_ALARM
    alarms[is_new] = step + STEPS_BEFORE_ALARM + STEPS_AFTER_ALARM
    return replace(
        rows,
        belief=rows.belief.take(~is_new).joined(belief.take(is_new)),
        log_prior=rows.log_prior + is_new * math.log(expected_shoves / len(_SLIDES)),
        weight=np.where(is_new, 1.0, rows.weight),
        disturbed_steps_left=np.where(is_new, STEPS_AFTER_ALARM, rows.disturbed_steps_left),
        next_alarm=alarms,
        origin=np.where(is_new, origins(len(rows), "shove"), rows.origin),
    )
