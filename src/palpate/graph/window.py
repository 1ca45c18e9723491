"""Smoother over the last steps of a contact: Gauss-Newton on a sliding window, older steps are marginalised.

All B hypotheses of a contact are rows of one window: every array has a leading axis B. To branch, prune and reorder
hypotheses is to take rows. The terms are shared by all rows; the rows differ in their beliefs at the beginning, in
disturbances of the object, and in the sign with which touch images are read.

Every step relinearises the whole window, so that its cost does not grow with the length of the contact. A step that
leaves the window leaves a Gaussian on the next step and the shared variables (Schur complement), linearised where that
step was before the last Gauss-Newton step. With an unlimited lag this is the batch solution.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import Array, Flags
from palpate.config import ITERATIONS, LAG, REMEMBERED, Priors
from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph.belief import Belief, Indices
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors import ROW, STEP, TERM, TERM_SIZE, TURN, WORK, Step, terms_of
from palpate.graph.gauss_newton import begin_step, improve
from palpate.graph.own_measurements import OwnMeasurements
from palpate.graph.variables import CONTACT_SIZE, IN_SHARED, LAST_SIZE, OF_CONTACT, STEP_SIZE, TURN_OFFSET
from palpate.types.measurements import OwnMeasurement


class Window:
    """The graph of one contact over its last steps, in B hypotheses."""

    def __init__(
        self,
        factors: NDArray[np.void],
        model: ContactModel,
        belief: Belief,
        step: Step,
        lag: int = LAG,
        priors: Priors | None = None,
        sign: Array | None = None,
        own: OwnMeasurements | None = None,
    ) -> None:
        """Begin with the first step of a contact and B beliefs about the object.

        `sign` (B,) is -1 in hypotheses that take touch images as mirrored. The object's variables change from step to
        step as `priors` says, by default not at all; within the window they count as constant.
        """
        self._model, self._lag, drift, work = model, lag, np.zeros(LAST_SIZE), np.zeros(1, WORK)
        if priors is not None:
            drift[STEP_SIZE + CONTACT_SIZE :] = priors.changes[1]
        self._given = factors, drift, model.surface, work
        sign = np.ones(len(belief)) if sign is None else sign
        self._steps, rows = _begun(belief, step.sensor_pose, sign)
        self.rows: NDArray[np.void] = rows
        """State of each hypothesis, `factors.ROW` (B,)."""
        self._left = 0  # number of steps that have left the window
        self._left_costs = np.empty((len(belief), 0, 3))  # of steps that left the window
        self._terms, self._has_turn = np.empty((0, TERM_SIZE)), False
        self._own = own or OwnMeasurements()
        self._own.given, self._own.time = [], step.times[-1]
        self._join(*terms_of(step, 0))
        self._solve(np.ones(len(rows), np.bool_))

    def add(self, step: Step, spread: ArrayLike = 0.0) -> None:
        """Add the next step.

        `spread` (B,) [m] is the standard deviation of the slide over the sensor by which something else may move the
        object in this step; see `factors.STEP`. Raises EstimationError where no hypothesis has a solution.
        """
        count = self._steps.shape[1]
        terms, own = terms_of(step, self._left + count)  # may raise
        if count == self._lag:
            self._marginalise()
        begun = np.zeros((len(self.rows), 1), STEP)
        begun["e"] = begun["measured"] = step.sensor_pose
        begun["spread"][:, 0] = spread
        self._steps = np.concatenate([_raw(self._steps), _raw(begun)], axis=1).view(STEP)
        begin_step(self._steps)
        self._own.time = step.times[-1]
        self._join(terms, own)
        self._solve(np.ones(len(self.rows), np.bool_))

    def take(self, rows: Indices) -> None:
        """Keep these rows, in this order; a row may be taken several times."""
        self._steps = _raw(self._steps)[rows].view(STEP)
        self.rows, self._left_costs = _raw(self.rows)[rows].view(ROW), self._left_costs[rows]

    def disturb(self, rows: Indices, steps: int, slide: Array, spread: float) -> None:
        """Let something else have moved the object in the last steps, in some rows; rows without a solution are lost.

        `slide` (len(rows),) is the slide of the object over the sensor in all these steps, counter-clockwise along the
        outline, and `spread` its standard deviation, both [m].
        """
        last = self._steps.shape[1]
        first = max(last - steps, 1)
        count, changing = max(last - first, 1), np.zeros(len(self.rows), np.bool_)
        changing[rows] = True
        length, disturbed = slide[:, None] / count, self._steps[rows, first:]
        disturbed["slide"], disturbed["spread"] = length, spread / math.sqrt(count)
        disturbed["cost"][..., 2] = 1.0
        # Seen from the object, the sensor moves the other way.
        back = -length * np.arange(1.0, last - first + 1)
        disturbed["g"] = self._model.moved_along(disturbed["g"].reshape(-1, 3), back.ravel()).reshape(*back.shape, 3)
        self._steps[rows, first:] = disturbed
        self._solve(changing)

    def belief(self) -> Belief:
        """Return the beliefs about the object at the last step."""
        pose, values = self._steps["object"][:, -1], self.rows["shared"][:, CONTACT_SIZE:]
        return Belief(pose.copy(), values.copy(), self.rows["covariance"].copy())

    def last(self, row: int) -> np.void:
        """Return the last step of a row; see `factors.STEP`."""
        return self._steps[row, -1]

    def object_path(self) -> Array:
        """Return the object poses of all steps in the window, (B, N, 3)."""
        return self._steps["object"].copy()

    def costs(self) -> Array:
        """Return the cost of each of the last steps (B, N, 3): minus its log likelihood, except for a constant.

        The first column is that of the measurements, the second that of pushing, which holds only while nothing but
        the sensor moves the object, and the third is 1 where the second does not count. At most a thousand steps that
        left the window are included.
        """
        return np.concatenate([self._left_costs, self._steps["cost"]], axis=1)

    def cost_of_belief(self) -> Array:
        """Return the cost (B,) of leaving the beliefs that the contact began with, while its first step is kept."""
        return self._steps["cost_of_belief"][:, 0].copy()

    def count_all_costs(self, rows: Flags) -> None:
        """Count the costs of pushing in all steps so far of some rows (B,)."""
        self._left_costs[rows, :, 2] = 0.0
        self._steps["cost"][rows, :, 2] = 0.0

    def _join(self, arrived: Array, own: list[tuple[int, OwnMeasurement]]) -> None:
        """Take the terms that arrive with the last step."""
        self._own.given = [one for one in (*self._own.given, *own) if one[0] >= self._left]
        self._terms = terms = np.concatenate([self._terms, arrived])
        is_late = len(arrived) and arrived[0, 0] < self._left + self._steps.shape[1] - 1
        if is_late:  # that of a late measurement may have left the window
            terms = terms[terms[:, 0] >= self._left]
            self._terms = terms[np.lexsort((terms[:, 1], terms[:, 0]))]
        if not self._has_turn and (turns := arrived[arrived[:, 1] == TURN]).size:
            # Far from the true offset, the robust kernel would leave a turn hardly any weight.
            self._has_turn, first = True, turns[0].view(TERM)[0]
            angle = first["value"] * (self.rows["sign"] if first["from_touch"] else 1.0)
            offset = se2.wrap(self._steps["g"][:, -1, 2] - angle)
            self.rows["shared"][:, IN_SHARED[TURN_OFFSET]] = offset[:, None]

    def _solve(self, changing: Flags) -> None:
        """Take Gauss-Newton steps of the rows that are `changing` (B,); see `improve`.

        The other rows keep their solution. Raises EstimationError where no row has a solution.
        """
        terms, steps, rows = self._terms.view(TERM)[:, 0], self._steps, self.rows
        calls, linear = ITERATIONS if self._own.given else 1, np.empty((len(rows), 0, 0, 0))
        for _ in range(calls):
            if self._own.given:
                linear = self._own.evaluated(self._left, steps["g"], steps["e"], rows["shared"])
            own, most = (np.array([step for step, _ in self._own.given], np.int64), linear), ITERATIONS // calls
            improve(steps, self._left, rows, terms, own, self._given, changing, most)
            if not changing.any():
                break
        if rows["is_lost"].all():
            raise EstimationError("the linear system of the window is indeterminate")

    def _marginalise(self) -> None:
        """Replace the oldest step by a Gaussian on the next one and the shared variables."""
        self._left_costs = np.concatenate([self._left_costs, self._steps["cost"][:, :1]], axis=1)[:, -REMEMBERED:]
        self.rows["past"] = self.rows["next_past"]
        self._steps, self._left = self._steps[:, 1:], self._left + 1
        self._terms = self._terms[np.searchsorted(self._terms[:, 0], self._left) :]


def _raw(records: NDArray[np.void]) -> NDArray[np.void]:
    """Return the same records without their fields, since NumPy copies arrays of fields one by one."""
    return records.view(np.dtype((np.void, records.itemsize)))


def _begun(belief: Belief, sensor_pose: Array, sign: Array) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return the first step (B, 1) and the rows (B,) of a window that begins with these beliefs."""
    steps, rows = np.zeros((len(belief), 1), STEP), np.zeros(len(belief), ROW)
    steps["g"][:, 0], steps["e"], steps["measured"] = se2.between(belief.pose, sensor_pose), sensor_pose, sensor_pose
    rows["shared"][:, CONTACT_SIZE:], rows["sign"] = belief.values, sign
    past = rows["past"]
    for column, one in enumerate(OF_CONTACT):  # each is one number
        rows["shared"][:, column], deviation = one.prior
        past["information"][:, STEP_SIZE + column, STEP_SIZE + column] = deviation**-2.0
    past["g"], past["e"], past["shared"] = steps["g"][:, 0], steps["e"][:, 0], rows["shared"]
    rows["first_pose"], rows["first_values"] = belief.pose, belief.values
    rows["first_root"] = _whitening(belief.covariance)
    return steps, rows


def _whitening(covariances: Array) -> Array:
    """Return inverse Cholesky roots (B, N, N); NaN, which leaves no solution, where there is none."""
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariances)), np.float64)
    except np.linalg.LinAlgError:
        if len(covariances) == 1:
            return np.full_like(covariances, np.nan)
        return np.concatenate([_whitening(one[None]) for one in covariances])
