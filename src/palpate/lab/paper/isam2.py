"""The paper's smoother: GTSAM's iSAM2 over all steps of a contact.

GTSAM eliminates, we linearise. A Python factor inside GTSAM gets a copy of all values at each call; so factors are
linearised here, all terms at once, and GTSAM is given the sums of their squares, which are linear. Its variables are
how far the unknowns moved from a first guess, in tangent space: one for each unknown of BLOCK steps in a row, for GTSAM
counts its work in variables, and one for what all steps share, which it eliminates last.

The terms of the newest blocks, as far back as terms reach, are linearised anew at every update, kernels and weights
included. Those of an older block wait until something they are on moved by more than a threshold.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError
from palpate.filter.belief import Belief, Prior
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.factor import Factor, Step, Terms
from palpate.graph.factors.first_pose import FirstPose
from palpate.graph.term_group import TermGroup, chosen
from palpate.graph.values import ANGLE_STEPS, Values
from palpate.graph.variables import (
    CONTACT_SIZE,
    IN_SHARED,
    LAG,
    OBJECT_SIZE,
    OF_CONTACT,
    OF_STEP,
    SENSOR,
    SENSOR_IN_OBJECT,
    SHARED_SIZE,
    STEP_SIZE,
)
from palpate.lab.paper.gtsam_quadratic import BLOCK, IN_BLOCK
from palpate.lab.paper.gtsam_solver import GtsamSolver, Quadratic
from palpate.lab.paper.tangent_squares import add_squares, by_moved
from palpate.types.measurements import Measurement

Array = NDArray[np.float64]

RELINEARISE_ABOVE = (2e-3, 2e-3, 5e-3)
"""[m, m, rad]. The published 0.01 lets a pose be 10 mm off its linearisation, too coarse for touch; yaw that is off by
5e-3 leaves an error of 1e-5 of a length."""
RELINEARISE_SHARED_ABOVE = 0.1
"""[rad], [m], 1. What steps share is in all terms, so that all would be relinearised, and they are nearly linear in
it."""

_UPDATES = 4  # at most for a step; the next frame takes another one
_CONVERGED = (5e-4, 5e-4, 3e-3)  # [m, m, rad]; an update that moves the newest steps by less is the last one, unless
_REWEIGHED = 0.5  # [standard deviations] an error changed by more because its weight did: the contact holds or slides


class Isam2:
    """Smoother over the whole contact; a step gets dearer as the contact goes on. See Smoother."""

    def __init__(
        self,
        factors: Sequence[Factor],
        model: ContactModel,
        prior: Prior,
        sensor_pose: Array,
        measurements: Sequence[Measurement] = (),
        time: float = 0.0,
    ) -> None:
        """Begin with the first frame of a contact and what is known of the object."""
        self._factors = [FirstPose([prior]), *factors]
        self._begun = [False] * len(self._factors)
        mean = [one.prior[0] if one.prior else 0.0 for one in OF_CONTACT for _ in range(one.dimension)]
        spread = [one.prior[1] if one.prior else np.inf for one in OF_CONTACT for _ in range(one.dimension)]
        self._solver = GtsamSolver(np.append(np.isfinite(spread), [False] * OBJECT_SIZE).astype(np.float64))
        # In units of what is known beforehand what is shared is of one size, on which GTSAM's Cholesky insists.
        of_contact = np.where(np.isfinite(spread), spread, 1.0)
        self._unit = np.append(of_contact, np.sqrt(np.diag(prior.covariance)[3:]))
        guess = {SENSOR_IN_OBJECT: se2.between(prior.pose, sensor_pose)[None, None], SENSOR: sensor_pose[None, None]}
        self._guess = Values(model, guess, np.append(mean, prior.values)[:, None])
        self._moved, self._shared_moved = np.zeros((1, STEP_SIZE)), np.zeros(SHARED_SIZE)
        self._linear_at_shared = self._shared_moved
        self._measured, self._times, self._reach = sensor_pose, [time], 1
        self._newest, self._old = TermGroup([None] * len(self._factors)), list[TermGroup]()
        self._stale = set[int]()
        step = Step(sensor_pose, None, measurements, self._times)
        self._join([factor.terms(step) for factor in self._factors])
        self._solve()

    def add(self, sensor_pose: Array, measurements: Sequence[Measurement] = (), time: float = 0.0) -> None:
        """See Smoother."""
        step = Step(sensor_pose, self._measured, measurements, [*self._times, time])
        new = [factor.terms(step) for factor in self._factors]  # before anything changes: they may refuse
        self._continue(sensor_pose)
        self._measured = sensor_pose
        self._times.append(time)
        self._join(new)
        self._solve()

    def belief(self) -> Belief:
        """See Smoother."""
        values = self._values(self._steps - 1)
        objects = values.shared[CONTACT_SIZE:, 0]
        return Belief(values[SENSOR_IN_OBJECT][0, 0], values[SENSOR][0, 0], objects, self._covariance)

    def path(self) -> tuple[Array, Array]:
        """See Smoother."""
        values = self._values()
        return values[SENSOR_IN_OBJECT][0], values[SENSOR][0]

    def last_errors(self) -> dict[str, Array]:
        """See Smoother."""
        first = max(self._steps - ANGLE_STEPS - 1, 0)
        values, errors = self._values(first), {}
        for factor, terms in zip(self._factors, self._newest.terms, strict=True):
            if factor.tells_strain and terms is not None:
                last = terms.places[:, -1] == self._steps - 1
                if last.any():
                    rows = factor.linearise(values, Terms(terms.places[last] - first, terms.data[last]))
                    errors[factor.name] = np.abs(rows.residual * np.sqrt(rows.information))[0].max(axis=0)
        return errors

    @property
    def _steps(self) -> int:
        return len(self._moved)

    @property
    def _blocks(self) -> int:
        """How many blocks there are; those in `_old` come first."""
        return (self._steps - 1) // BLOCK + 1

    def _values(self, first: int = 0, end: int | None = None) -> Values:
        """The estimate at steps."""
        guess = self._guess.with_steps(lambda value: value[:, first:end])
        return guess.moved(self._moved[None, first:end], self._shared_moved[None])

    def _continue(self, sensor_pose: Array) -> None:
        """Begin a step: the sensor goes on turning on the object as it did."""
        g = self._values(max(self._steps - 2, 0))[SENSOR_IN_OBJECT][0]
        guess = {SENSOR_IN_OBJECT: se2.compose(g[-1], se2.between(g[0], g[-1])), SENSOR: sensor_pose}
        of_steps = {one: np.concatenate([self._guess[one], new[None, None]], axis=1) for one, new in guess.items()}
        self._guess = Values(self._guess.model, of_steps, self._guess.shared)
        self._moved = np.append(self._moved, np.zeros((1, STEP_SIZE)), axis=0)

    def _join(self, new: Sequence[Terms | None]) -> None:
        """Take the terms that arrive with the last step, and let go of blocks that are no longer among the newest."""
        for which, arrived in enumerate(new):
            if arrived is None:
                continue
            terms = Terms(arrived.places + self._steps - 1, arrived.data)
            if (terms.places[:, 0] < 0).any():
                terms = chosen(terms, terms.places[:, 0] >= 0)
            if not len(terms.data):
                continue
            if not self._begun[which]:
                self._begun[which] = True
                for unknown, value in self._factors[which].first_guess(self._values(), terms).items():
                    place = IN_SHARED[unknown]
                    self._shared_moved[place] = value[0] - self._guess.shared[place, 0]
            self._reach = max(self._reach, int((terms.places[:, -1] - terms.places[:, 0]).max()))
            blocks = terms.places[:, 0] // BLOCK
            late = blocks < len(self._old)
            for block in set(blocks[late].tolist()):
                self._old[block].append(which, chosen(terms, blocks == block))
                self._stale.add(block)
            self._newest.append(which, chosen(terms, ~late) if late.any() else terms)
        count = -(-min(self._reach, LAG - 1) // BLOCK) + 1
        while self._blocks - len(self._old) > count:
            self._stale.add(len(self._old))
            self._old.append(self._newest.split(BLOCK * (len(self._old) + 1)))

    def _solve(self) -> None:
        """Update until the newest steps are settled."""
        try:
            for _ in range(_UPDATES):
                self._update()
                if self._is_settled():
                    break
            self._covariance = self._last_covariance()
        except RuntimeError as error:
            raise EstimationError(f"step {self._steps - 1} of the contact is indeterminate") from error
        if not np.isfinite(self._moved).all():
            raise EstimationError(f"the solution at step {self._steps - 1} of the contact is not finite")
        self._find_stale()

    def _is_settled(self) -> bool:
        """Whether another update would change little."""
        if self._is_far(len(self._old), self._newest, _limits(_CONVERGED)):
            return False
        first = max(self._steps - 2 * ANGLE_STEPS, 0)
        values = self._values(first)
        for factor, terms, before in self._weights:
            rows = factor.linearise(values, Terms(terms.places - first, terms.data))
            if (np.abs((np.sqrt(rows.weight) - before) * rows.residual) > _REWEIGHED).any():
                return False
        return True

    def _find_stale(self) -> None:
        """Find the older blocks whose terms are on something that moved too far since they were linearised."""
        old = len(self._old)
        if (np.abs(self._shared_moved - self._linear_at_shared) > RELINEARISE_SHARED_ABOVE).any():
            self._stale.update(range(old))
            self._linear_at_shared = self._shared_moved
        # Each block is looked at once in BLOCK steps; what moves one far moves others.
        limits = _limits(RELINEARISE_ABOVE)
        if any(self._is_far(block, self._old[block], limits) for block in range(self._steps % BLOCK, old, BLOCK)):
            self._stale.update(block for block in range(old) if self._is_far(block, self._old[block], limits))

    def _is_far(self, first: int, group: TermGroup, limits: Array) -> bool:
        """Whether a step that terms of blocks from the first one are tied to moved by more than the limits."""
        moved = self._moved[BLOCK * first : BLOCK * first + len(group.at)]
        return bool((np.abs(moved - group.at) > limits).any())

    def _update(self) -> None:
        """Give GTSAM the newest terms and the stale ones as they are now, and take its estimate."""
        old, blocks = len(self._old), self._blocks
        remade = [(block, self._old[block].last // BLOCK + 1, self._old[block]) for block in sorted(self._stale)]
        remade.append((old, blocks, self._newest))
        self._weights = list[tuple[Factor, Terms, Array]]()
        forms = (self._squares(group, first, end) for first, end, group in remade)  # one at a time: they are large
        removed = [place for _, _, group in remade for place in group.linear]
        for (first, end, group), places in zip(remade, self._solver.update(forms, removed, blocks), strict=True):
            group.linear, group.at = places, self._moved[BLOCK * first : BLOCK * end]
        self._stale.clear()
        self._moved, shared_moved = self._solver.moved(self._steps)
        self._shared_moved = shared_moved * self._unit

    def _last_covariance(self) -> Array:
        """Covariance of the last step and of what belongs to the object, in the tangent space at the estimate."""
        by_all = np.diag(np.append(np.ones(STEP_SIZE), self._unit[CONTACT_SIZE:]))
        by_all[:STEP_SIZE, :STEP_SIZE] = by_moved(self._moved[-1:])[0]
        return by_all @ self._solver.covariance(self._steps - 1) @ by_all.T

    def _squares(self, group: TermGroup, first: int, end: int) -> Quadratic:
        """Return the squares of terms that are tied to blocks from the first one to before the end."""
        # The angle of the pushing force is sought over some steps more.
        before, after = max(BLOCK * first - ANGLE_STEPS, 0), BLOCK * end + ANGLE_STEPS
        at, moved = self._values(before, after), self._moved[before:after]
        index = BLOCK * STEP_SIZE * np.arange(end - first)[:, None, None] + IN_BLOCK
        index = index.reshape(-1, STEP_SIZE)[: self._steps - BLOCK * first]
        linear_at = np.zeros(BLOCK * STEP_SIZE * (end - first) + SHARED_SIZE)
        linear_at[index] = self._moved[BLOCK * first : BLOCK * end]
        linear_at[-SHARED_SIZE:] = self._shared_moved / self._unit
        matrix, vector, turns = np.zeros(2 * linear_at.shape), np.zeros_like(linear_at), by_moved(moved)
        index = np.concatenate([np.zeros((BLOCK * first - before, STEP_SIZE), np.int64), index])
        for factor, terms in zip(self._factors, group.terms, strict=True):
            if terms is not None:
                here = Terms(terms.places - before, terms.data)
                rows = factor.linearise(at, here)
                first_of, size = factor.columns
                into = turns, self._unit, index, matrix, vector
                add_squares(rows.residual, rows.jacobian, rows.weight, here.places, first_of, size, *into)
                last = terms.places[:, 0] >= self._steps - ANGLE_STEPS
                if group is self._newest and last.any():
                    self._weights.append((factor, chosen(terms, last), np.sqrt(rows.weight[:, last])))
        vector += matrix @ linear_at
        to_come = IN_BLOCK[(self._steps - 1) % BLOCK + 1 :] + BLOCK * STEP_SIZE * (end - first - 1)
        if group is self._newest:
            matrix[to_come, to_come] = 1.0  # of steps that are still to come nothing is known
        return Quadratic(first, end, matrix, vector)


def _limits(limit: tuple[float, float, float]) -> Array:
    """Limits of the changes of a step's numbers, given those of a pose, (STEP_SIZE,)."""
    return np.tile(limit, len(OF_STEP))
