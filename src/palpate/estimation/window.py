"""A smoother over the last steps of a contact: Gauss-Newton on a sliding window, older steps marginalised.

Every step relinearises the whole window, so that a step costs the same at frame 10 000 as at frame 500. A step that
leaves the window leaves behind a Gaussian on the steps it was tied to (Schur complement), linearised where they stood
before the last Gauss-Newton step, and on what all steps share. With an endless window this is the batch solution.

It loops over factors and knows none of them. Several smoothers that differ in what they know when the contact begins
go through one call side by side, as a bank.
"""

import math
from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from palpate.compiled import compiled
from palpate.estimation.banded_equations import BandedEquations
from palpate.estimation.belief import Belief, Prior
from palpate.estimation.contact_model import ContactModel
from palpate.estimation.dense_equations import DenseEquations
from palpate.estimation.evidence import add_costs, mean_square
from palpate.estimation.factors.factor import Factor, Knock, Step, Terms
from palpate.estimation.factors.first_pose import FirstPose
from palpate.estimation.growing_terms import GrowingTerms
from palpate.estimation.normal_equations import Gaussian
from palpate.estimation.planar import between, position, rotation, wrap
from palpate.estimation.unknowns import (
    CONTACT_SIZE,
    GRIP,
    IN_SHARED,
    LAG,
    OF_CONTACT,
    SENSOR,
    SENSOR_IN_OBJECT,
    SHARED_SIZE,
    STEP_SIZE,
    Normal,
    Priors,
)
from palpate.estimation.values import ANGLE_STEPS, Values
from palpate.geometry import se2
from palpate.recording.measurements import Measurement

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
        self._lag = lag
        self._changes = np.zeros(SHARED_SIZE)  # variances in a step
        if usual is not None:
            self._changes[CONTACT_SIZE:] = usual.changes(1)
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
        self._past, self._past_at = _nothing_past(len(priors)), self._values
        self._measured, self._times = sensor_pose, [time]
        self._left_costs = np.empty((0, 2))
        self._left: list[tuple[Array, Array]] = []  # g and e (B, 3) of the steps that left
        self._take(Step(sensor_pose, None, measurements, self._times))
        self._solve()

    def add(
        self,
        sensor_pose: Array,
        measurements: Sequence[Measurement] = (),
        time: float = 0.0,
        knock: Knock | None = None,
    ) -> None:
        """Add the next frame: the measured sensor pose (3,), what touch and others say, and what else may push."""
        step = Step(sensor_pose, self._measured, measurements, [*self._times, time], knock=knock)
        new = [factor.terms(step) for factor in self._factors]  # before anything changes: they may refuse
        if self._values.steps == self._lag:
            self._marginalise()
        self._values = self._continued(sensor_pose)
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
        other = copy(self)
        other._times, other._left = [*self._times], [*self._left]
        other._terms = [grown.copy() for grown in self._terms]
        first = max(self._values.steps - steps, 1)
        count = max(self._values.steps - first, 1)
        for factor, grown in zip(self._factors, other._terms, strict=True):
            if factor.is_of_pushing and grown:
                places, data = grown.terms
                late = places[:, -1] >= first
                data["slid"][late], data["spread"][late] = slide[0] / count, slide[1] / math.sqrt(count)
        other._values = _slid(self._values, first, slide[0] / count)
        if grip is not None:
            other._past = self._past.believing(IN_SHARED[GRIP].start, self._past_at[GRIP][0], *grip)
            other._values = other._values.with_value(GRIP, np.full_like(self._values[GRIP], grip[1][0]))
        other._gather()
        other._solve()
        return other

    @property
    def values(self) -> Values:
        """The estimate: all steps in the window and what they share."""
        return self._values

    def beliefs(self) -> list[Belief]:
        """Return what each smoother says of the last step."""
        values = self._values
        g, e, objects = values[SENSOR_IN_OBJECT][:, -1], values[SENSOR][:, -1], values.shared[CONTACT_SIZE:].T
        covariance = self._covariance[:, _REPORTED[:, None], _REPORTED]
        return [Belief(*each) for each in zip(g, e, objects, covariance, strict=True)]

    def path(self) -> tuple[Array, Array]:
        """Return all steps of this contact, g and e (B, N, 3); those that left the window as they last were in it."""
        g, e = self._values[SENSOR_IN_OBJECT], self._values[SENSOR]
        if not self._left:
            return g, e
        left_g, left_e = (np.stack(poses, axis=1) for poses in zip(*self._left, strict=True))
        return np.concatenate([left_g, g], axis=1), np.concatenate([left_e, e], axis=1)

    def pushing_angle(self) -> float:
        """Return the angle of the pushing force from the outline's inward normal at the last step [rad].

        It is that of the first smoother; NaN at the first step and with several tips, of which each bears an unknown
        share of the force.
        """
        values = self._values.with_steps(lambda value: value[:1, -ANGLE_STEPS - 1 :])
        return math.nan if values.steps < 2 or values.model.tips > 1 else float(values.pushing_angle[0, -1, 0])

    def mean_square(self, name: str, steps: int) -> float:
        """Return the mean square error of a factor's terms in the last steps [variances], kernels left out.

        It is that of the first smoother.
        """
        first = max(self._values.steps - steps, 0)
        for factor, terms, rows in self._linearised:
            if factor.name == name:
                return mean_square(rows.residual, rows.information, terms.places, first)
        return 0.0

    def costs(self) -> Array:
        """Return what each of the last steps costs (N, 2): minus the log of how likely it is, but for a constant.

        They are all of the contact, or a thousand. First what is measured in it, then pushing, which holds only where
        nothing but the sensor moves the object. They are those of the first smoother. A term costs its step what its
        kernel leaves of half the square.
        """
        return np.concatenate([self._left_costs, self._costs()])

    def _costs(self) -> Array:
        costs = np.zeros((self._values.steps, 2))
        for factor, terms, rows in self._linearised:
            if factor.name != "first_pose":
                add_costs(
                    rows.residual, rows.information, rows.weight, terms.places, costs[:, int(factor.is_of_pushing)]
                )
        return costs

    def last_errors(self) -> dict[str, Array]:
        """Return the errors of the last step by factor, of those that tell strain: (B, rows) [standard deviations].

        Kernels are left out; of several terms, as of several tips, it is the one worst off.
        """
        steps = self._values.steps
        values = self._values.with_steps(lambda value: value[:, -ANGLE_STEPS - 1 :])
        errors = {}
        for factor, (places, data), _ in self._linearised:
            if factor.tells_strain:
                mine = places[:, -1] == steps - 1
                rows = factor.linearise(values, Terms(places[mine] + values.steps - steps, data[mine]))
                errors[factor.name] = np.abs(rows.residual * np.sqrt(rows.information)).max(axis=1)
        return errors

    def _take(self, step: Step) -> None:
        self._join([factor.terms(step) for factor in self._factors])

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
        self._linearised = [
            (factor, grown.terms, factor.empty_rows(self._values.smoothers, len(grown)))
            for factor, grown in zip(self._factors, self._terms, strict=True)
            if grown
        ]
        banded = self._past.steps <= 1 and all(grown.span <= 1 for grown in self._terms)
        self._equations = BandedEquations if banded else DenseEquations

    def _continued(self, sensor_pose: Array) -> Values:
        """The values with one more step: the sensor goes on turning on the object as it did."""
        values = self._values
        g, e = (np.empty((values.smoothers, values.steps + 1, 3)) for _ in range(2))
        _put_continued(values[SENSOR_IN_OBJECT], values[SENSOR], sensor_pose, g, e)
        return Values(values.model, {SENSOR_IN_OBJECT: g, SENSOR: e}, values.shared)

    def _solve(self) -> None:
        with self._equations.threads():
            for _ in range(_ITERATIONS):
                if self._improve() < _CONVERGED:
                    break

    def _improve(self) -> float:
        """Take a Gauss-Newton step and return its largest change of a pose [m], [rad]."""
        at = self._values
        self._linearised_at = at
        equations = self._equations(at.smoothers, at.steps)
        for factor, terms, rows in self._linearised:
            factor.linearise_into(rows, at, terms)
            equations.add(rows, terms.places, factor.columns)
        equations.add_gaussian(self._past_seen_from(at))
        solution = equations.solve()
        self._values = at.moved(solution.by_step, solution.by_shared)
        self._covariance = solution.covariance
        return max(float(solution.by_step.max()), -float(solution.by_step.min()))

    def _past_seen_from(self, at: Values) -> Gaussian:
        """What was known of what is shared, and what the steps that left say, at other values."""
        past = self._past
        return past.moved(at.apart_from(self._past_at, past.steps))

    def _marginalise(self) -> None:
        """Replace the oldest step by a Gaussian on the others and what is shared, as its terms were last linearised."""
        at = self._linearised_at
        reach = 1
        for _, terms, _ in self._linearised:
            if terms.places.shape[1] > 1:
                reach = max(reach, int(terms.places[terms.places[:, 0] == 0, -1].max(initial=1)))
        steps = min(max(reach + 1, self._past.steps), at.steps)
        equations = DenseEquations(at.smoothers, steps)
        for factor, terms, rows in self._linearised:
            equations.add(rows, terms.places, factor.columns, of_oldest=True)
        equations.add_gaussian(self._past_seen_from(at))
        self._past = equations.without_oldest().loosened(self._changes)
        self._past_at = _without_oldest(at)
        self._left_costs = np.concatenate([self._left_costs, self._costs()[:1]])[-_REMEMBERED:]
        for grown in self._terms:
            grown.drop_oldest()
        self._left.append((self._values[SENSOR_IN_OBJECT][:, 0].copy(), self._values[SENSOR][:, 0].copy()))
        self._values = _without_oldest(self._values)
        del self._times[0]


def _nothing_past(smoothers: int) -> Gaussian:
    """What is known of what a contact has before anything is measured; on no step."""
    information = np.zeros((smoothers, SHARED_SIZE, SHARED_SIZE))
    gradient = np.zeros((smoothers, SHARED_SIZE))
    deviations = [one.prior[1] for one in OF_CONTACT if one.prior for _ in range(one.dimension)]
    information[:, range(CONTACT_SIZE), range(CONTACT_SIZE)] = np.square(deviations) ** -1.0
    return Gaussian(0, information, gradient)


@compiled
def _put_continued(g: Array, e: Array, sensor_pose: Array, g_out: Array, e_out: Array) -> None:
    steps = g.shape[1]
    turned = np.empty(3)
    for b in range(len(g)):
        g_out[b, :steps], e_out[b, :steps] = g[b], e[b]
        last = g[b, steps - 1]
        between(g[b, max(steps - 2, 0)], last, turned)
        ahead = position(last) + rotation(last[2]) * position(turned)
        g_out[b, steps, 0], g_out[b, steps, 1] = ahead.real, ahead.imag
        g_out[b, steps, 2] = wrap(last[2] + turned[2])
        e_out[b, steps] = sensor_pose


def _slid(values: Values, first: int, each: float) -> Values:
    """The values with the object slid over the sensor by so much [m] in every step from the first one named on."""
    g = values[SENSOR_IN_OBJECT].copy()
    lengths = -each * np.arange(1.0, values.steps - first + 1)  # seen from the object, the sensor goes the other way
    for poses in g:
        poses[first:] = values.model.moved_along(poses[first:], lengths)
    return Values(values.model, {SENSOR_IN_OBJECT: g, SENSOR: values[SENSOR]}, values.shared)


def _without_oldest(values: Values) -> Values:
    return values.with_steps(lambda value: value[:, 1:])
