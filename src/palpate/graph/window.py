"""Smoother over the last steps of a contact: Gauss-Newton on a sliding window, older steps are marginalised.

All B hypotheses of a contact are rows of one window: every array has a leading axis B. To branch, prune and reorder
hypotheses is to take rows. The terms are shared by all rows; the rows differ in their beliefs at the beginning, in
disturbances of the object, and in the sign with which touch images are read.

Every step relinearises the whole window, so that its cost does not grow with the length of the contact. A step that
leaves the window leaves a Gaussian on the next step and the shared variables (Schur complement), linearised where that
step was before the last Gauss-Newton step. With an unlimited lag this is the batch solution. The window loops over
factors and knows none of them.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.config import Priors
from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph.belief import Belief, Indices
from palpate.graph.block_tridiagonal import Equations, Gaussian
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.costs import add_costs, mean_squares
from palpate.graph.factors.factor import Factor, Linear, Step, Terms
from palpate.graph.factors.first_pose import FirstPose
from palpate.graph.values import ANGLE_STEPS, Values
from palpate.graph.variables import (
    CONTACT_SIZE,
    IN_SHARED,
    LAG,
    OBJECT_SIZE,
    OF_CONTACT,
    SHARED_SIZE,
    STEP_SIZE,
)
from palpate.types.measurements import Measurement

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_ITERATIONS = 4
_CONVERGED = 3e-4  # [m], [rad] change of a pose; the next frame takes another Gauss-Newton step
_REMEMBERED = 1000  # steps that left the window whose costs are kept
_OBJECT = np.r_[:STEP_SIZE, STEP_SIZE + CONTACT_SIZE : STEP_SIZE + SHARED_SIZE]  # all variables but those of a contact


class Window:
    """The graph of one contact over its last steps, in B hypotheses."""

    def __init__(
        self,
        factors: Sequence[Factor],
        model: ContactModel,
        belief: Belief,
        sensor_pose: Array,
        measurements: Sequence[Measurement] = (),
        time: float = 0.0,
        lag: int = LAG,
        priors: Priors | None = None,
        sign: Array | None = None,
        from_touch: int = 0,
    ) -> None:
        """Begin with the first frame of a contact and B beliefs about the object.

        sensor_pose (3,) is the measured world_T_sensor [m, m, rad]. The first `from_touch` measurements are read from
        touch images; `sign` (B,) is -1 in hypotheses that take these as mirrored. The object's variables change from
        step to step as `priors` says, by default not at all; within the window they count as constant.
        """
        rows = len(belief)
        self._lag = lag
        self._drift = np.zeros(SHARED_SIZE)  # variances per step
        if priors is not None:
            self._drift[CONTACT_SIZE:] = priors.changes_per_step
        self._factors: list[Factor] = [FirstPose(belief), *factors]
        self._terms = [Terms(np.empty(0, np.int64), np.empty(0, factor.data)) for factor in self._factors]
        self._has_begun = [False] * len(self._factors)  # whether a factor had terms in this contact
        self._linear = [factor.room(rows, 0) for factor in self._factors]
        shared = np.empty((rows, SHARED_SIZE))
        for one in OF_CONTACT:
            shared[:, IN_SHARED[one]] = one.prior[0] if one.prior else 0.0
        shared[:, CONTACT_SIZE:] = belief.values
        self._values = Values(
            model,
            se2.between(belief.pose, sensor_pose)[:, None],
            np.repeat(sensor_pose[None, None], rows, axis=0),
            shared,
            np.zeros((rows, 1, 2)),
            np.ones(rows) if sign is None else sign,
        )
        self._at = self._values  # values at which terms are linearised
        self._past, self._past_at = _prior_of_contact(rows), self._values
        self._covariance = np.empty((rows, STEP_SIZE + SHARED_SIZE, STEP_SIZE + SHARED_SIZE))
        self._measured, self._times = sensor_pose, [time]
        self._left_costs = np.empty((rows, 0, 2))  # of steps that left the window
        self._costs: Array | None = None
        self.is_lost = np.zeros(rows, np.bool_)
        """True where the graph has no solution (B,)."""
        step = Step(sensor_pose, None, measurements, self._times, from_touch=from_touch)
        self._join([factor.terms(step) for factor in self._factors])
        self._solve(np.ones(rows, np.bool_), np.arange(rows))

    def add(
        self,
        sensor_pose: Array,
        measurements: Sequence[Measurement] = (),
        time: float = 0.0,
        disturbance: Array | None = None,
        from_touch: int = 0,
    ) -> Array | None:
        """Add the next frame, and return the object poses (B, 3) of the step that leaves the window, if any does.

        `disturbance` (B, 2) [m] is the slide over the sensor by which something else may move the object in this step,
        mean and standard deviation; see `Values`. Raises EstimationError where no hypothesis has a solution.
        """
        times = [*self._times, time]
        step = Step(sensor_pose, self._measured, measurements, times, from_touch=from_touch)
        new = [factor.terms(step) for factor in self._factors]  # before any change, since they may raise
        leaving = None
        if self._values.steps == self._lag:
            leaving = _object_poses(self._values.sensor_in_object[:, 0], self._values.sensor[:, 0])
            self._marginalise()
        disturbance = np.zeros((self.rows, 2)) if disturbance is None else disturbance
        self._values = self._values.continued(sensor_pose, disturbance)
        self._measured, self._times = sensor_pose, times[-self._values.steps :]
        self._join(new)
        self._solve(np.ones(self.rows, np.bool_), self._values.sign)
        return leaving

    def take(self, rows: Indices) -> None:
        """Keep these rows, in this order; a row may be taken several times."""
        first = self._factors[0]
        assert isinstance(first, FirstPose)
        self._factors = [first.take(rows), *self._factors[1:]]
        self._linear = [Linear(*(array[rows] for array in one)) for one in self._linear]
        self._values, self._at = self._values.take(rows), self._at.take(rows)
        self._past, self._past_at = self._past.take(rows), self._past_at.take(rows)
        self._covariance, self._left_costs = self._covariance[rows], self._left_costs[rows]
        self.is_lost = self.is_lost[rows]
        self._costs = None if self._costs is None else self._costs[rows]

    def disturb(self, rows: Indices, steps: int, slide: Array, spread: float) -> None:
        """Let something else have moved the object in the last steps, in some rows; rows without a solution are lost.

        `slide` (len(rows),) is the slide of the object over the sensor in all these steps, counter-clockwise along the
        outline, and `spread` its standard deviation, both [m].
        """
        first = max(self._values.steps - steps, 1)
        count = max(self._values.steps - first, 1)
        self._values = self._values.disturbed(rows, first, slide / count, spread / math.sqrt(count))
        changing = np.zeros(self.rows, np.bool_)
        changing[rows] = True
        self._solve(changing, np.arange(self.rows))

    @property
    def rows(self) -> int:
        """Number of hypotheses."""
        return self._values.rows

    @property
    def steps_with_costs(self) -> int:
        """Number of steps that `costs` covers."""
        return self._left_costs.shape[1] + self._values.steps

    @property
    def values(self) -> Values:
        """Values of all steps in the window and of the shared variables."""
        return self._values

    @property
    def sensor_in_object(self) -> Array:
        """Sensor pose in the object frame at the last step, (B, 3)."""
        return self._values.sensor_in_object[:, -1]

    def belief(self) -> Belief:
        """Return the beliefs about the object at the last step."""
        g, e = self.sensor_in_object, self._values.sensor[:, -1]
        # o = e g^-1 moves by Ad_g (d_e - d_g).
        by_g = se2.adjoint(g)
        by_all = np.tile(np.eye(3 + OBJECT_SIZE, STEP_SIZE + OBJECT_SIZE, 3), (self.rows, 1, 1))
        by_all[:, :3, :3], by_all[:, :3, 3:6] = -by_g, by_g
        covariance = by_all @ self._covariance[:, _OBJECT[:, None], _OBJECT] @ by_all.transpose(0, 2, 1)
        pose = _object_poses(g, e)
        values = self._values.shared[:, CONTACT_SIZE:]
        return Belief(pose, values, 0.5 * (covariance + covariance.transpose(0, 2, 1)))

    def object_path(self) -> Array:
        """Return the object poses of all steps in the window, (B, N, 3)."""
        return _object_poses(self._values.sensor_in_object, self._values.sensor)

    def force_angle(self, row: int) -> float:
        """Return the angle of the pushing force from the outline's inward normal [rad]; NaN at the first step."""
        if self._values.steps == 1:
            return math.nan
        return float(self._values.take([row]).from_step(-ANGLE_STEPS - 1).state.force_angle[0, -1])

    def mean_squares(self, name: str, steps: int) -> Array:
        """Return the mean square error of a factor's terms in the last steps (B,) [variances], without kernels."""
        found = np.zeros(self.rows)
        for factor, terms, linear in self._each():
            if factor.name == name:
                mean_squares(linear, terms.step, max(self._values.steps - steps, 0), found)
        return found

    def costs(self) -> Array:
        """Return the cost of each of the last steps (B, N, 2): minus its log likelihood, except for a constant.

        The first column is that of the measurements, the second that of pushing, which holds only while nothing but
        the sensor moves the object. At most a thousand steps that left the window are included.
        """
        if self._costs is None:
            costs = np.zeros((self.rows, self._at.steps, 2))
            for factor, terms, linear in self._each():
                if not isinstance(factor, FirstPose):  # a belief from before is no evidence for measurements
                    add_costs(linear, terms.step, costs[..., int(factor.is_of_pushing)])
            self._costs = np.concatenate([self._left_costs, costs], axis=1)
        return self._costs

    def last_errors(self) -> Array | None:
        """Return the errors of the last step's consistency tests, (B, R) [standard deviations], without kernels.

        None at the first step, which has none.
        """
        last, errors = self._values.steps - 1, []
        nearby = self._values.from_step(-ANGLE_STEPS - 1)
        for factor, terms in zip(self._factors, self._terms, strict=True):
            if factor.is_consistency_test and (mine := terms.step == last).any():
                now = Terms(np.full(np.count_nonzero(mine), nearby.steps - 1), terms.data[mine])
                linear = factor.linearise(nearby, now)
                errors.append(np.abs(linear.residual * np.sqrt(linear.information)).max(axis=1))
        return np.concatenate(errors, axis=1) if errors else None

    def _each(self) -> list[tuple[Factor, Terms, Linear]]:
        """Return all factors that have terms, with these and their linearisation."""
        each = zip(self._factors, self._terms, self._linear, strict=True)
        return [(factor, terms, linear) for factor, terms, linear in each if len(terms.step)]

    def _join(self, new: Sequence[Terms | None]) -> None:
        """Take the terms that arrive with the last step."""
        now = self._values.steps - 1
        for index, (factor, arrived) in enumerate(zip(self._factors, new, strict=True)):
            if arrived is None:
                continue
            place, terms = arrived.step + now, self._terms[index]
            kept = place >= factor.spans - 1  # the step of a late measurement may have left the window
            terms = self._terms[index] = Terms(
                np.concatenate([terms.step, place[kept]]), np.concatenate([terms.data, arrived.data[kept]])
            )
            if not self._has_begun[index] and kept.any():
                self._has_begun[index] = True
                for variable, value in factor.first_guess(self._values, terms).items():
                    self._values = self._values.with_shared(slice(None), variable, value)
        for index, (factor, terms) in enumerate(zip(self._factors, self._terms, strict=True)):
            if self._linear[index].residual.shape[1] != len(terms.step):
                self._linear[index] = factor.room(self.rows, len(terms.step))

    def _solve(self, changing: Flags, groups: NDArray[Any]) -> None:
        """Take Gauss-Newton steps of the rows that are `changing` (B,), the rows of a group until all have converged.

        The other rows keep their solution. Raises EstimationError where no row has a solution.
        """
        self._costs = None
        together, each = groups[:, None] == groups, self._each()
        for _ in range(_ITERATIONS):
            change = self._improve(changing, each)
            changing = changing & ((together * change).max(axis=1) >= _CONVERGED)
            if not changing.any():
                break
        if self.is_lost.all():
            raise EstimationError("the linear system of the window is indeterminate")

    def _improve(self, changing: Flags, each: Sequence[tuple[Factor, Terms, Linear]]) -> Array:
        """Take a Gauss-Newton step of some rows (B,) and return the largest change of a pose in each, (B,) [m, rad].

        The other rows are linearised where they were, and so have the same solution as before.
        """
        at = self._at = self._values if changing.all() else self._values.where(changing, self._at)
        equations = Equations(at.rows, at.steps)
        for factor, terms, linear in each:
            factor.linearise(at, terms, linear)
            equations.add(linear, terms.step, factor.columns)
        equations.add_gaussian(self._past.moved(at.change_since(self._past_at)))
        solution = equations.solve()
        self._values = at.moved(solution.by_step, solution.by_shared)
        self._covariance = solution.covariance
        self.is_lost = self.is_lost | ~solution.is_found
        return np.abs(solution.by_step).max(axis=(1, 2))

    def _marginalise(self) -> None:
        """Replace the oldest step by a Gaussian on the next one and the shared variables."""
        at = self._at
        equations = Equations(at.rows, 2)
        for factor, terms, linear in self._each():
            equations.add(linear, terms.step, factor.columns, of_oldest=True)
        equations.add_gaussian(self._past.moved(at.change_since(self._past_at)))
        self._past, self._past_at = equations.without_oldest().inflated(self._drift), at.from_step(1)
        self._left_costs = self.costs()[:, : self._left_costs.shape[1] + 1][:, -_REMEMBERED:]
        for index, (factor, terms) in enumerate(zip(self._factors, self._terms, strict=True)):
            kept = terms.step >= factor.spans  # their steps stay in the window
            self._terms[index] = Terms(terms.step[kept] - 1, terms.data[kept])
        self._values = self._values.from_step(1)


def _object_poses(g: Array, e: Array) -> Array:
    return se2.compose(e, se2.inverse(g))


def _prior_of_contact(rows: int) -> Gaussian:
    """Return the prior on the variables of a contact; it says nothing of any step."""
    information = np.zeros((rows, STEP_SIZE + SHARED_SIZE, STEP_SIZE + SHARED_SIZE))
    deviations = [one.prior[1] for one in OF_CONTACT if one.prior for _ in range(one.dimension)]
    places = range(STEP_SIZE, STEP_SIZE + CONTACT_SIZE)
    information[:, places, places] = np.square(deviations) ** -1.0
    return Gaussian(information, np.zeros((rows, STEP_SIZE + SHARED_SIZE)))
