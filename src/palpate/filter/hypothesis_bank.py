"""Several answers at once, weighed by what is measured, where one graph cannot know which of them is right.

A hypothesis is an `Estimator`. While nothing is doubtful there is one. Others are added, and the one in which nothing
happened is kept, where

- touch and pushing fit one another badly: something else may have moved the object; see `disturbed`;
- a contact begins with an object that is known roughly only: the sensor meets it at another place in each; see
  `beginning`;
- a contact that was brief began where nothing should be: it may have been none.

`weighing` says how likely each is.
"""

import logging
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings
from palpate.errors import EstimationError
from palpate.filter.answers import (
    LIKELY_WEIGHT,
    ambiguity_in_words,
    answers_of,
    is_ambiguous,
    joint_covariance,
)
from palpate.filter.belief import Prior
from palpate.filter.consistency import REASONS, Status
from palpate.filter.contact_hypotheses import MOST_YOUNG, Beginning, log_sum, ways_to_begin, ways_to_begin_unfound
from palpate.filter.contact_poses import is_rough, outline_places
from palpate.filter.disturbance import (
    AHEAD,
    ALARM_DEAD_STEPS,
    SPREAD,
    STILL_GOING_ON,
    is_contradicted,
    is_doubtful,
    knock_hypotheses,
)
from palpate.filter.estimator import Estimator, touch_on
from palpate.filter.touched import Touched
from palpate.filter.weighing import Hypothesis, Weighing, is_lost, shared_out
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.smoother import IN_A_WINDOW, BeginContact, SmootherName
from palpate.types.estimate import Answer
from palpate.types.measurements import Measurement

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]

_BRIEF = 0.48  # [s] up to which a touch may have been none: 15 frames at 30 Hz, however their stamps jitter


class Hypotheses:
    """Estimates the pose of one object as several estimators do that take other things to be true."""

    def __init__(
        self,
        model: ContactModel,
        settings: NoiseSettings,
        smoother: SmootherName,
        first_pose: Array,
        first_deviation: Array,
        most: int,
    ) -> None:
        """Take what an Estimator takes, and how many hypotheses there may be at most.

        There is one, whatever happens, with smoothers that cannot let go of a step.
        """
        self._model, self._settings = model, settings
        self._most = most if smoother in IN_A_WINDOW else 1
        self._all = [Hypothesis(Estimator(model, settings, smoother, first_pose, first_deviation))]
        self._is_found = not is_rough(self.known, self._model)  # once there was one sure answer
        self._steps = 0  # of this contact
        self._untouched: list[Hypothesis] = []  # what there was before it, if nothing was displaced then
        if self._most > 1:
            outline_places(model)  # found now, not when a contact begins
        self._weighing = Weighing(settings.priors)

    @property
    def _best(self) -> Hypothesis:
        return self._all[0]

    @property
    def _room(self) -> int:
        """How many there may be: of an object that was never found, as many as a contact may begin with."""
        return self._most if self._is_found or self._most == 1 else max(self._most, MOST_YOUNG)

    @property
    def in_contact(self) -> bool:
        """Whether the object is being touched."""
        return self._best.estimator.in_contact

    @property
    def is_sure(self) -> bool:
        """Whether there is one answer, of an object that was found."""
        return self._is_found and len(self._all) == 1

    @property
    def is_displaced(self) -> bool:
        """Whether the object must have moved while nothing touched it, and was not found since."""
        return self._best.estimator.is_displaced

    @property
    def is_contradicted(self) -> bool:
        """Whether touch and pushing contradict each other where nothing else moved the object, or as is likeliest."""
        undisturbed = next((one for one in self._all if not one.without_pushing), self._best)
        return is_contradicted(undisturbed.estimator, self._steps)

    @property
    def known(self) -> Prior:
        """What is known of the object at the last frame, by the best hypothesis."""
        return self._best.estimator.known

    @property
    def begin_contact(self) -> BeginContact:
        """What makes the graph of a contact, the same for all hypotheses."""
        return self._best.estimator.begin_contact

    @property
    def touched(self) -> Touched | None:
        """Where the sensor touches the object, by the best hypothesis; None between contacts."""
        return self._best.estimator.touched

    @property
    def answers(self) -> tuple[Answer, ...]:
        """All poses that may be the object's, the best first."""
        return answers_of(self._all)

    @property
    def covariance(self) -> Array:
        """Covariance (3, 3) of all of them about the best, tangent space at its pose (right, body frame)."""
        return joint_covariance(self._all)

    @property
    def status(self) -> Status:
        """What to make of it."""
        return "ambiguous" if is_ambiguous(self._all) else self._best.estimator.status

    @property
    def reason(self) -> str:
        """Why the status is what it is, in words; nothing where all is well."""
        best = self._best.estimator
        if self.status != "ambiguous" or best.has_contradicting_poses:
            return best.reason
        return ambiguity_in_words(self._all) or best.reason or REASONS["ambiguous"]

    def gap(self, sensor_pose: Array) -> tuple[float, float]:
        """Return how far from the object a sensor is that stands here; see Estimator."""
        return self._best.estimator.gap(sensor_pose)

    def copied(self) -> "Hypotheses":
        """Return the same, between two contacts, which may go another way."""
        other = copy(self)
        other._all = [replace(one, estimator=one.estimator.copied()) for one in self._all]
        return other

    def path(self) -> Array:
        """Return all object poses so far (N, 3), as the best hypothesis has them."""
        return self._best.estimator.path()

    def rest(self, sensor_pose: Array, measurements: Sequence[Measurement], time: float) -> None:
        """Take a frame in which nothing touches the object.

        Raises EstimationError, with nothing changed, where what is measured leaves no solution.
        """
        self._all = self._solved(lambda one: one.estimator.rest(sensor_pose, measurements, time), time)

    def touch(self, sensor_pose: Array, measurements: Sequence[Measurement], time: float) -> None:
        """Take a frame of contact, the first of one or the next. Raises EstimationError where no graph is solved."""
        if not self.in_contact:
            self._steps = 0
            self._untouched = [replace(one, estimator=one.estimator.copied(), without_pushing=[]) for one in self._all]
            if self.is_displaced or self._most == 1:
                self._untouched = []
            if self._most > 1:
                self._all = self._begun(sensor_pose, measurements)
            self._all = self._solved(lambda one: one.estimator.touch(sensor_pose, measurements, time), time)
        elif len(self._all) > 1 or self._best.knock_steps_left:
            self._all = self._touched(sensor_pose, measurements, time)
        else:
            self._best.estimator.touch(sensor_pose, measurements, time)
        for one in self._all:
            one.age += 1
        self._steps += 1
        if self._most > 1:
            self._doubt_pushing()
            self._weigh()

    def begin_anew(
        self, sensor_pose: Array, measurements: Sequence[Measurement], time: float, error: EstimationError
    ) -> None:
        """Go on with a new graph from the best last pose; see Estimator."""
        best, self._untouched = self._best.estimator, []
        self._all, self._steps = [Hypothesis(best, slippery=self._best.slippery)], 1
        best.begin_anew(sensor_pose, measurements, time, error)

    def covariance_of_motion(self, length: float) -> Array:
        """Return the covariance (3, 3) of an unknown motion of the object of this size [m]."""
        return self._best.estimator.covariance_of_motion(length)

    def end_contact(self, moved: float = 0.0) -> None:
        """The sensor let go of the object, which something may have moved by so much meanwhile [m]."""
        may_be_none = self.is_displaced and self._best.estimator.touched_for <= _BRIEF
        self._all = [one for one in self._all if not is_lost(one)] or self._all
        for one, score in zip(self._all, self._weighing.scores(self._all, self._steps), strict=True):
            one.log_prior = score + self._weighing.oddness(one)  # of friction, which goes on to the next contact
            one.estimator.end_contact(max(moved, SPREAD if one.knock_steps_left else 0.0))
            one.without_pushing, one.knock_steps_left, one.next_alarm_from = [], 0, 0
        if may_be_none and self._untouched:
            self._doubt_contact()
        self._untouched = []

    def _doubt_pushing(self) -> None:
        """Let something else have moved the object in the likeliest hypothesis that is doubtful anew."""
        for one in self._all:
            is_watched = one.weight > LIKELY_WEIGHT and not one.knock_steps_left and self._steps >= one.next_alarm_from
            if is_watched and is_doubtful(one.estimator, self._steps):
                self._all = [*self._all, *knock_hypotheses(one, self._steps, self._settings.priors)]
                one.next_alarm_from = self._steps + ALARM_DEAD_STEPS
                return

    def _doubt_contact(self) -> None:
        """Let what was known before the contact stand beside what is known after it, and be as likely in all."""
        after, before = (log_sum([one.log_prior for one in some]) for some in (self._all, self._untouched))
        for one in self._untouched:
            one.estimator.stay(self._steps)
            one.log_prior += after - before
        self._all = shared_out([*self._untouched, *self._all], self._room)

    def _touched(self, sensor_pose: Array, measurements: Sequence[Measurement], time: float) -> list[Hypothesis]:
        """All hypotheses that can be solved with one more frame of the contact; EstimationError where none can."""
        estimators, knocks = (
            [one.estimator for one in self._all],
            [STILL_GOING_ON if one.knock_steps_left else None for one in self._all],
        )
        is_solved = touch_on(estimators, sensor_pose, measurements, time, knocks)
        for one in self._all:
            if one.knock_steps_left:
                one.knock_steps_left -= 1
                one.without_pushing = [*one.without_pushing, (self._steps, self._steps + 1)]
        return [one for one, solved in zip(self._all, is_solved, strict=True) if solved]

    def _solved(self, take: Callable[[Hypothesis], None], time: float) -> list[Hypothesis]:
        """All hypotheses that can take a frame; the last error where none can."""
        left: list[Hypothesis] = []
        for one in self._all:
            try:
                take(one)
            except EstimationError as error:
                logger.debug("frame at %.3f s: a hypothesis is dropped: %s", time, error)
                if one is self._all[-1] and not left:
                    raise
                continue
            left.append(one)
        return left

    def _begun(self, sensor_pose: Array, measurements: Sequence[Measurement]) -> list[Hypothesis]:
        """The hypotheses that a contact begins with."""
        begin = ways_to_begin if self._is_found else ways_to_begin_unfound
        answers = [(one.estimator, one.log_prior) for one in self._all]
        return [self._beginning(one) for one in begin(answers, self._model, sensor_pose, measurements)]

    def _beginning(self, way: Beginning) -> Hypothesis:
        """The hypothesis that a contact begins so."""
        one = self._all[way.of]
        if way.prior is None:
            return one
        return Hypothesis(
            one.estimator.started(way.prior),
            way.log_prior,
            without_pushing=[(0, 1)] if way.is_place else [],
            knock_steps_left=AHEAD if way.is_place else 0,
            slippery=one.slippery,
        )

    def _weigh(self) -> None:
        """Weigh all hypotheses, the best first, and keep those worth it."""
        if len(self._all) > 1:
            self._all = self._weighing.kept(self._all, self._steps, self._room)
            return
        self._best.log_prior, self._best.without_pushing, self._best.weight = 0.0, [], 1.0
        self._is_found |= not is_rough(self.known, self._model)
