"""Smoother over the last steps of a contact: Gauss-Newton on a sliding window, older steps are marginalised.

All B hypotheses of a contact are rows of one window: every array has a leading axis B. To branch, prune and reorder
hypotheses is to take rows. The terms are shared by all rows; the rows differ in their beliefs at the beginning, in
disturbances of the object, and in the sign with which touch images are read.

Every step relinearises the whole window, so that its cost does not grow with the length of the contact. A step that
leaves the window leaves a Gaussian on the next step and the shared variables (Schur complement), linearised where that
step was before the last Gauss-Newton step. With an unlimited lag this is the batch solution.
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
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors import FRICTION_CONE, NAMES, OWN, ROW, STEP, TERM, TURN, Factors, Step
from palpate.graph.gauss_newton import extrapolate, improve
from palpate.graph.own_measurements import evaluated
from palpate.graph.variables import CONTACT_SIZE, IN_SHARED, LAG, LAST_SIZE, OF_CONTACT, STEP_SIZE, TURN_OFFSET
from palpate.types.measurements import Measurement, OwnMeasurement

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_ITERATIONS = 4
_CONVERGED = 3e-4  # [m], [rad] change of a pose; the next frame takes another Gauss-Newton step
_REMEMBERED = 1000  # steps that left the window whose costs are kept


class Window:
    """The graph of one contact over its last steps, in B hypotheses."""

    def __init__(
        self,
        factors: Factors,
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
        self._factors, self._model, self._lag = factors, model, lag
        self._drift = np.zeros(LAST_SIZE)  # variances per step
        if priors is not None:
            self._drift[STEP_SIZE + CONTACT_SIZE :] = priors.changes_per_step
        self._steps, self._rows = _begun(belief, sensor_pose, np.ones(len(belief)) if sign is None else sign)
        self._left_costs = np.empty((len(belief), 0, 2))  # of steps that left the window
        self._terms, self._has_turn = np.empty(0, TERM), False
        self._own: list[OwnMeasurement | None] = []  # in the order of their terms
        self._measured, self._times = sensor_pose, [time]
        self._join(*factors.terms(Step(sensor_pose, None, measurements, self._times, from_touch=from_touch)))
        self._solve(np.ones(self.rows, np.bool_), np.arange(self.rows))

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
        mean and standard deviation; see `factors.STEP`. Raises EstimationError where no hypothesis has a solution.
        """
        step = Step(sensor_pose, self._measured, measurements, [*self._times, time], from_touch=from_touch)
        terms, own = self._factors.terms(step)  # before any change, since they may raise
        leaving = None
        if len(self._times) == self._lag:
            leaving = self._steps["object"][:, 0].copy()
            self._marginalise()
        new = np.zeros((self.rows, 1), STEP)
        new["e"] = sensor_pose
        if disturbance is not None:
            new["slide"], new["spread"] = disturbance[:, :1], disturbance[:, 1:]
        self._steps = joined([self._steps, new], axis=1)
        extrapolate(self._steps)
        self._measured, self._times = sensor_pose, [*self._times, time]
        self._join(terms, own)
        self._solve(np.ones(self.rows, np.bool_), self._rows["sign"])
        return leaving

    def take(self, rows: Indices) -> None:
        """Keep these rows, in this order; a row may be taken several times."""
        self._steps, self._rows, self._left_costs = self._steps[rows], self._rows[rows], self._left_costs[rows]

    def disturb(self, rows: Indices, steps: int, slide: Array, spread: float) -> None:
        """Let something else have moved the object in the last steps, in some rows; rows without a solution are lost.

        `slide` (len(rows),) is the slide of the object over the sensor in all these steps, counter-clockwise along the
        outline, and `spread` its standard deviation, both [m].
        """
        first, last = max(len(self._times) - steps, 1), len(self._times)
        count, changing = max(last - first, 1), np.zeros(self.rows, np.bool_)
        changing[rows] = True
        disturbed, length = self._steps[rows, first:], slide[:, None] / count
        disturbed["slide"], disturbed["spread"] = length, spread / math.sqrt(count)
        # Seen from the object, the sensor moves the other way.
        back = -length * np.arange(1.0, last - first + 1)
        disturbed["g"] = self._model.moved_along(disturbed["g"].reshape(-1, 3), back.ravel()).reshape(*back.shape, 3)
        self._steps[rows, first:] = disturbed
        self._solve(changing, np.arange(self.rows))

    @property
    def rows(self) -> int:
        """Number of hypotheses."""
        return len(self._rows)

    @property
    def is_lost(self) -> Flags:
        """True where the graph has no solution (B,)."""
        return self._rows["is_lost"]

    @property
    def sensor_in_object(self) -> Array:
        """Sensor pose in the object frame at the last step, (B, 3)."""
        return self._steps["g"][:, -1]

    def belief(self) -> Belief:
        """Return the beliefs about the object at the last step."""
        pose, values = self._steps["object"][:, -1], self._rows["shared"][:, CONTACT_SIZE:]
        return Belief(pose.copy(), values.copy(), self._rows["covariance"].copy())

    def touch(self, row: int) -> np.void:
        """Return the CONTACT_GEOMETRY of a row at the last step."""
        return self._steps["touch"][row, -1]

    def object_path(self) -> Array:
        """Return the object poses of all steps in the window, (B, N, 3)."""
        return self._steps["object"].copy()

    def force_angle(self, row: int) -> float:
        """Return the angle of the pushing force from the outline's inward normal [rad]; NaN at the first step."""
        return float(self._steps["force_angle"][row, -1]) if len(self._times) > 1 else math.nan

    def mean_squares(self, name: str, steps: int) -> Array:
        """Return the mean square error of a factor's terms in the last steps (B,) [variances], without kernels."""
        kind, first = NAMES.index(name), max(len(self._times) - steps, 0)
        count = np.count_nonzero((self._terms["kind"] == kind) & (self._terms["step"] >= first))
        return self._steps["squares"][:, first:, kind].sum(axis=1) / max(count, 1)

    def costs(self) -> Array:
        """Return the cost of each of the last steps (B, N, 2): minus its log likelihood, except for a constant.

        The first column is that of the measurements, the second that of pushing, which holds only while nothing but
        the sensor moves the object. At most a thousand steps that left the window are included.
        """
        return np.concatenate([self._left_costs, self._steps["cost"]], axis=1)

    @property
    def steps_with_costs(self) -> int:
        """Number of steps that `costs` covers."""
        return self._left_costs.shape[1] + len(self._times)

    def last_errors(self) -> Array | None:
        """Return the errors of the last step's sticking and balance, (B, 3) [standard deviations], without kernels.

        None at the first step, which has none.
        """
        return self._rows["errors"] if len(self._times) > 1 else None

    def _join(self, arrived: NDArray[np.void], own: list[OwnMeasurement | None]) -> None:
        """Take the terms that arrive with the last step."""
        arrived["step"] += len(self._times) - 1
        arrived["index"][arrived["kind"] == OWN] = len(self._own) + np.arange(len(own))
        arrived = arrived[arrived["step"] >= 0]  # that of a late measurement may have left the window
        terms, self._own = joined([self._terms, arrived]), [*self._own, *own]
        self._keep(np.argsort(terms["step"] * len(NAMES) + terms["kind"], kind="stable"), terms)
        turns = arrived[arrived["kind"] == TURN]
        if len(turns) and not self._has_turn:
            # Far from the true offset, the robust kernel would leave a turn hardly any weight.
            first, self._has_turn = turns[0], True
            angle = first["value"] * (self._rows["sign"] if first["from_touch"] else 1.0)
            offset = se2.wrap(self._steps["g"][:, first["step"], 2] - angle)
            self._rows["shared"][:, IN_SHARED[TURN_OFFSET]] = offset[:, None]

    def _keep(self, order: NDArray[np.int64], terms: NDArray[np.void]) -> None:
        """Keep these terms and, in their order, the own measurements that have one."""
        self._terms = terms.take(order)
        if self._own:
            is_own = self._terms["kind"] == OWN
            self._own = [self._own[index] for index in self._terms["index"][is_own]]
            self._terms["index"][is_own] = np.arange(len(self._own))

    def _solve(self, changing: Flags, groups: NDArray[Any]) -> None:
        """Take Gauss-Newton steps of the rows that are `changing` (B,), the rows of a group until all have converged.

        The other rows keep their solution. Raises EstimationError where no row has a solution.
        """
        steps, rows, terms, surface = self._steps, self._rows, self._terms, self._model.surface
        together = groups[:, None] == groups
        own = np.empty((self.rows, 0, 0, 0))
        for _ in range(_ITERATIONS):
            if self._own:
                own_steps = terms["step"][terms["kind"] == OWN].tolist()
                own = evaluated(self._own, own_steps, steps["g"], steps["e"], rows["shared"], self._times[-1])
            improve(steps, rows, changing, terms, self._factors.settings, self._drift, surface, own)
            changing = changing & ((together * rows["change"]).max(axis=1) >= _CONVERGED)
            if not changing.any():
                break
        if rows["is_lost"].all():
            raise EstimationError("the linear system of the window is indeterminate")

    def _marginalise(self) -> None:
        """Replace the oldest step by a Gaussian on the next one and the shared variables."""
        self._left_costs = np.concatenate([self._left_costs, self._steps["cost"][:, :1]], axis=1)[:, -_REMEMBERED:]
        rows, second = self._rows, self._steps[:, 1]
        for name in ("information", "gradient"):
            rows["past_" + name] = rows["next_" + name]
        rows["past_g"], rows["past_e"], rows["past_shared"] = second["at_g"], second["at_e"], rows["at_shared"]
        self._steps = self._steps[:, 1:]
        needed = np.where(self._terms["kind"] <= FRICTION_CONE, 2, 1)  # terms of pushing are on two steps
        self._keep(np.flatnonzero(self._terms["step"] >= needed), self._terms)
        self._terms["step"] -= 1
        self._times = self._times[1:]


def _begun(belief: Belief, sensor_pose: Array, sign: Array) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """Return the first step (B, 1) and the rows (B,) of a window that begins with these beliefs."""
    steps, rows = np.zeros((len(belief), 1), STEP), np.zeros(len(belief), ROW)
    steps["g"][:, 0], steps["e"] = se2.between(belief.pose, sensor_pose), sensor_pose
    rows["shared"][:, CONTACT_SIZE:], rows["sign"] = belief.values, sign
    for one in OF_CONTACT:
        assert one.prior is not None
        mean, deviation = one.prior
        rows["shared"][:, IN_SHARED[one]] = mean
        for place in range(STEP_SIZE + IN_SHARED[one].start, STEP_SIZE + IN_SHARED[one].stop):
            rows["past_information"][:, place, place] = deviation**-2.0
    rows["past_g"], rows["past_e"], rows["past_shared"] = steps["g"][:, 0], steps["e"][:, 0], rows["shared"]
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


def joined(arrays: Sequence[NDArray[np.void]], axis: int = 0) -> NDArray[np.void]:
    """Return np.concatenate of structured arrays, which NumPy joins ten times as slowly, field by field."""
    raw = np.dtype((np.void, arrays[0].itemsize))
    return np.concatenate([array.view(raw) for array in arrays], axis=axis).view(arrays[0].dtype)
