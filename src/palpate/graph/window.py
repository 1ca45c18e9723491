"""A smoother over the last steps of a contact: Gauss-Newton on a sliding window, older steps marginalised.

Every step relinearises the whole window, so that a step costs the same at frame 10 000 as at frame 500. A step that
leaves the window leaves behind a Gaussian on the steps it was tied to (Schur complement), linearised where they stood
before the last Gauss-Newton step, and on what all steps share. With an endless window this is the batch solution.

It loops over factors and knows none of them. Several smoothers that differ in what they know when the contact begins
or in what else they think moved the object go through one call side by side, as a bank: that takes far less time than
one after the other.
"""

import math
from collections.abc import Callable, Sequence
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.config import Normal, Priors
from palpate.errors import EstimationError
from palpate.filter.belief import Belief, Prior
from palpate.geometry import se2
from palpate.graph.block_tridiagonal import BandedEquations
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.dense_equations import DenseEquations
from palpate.graph.factors.factor import Factor, Step, Terms
from palpate.graph.factors.first_pose import FirstPose
from palpate.graph.growing_terms import GrowingTerms
from palpate.graph.linearised import Linearised
from palpate.graph.normal_equations import Gaussian
from palpate.graph.past import nothing_past, without_oldest
from palpate.graph.trail import Trail
from palpate.graph.values import ANGLE_STEPS, Knock, Values
from palpate.graph.variables import (
    CONTACT_SIZE,
    GRIP,
    IN_SHARED,
    LAG,
    OF_CONTACT,
    SENSOR,
    SENSOR_IN_OBJECT,
    SHARED_SIZE,
    STEP_SIZE,
)
from palpate.types.measurements import Measurement

Array = NDArray[np.float64]

_ITERATIONS = 4
_CONVERGED = 3e-4  # [m], [rad] of the poses; the next frame takes another Gauss-Newton step
_REMEMBERED = 1000  # steps that left the window of which it is remembered what they cost
_REPORTED = np.r_[:STEP_SIZE, STEP_SIZE + CONTACT_SIZE : STEP_SIZE + SHARED_SIZE]  # all but what a contact has


class Window:
    """The graph of one contact over its last `lag` steps, for one smoother or a bank of them."""

    def __init__(
        self,
        factors: Sequence[Factor],
        model: ContactModel,
        priors: Sequence[Prior],
        sensor_pose: Array,
        measurements: Sequence[Measurement] = (),
        time: float = 0.0,
        lag: int = LAG,
        usual: Priors | None = None,
    ) -> None:
        """Begin with the first frame of a contact and what each smoother knows of the object.

        sensor_pose (3,) is the measured world_T_sensor [m, m, rad]. What belongs to the object may change in a step as
        is `usual`, by default not at all; within the window it is taken not to.
        """
        self._lag, self._priors = lag, priors
        self._changes = np.zeros(SHARED_SIZE)  # variances in a step
        if usual is not None:
            self._changes[CONTACT_SIZE:] = usual.changes_per_step
        self._factors = [FirstPose(priors), *factors]
        self._terms = [GrowingTerms() for _ in self._factors]
        poses = np.array([prior.pose for prior in priors])
        of_steps = {
            SENSOR_IN_OBJECT: se2.between(poses, sensor_pose)[:, None],
            SENSOR: np.repeat(sensor_pose[None, None], len(priors), axis=0),
        }
        shared = np.empty((SHARED_SIZE, len(priors)))
        for one in OF_CONTACT:
            shared[IN_SHARED[one]] = one.prior[0] if one.prior else 0.0
        shared[CONTACT_SIZE:] = np.transpose([prior.values for prior in priors])
        self._values = Values(model, of_steps, shared)
        self._past, self._past_at = nothing_past(len(priors)), self._values
        self._measured, self._times = sensor_pose, [time]
        self._left_costs = np.empty((len(priors), 0, 2))
        self._left = [Trail() for _ in priors]  # g and e (2, 3) of the steps that left, one a smoother
        self.is_lost = np.zeros(len(priors), np.bool_)
        """Whether the graph of a smoother has no solution (B,)."""
        self._costs: Array | None = None  # as they were asked for since the last frame, and below errors
        self._errors: dict[str, Array] | None = None
        step = Step(sensor_pose, None, measurements, self._times)
        self._join([factor.terms(step) for factor in self._factors])
        self._solve()

    def add(
        self,
        sensor_pose: Array,
        measurements: Sequence[Measurement] = (),
        time: float = 0.0,
        knocks: Sequence[Knock | None] | None = None,
    ) -> None:
        """Add the next frame: the measured sensor pose (3,), what touch and others say, and what else may push.

        The last is one a smoother. Raises EstimationError where no graph has a solution.
        """
        step = Step(sensor_pose, self._measured, measurements, [*self._times, time])
        new = [factor.terms(step) for factor in self._factors]  # before anything changes: they may refuse
        if self._values.steps == self._lag:
            self._marginalise()
        self._values = self._values.continued(sensor_pose, knocks or [None] * self.smoothers)
        self._measured = sensor_pose
        self._times.append(time)
        self._join(new)
        self._solve()

    def knocked(self, steps: int, slide: Normal, grip: tuple[Normal, Normal] | None = None) -> "Window":
        """Return a copy in which something else may have moved the object in the last steps.

        `slide` is how far the object slid over the sensor in all of them, counter-clockwise along the outline, mean and
        standard deviation [m]; `grip` what was believed of GRIP at first and what is to be believed of it instead, the
        more certain. Raises EstimationError where that has no solution.
        """
        other = self._copied()
        first = max(self._values.steps - steps, 1)
        count = max(self._values.steps - first, 1)
        other._values = self._values.slid(first, Knock(slide[0] / count, slide[1] / math.sqrt(count)))
        if grip is not None:
            other._past = self._past.believing(IN_SHARED[GRIP].start, self._past_at[GRIP][0], *grip)
            other._values = other._values.with_value(GRIP, np.full_like(self._values[GRIP], grip[1][0]))
        other._gather()
        other._solve()
        return other

    @staticmethod
    def bank(chosen: Sequence[tuple["Window", int]]) -> "Window":
        """Return smoothers of windows side by side in one, which goes its own way; each is a window and which of it.

        The windows are of one contact and have taken the same frames.
        """

        def joined(of: Callable[[Window], NDArray[Any]], axis: int = 0) -> NDArray[Any]:
            return np.concatenate([of(window).take([b], axis) for window, b in chosen], axis)

        def joined_values(of: Callable[[Window], Values]) -> Values:
            return Values.bank([(of(window), b) for window, b in chosen])

        first = chosen[0][0]
        other = first._copied()
        other._priors = [window._priors[b] for window, b in chosen]
        other._factors = [FirstPose(other._priors), *first._factors[1:]]
        other._values = joined_values(lambda one: one._values)
        other._past_at = joined_values(lambda one: one._past_at)
        information, gradient = joined(lambda one: one._past.information), joined(lambda one: one._past.gradient)
        other._past = Gaussian(first._past.steps, information, gradient)
        other._covariance = joined(lambda one: one._covariance)
        other._left_costs = joined(lambda one: one._left_costs)
        other._left = [window._left[b].copied() for window, b in chosen]
        other.is_lost = joined(lambda one: one.is_lost)
        other._gather()
        other._linearised.linearise(joined_values(lambda one: one._linearised.at))
        return other

    def _copied(self) -> "Window":
        other = copy(self)
        other._costs = other._errors = None
        other._times, other._left = [*self._times], [left.copied() for left in self._left]
        other._terms = [grown.copy() for grown in self._terms]
        return other

    @property
    def smoothers(self) -> int:
        """How many there are."""
        return self._values.smoothers

    @property
    def values(self) -> Values:
        """The estimate: all steps in the window and what they share."""
        return self._values

    def belief(self, smoother: int = 0) -> Belief:
        """Return what a smoother says of the last step."""
        g, e = (self._values[one][smoother, -1] for one in (SENSOR_IN_OBJECT, SENSOR))
        covariance = self._covariance[smoother][_REPORTED[:, None], _REPORTED]
        return Belief(g, e, self._values.shared[CONTACT_SIZE:, smoother], covariance)

    def path(self) -> tuple[Array, Array]:
        """Return all steps of this contact, g and e (B, N, 3); those that left the window as they last were in it."""
        g, e = self._values[SENSOR_IN_OBJECT], self._values[SENSOR]
        left = np.array([each.rows().reshape(-1, 2, 3) for each in self._left])
        return np.concatenate([left[:, :, 0], g], axis=1), np.concatenate([left[:, :, 1], e], axis=1)

    def pushing_angle(self) -> Array:
        """Return the angle of the pushing force from the outline's inward normal at the last step (B,) [rad].

        NaN at the first step.
        """
        values = self._values.with_steps(lambda value: value[:, -ANGLE_STEPS - 1 :])
        return values.pushing_angle[:, -1] if values.steps > 1 else np.full(self.smoothers, math.nan)

    def mean_square(self, name: str, steps: int, smoother: int = 0) -> float:
        """Return the mean square error of a factor's terms in the last steps [variances], kernels left out."""
        first = max(self._values.steps - steps, 0)
        return self._linearised.mean_square(name, first, smoother)

    def costs(self) -> Array:
        """Return what each of the last steps costs (B, N, 2): minus the log of how likely it is, but for a constant.

        They are all of the contact, or a thousand. First what is measured in it, then pushing, which holds only where
        nothing but the sensor moves the object. A term costs its step what its kernel leaves of half the square. What
        several steps cost together, as pushing does, is forgotten when the first of them leaves the window.
        """
        if self._costs is None:
            self._costs = np.concatenate([self._left_costs, self._linearised.costs()], axis=1)
        return self._costs

    def last_errors(self) -> dict[str, Array]:
        """Return the errors of the last step by factor, of those that tell strain: (B, rows) [standard deviations].

        Kernels are left out; of several terms it is the one worst off.
        """
        if self._errors is None:
            self._errors = self._linearised.last_errors(self._values)
        return self._errors

    def _join(self, new: Sequence[Terms | None]) -> None:
        """Take the terms that arrive with the last step."""
        now = self._values.steps - 1
        for factor, grown, arrived in zip(self._factors, self._terms, new, strict=True):
            if arrived is None:
                continue
            first = not grown.begun
            grown.append(arrived, now)
            if first and len(grown):
                for unknown, value in factor.first_guess(self._values, grown.terms).items():
                    self._values = self._values.with_value(unknown, value)
        self._gather()

    def _gather(self) -> None:
        """Make room for all terms linearised."""
        self._linearised = Linearised(self._factors, self._terms, self.smoothers)
        banded = self._past.steps <= 1 and all(grown.span <= 1 for grown in self._terms)
        self._equations = BandedEquations if banded else DenseEquations

    def _solve(self) -> None:
        self._costs = self._errors = None
        with self._equations.threads():
            for _ in range(_ITERATIONS):
                if self._improve() < _CONVERGED:
                    break
        if self.is_lost.all():
            raise EstimationError("the linear system of the window is indeterminate")

    def _improve(self) -> float:
        """Take a Gauss-Newton step and return its largest change of a pose [m], [rad]."""
        at = self._values
        self._linearised.linearise(at)
        equations = self._equations(at.smoothers, at.steps)
        for factor, terms, rows in self._linearised:
            equations.add(rows, terms.places, factor.columns)
        equations.add_gaussian(self._past_seen_from(at))
        solution = equations.solve()
        self._values = at.moved(solution.by_step, solution.by_shared)
        self._covariance = solution.covariance
        self.is_lost = self.is_lost | ~solution.is_found
        return max(float(solution.by_step.max()), -float(solution.by_step.min()))

    def _past_seen_from(self, at: Values) -> Gaussian:
        """What was known of what is shared, and what the steps that left say, at other values."""
        past = self._past
        return past.moved(at.apart_from(self._past_at, past.steps))

    def _marginalise(self) -> None:
        """Replace the oldest step by a Gaussian on the others and what is shared, as its terms were last linearised."""
        at = self._linearised.at
        self._past = without_oldest(self._linearised, self._past_seen_from(at)).loosened(self._changes)
        self._past_at = at.without_oldest()
        self._left_costs = np.concatenate([self._left_costs, self._linearised.costs()[:, :1]], axis=1)[:, -_REMEMBERED:]
        for grown in self._terms:
            grown.drop_oldest()
        for left, g, e in zip(self._left, self._values[SENSOR_IN_OBJECT], self._values[SENSOR], strict=True):
            left.append(np.array([g[0], e[0]]))
        self._values = self._values.without_oldest()
        del self._times[0]
