"""A smoother over the last steps of a contact: Gauss-Newton on a sliding window, older steps marginalised.

Every step relinearises the whole window, vectorised over its factors, so that a step costs the same at frame 10 000 as
at frame 500. A step that leaves the window leaves behind a Gaussian on the steps it was tied to (Schur complement),
linearised where they stood before the last Gauss-Newton step. That Gaussian is on what all steps share as well: the
offset of the turns, which stays as long as the contact, and what lasts from contact to contact.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from threadpoolctl import ThreadpoolController

from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph import factors
from palpate.graph.factors import ContactModel
from palpate.graph.noise import GraphNoise
from palpate.graph.normal_equations import (
    NOTHING,
    SHARED,
    Block,
    DenseBlock,
    NeighbourBlock,
    NormalEquations,
    PairBlock,
    StepBlock,
)
from palpate.graph.pushing import pushing, pushing_angle
from palpate.graph.smoother import OFFSET_SIGMA, Belief, Known, check_tips, continued, last_pushing_error
from palpate.recording.measurements import ContactDirection, Feeling, RelativePoses, Turn

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

LAG = 40
"""Steps in the window: the last one and the 39 before it, as far back as touch compares images."""

_ITERATIONS = 4
_CONVERGED = 3e-4  # [m], [rad] of the poses; the next frame takes another Gauss-Newton step
_G, _E, _BOTH = slice(0, 3), slice(3, 6), slice(0, 6)  # the unknowns of a step
_REPORTED = [*range(6), *range(7, 6 + SHARED)]  # of the last step and what is shared, all but the offset
_OFFSET, _BIAS, _DEPTH = slice(0, 1), slice(1, 2), slice(2, 3)
_FRICTION, _LASTING = slice(3, 7), slice(1, 7)  # those of all steps


class FixedLagSmoother:
    """Smoother over a window of `lag` steps; the cost of a step is bounded, whatever the length of the contact."""

    def __init__(self, tips: Sequence[ContactModel], noise: GraphNoise, lag: int = LAG) -> None:
        self._tips, self._noise, self._lag = tips, noise, lag
        # Matrices this small gain nothing from BLAS threads, and wait for them for half a second whenever another
        # process holds a core.
        self._threads = ThreadpoolController()

    def begin(self, sensor_pose: Array, known: Known, feeling: Feeling) -> None:
        """See Smoother."""
        check_tips(feeling, self._tips)
        self._measured = sensor_pose[None]
        self._poses = np.stack([se2.between(known.pose, sensor_pose), sensor_pose])[None]  # g and e, (steps, 2, 3)
        self._shared = np.concatenate([[0.0], known.lasting])
        self._first: tuple[Known, Array] | None = (known, _inverse(np.linalg.cholesky(known.covariance)))
        before = np.diag([OFFSET_SIGMA**-2.0, *np.zeros(SHARED - 1)])
        self._marginal = _Marginal(np.empty((0, 2, 3)), np.zeros(SHARED), before, np.zeros(SHARED))
        self._pairs = _NO_PAIRS
        self._directions = self._turns = _NO_ANGLES  # (steps, 2) each
        self._turned = False  # whether there was a turn in this contact
        self._take(feeling)
        self._left: list[Array] = []
        with self._threads.limit(limits=1, user_api="blas"):
            self._solve()

    def add(self, sensor_pose: Array, feeling: Feeling) -> None:
        """See Smoother."""
        check_tips(feeling, self._tips)
        with self._threads.limit(limits=1, user_api="blas"):
            if len(self._poses) == self._lag:
                self._marginalise()
            guess = np.stack([continued(self._poses[-2:, 0]), sensor_pose])
            self._measured = np.concatenate([self._measured, sensor_pose[None]])
            self._poses = np.concatenate([self._poses, guess[None]])
            self._take(feeling)
            self._solve()

    def belief(self) -> Belief:
        """See Smoother."""
        return Belief(self._poses[-1, 0], self._poses[-1, 1], self._shared[_LASTING], self._covariance)

    def pushing_error(self) -> Array:
        """See Smoother."""
        moved = np.hypot(*(self._measured[-1] - self._measured[-2 if len(self._measured) > 1 else -1])[:2])
        g, e = self._poses[:, 0], self._poses[:, 1]
        return last_pushing_error(g, e, self._shared[_LASTING], moved, self._tips, self._noise)

    def path(self) -> tuple[Array, Array]:
        """See Smoother; steps that left the window stay as they were last estimated in it."""
        poses = np.concatenate([np.array(self._left).reshape(-1, 2, 3), self._poses])
        return poses[:, 0], poses[:, 1]

    def _take(self, feeling: Feeling) -> None:
        """Join what touch says at the last step to what it said before."""
        if feeling.relative is not None:
            self._pairs = self._pairs.joined(feeling.relative, len(self._poses) - 1)
        self._directions = _joined(self._directions, feeling.direction)
        self._turns = _joined(self._turns, feeling.turn)
        if feeling.turn is not None and not self._turned:
            # Under its kernel a turn far off the offset would hardly pull.
            self._shared[0] = se2.wrap(self._poses[-1, 0, 2] - feeling.turn.angle)
            self._turned = True

    def _solve(self) -> None:
        for _ in range(_ITERATIONS):
            if self._improve() < _CONVERGED:
                break

    def _improve(self) -> float:
        """Take a Gauss-Newton step and return its largest change of a pose [m], [rad]."""
        self._at, self._shared_at, self._blocks = self._poses, self._shared, self._linearised()
        normal = NormalEquations(len(self._at), self._blocks)
        try:
            # Transposed, the symmetric matrix is in LAPACK's order and need not be copied.
            root, _ = factor = cho_factor(normal.matrix.T, lower=True, overwrite_a=True, check_finite=False)
        except LinAlgError:
            raise EstimationError("the linear system of the window is indeterminate") from None
        change = cho_solve(factor, normal.vector, check_finite=False)
        if not np.isfinite(change).all():
            raise EstimationError("the solution of the window is not finite")
        self._poses = se2.compose(self._at, se2.exp(change[:-SHARED].reshape(self._at.shape)))
        self._shared = self._shared_at + change[-SHARED:]
        # The last step and what is shared come last in the elimination: their block of the root is of their marginal.
        last = np.linalg.inv(np.tril(root[-6 - SHARED :, -6 - SHARED :]))
        self._covariance = (last.T @ last)[np.ix_(_REPORTED, _REPORTED)]
        return float(np.abs(change[:-SHARED]).max())

    def _marginalise(self) -> None:
        """Replace the oldest step by a Gaussian on the others and the offset, as its factors were last linearised."""
        farthest = self._pairs.j[self._pairs.i == 0].max(initial=1)
        tied = min(max(farthest + 1, len(self._marginal.poses)), len(self._at))  # itself and those after it
        normal = NormalEquations(tied, (block.of_oldest() for block in self._blocks))
        information, gradient = normal.matrix, normal.vector
        try:
            gain = np.linalg.solve(information[:6, :6], np.column_stack([information[:6, 6:], gradient[:6]]))
        except LinAlgError:
            raise EstimationError("the step that leaves the window is indeterminate") from None
        left = information[6:, 6:] - information[6:, :6] @ gain[:, :-1]
        gradient = gradient[6:] - information[6:, :6] @ gain[:, -1]
        self._marginal = _Marginal(self._at[1:tied], self._shared_at, 0.5 * (left + left.T), gradient)
        self._first = None
        self._pairs = self._pairs.without_oldest()
        self._directions, self._turns = self._directions[1:], self._turns[1:]
        self._left.append(self._poses[0].copy())  # not a view that keeps the whole window
        self._poses, self._measured = self._poses[1:], self._measured[1:]

    def _linearised(self) -> list[Block]:
        """All factors, linearised at the estimate."""
        g, e, noise = self._poses[:, 0], self._poses[:, 1], self._noise
        blocks: list[Block] = [
            StepBlock(_E, *factors.prior(e, self._measured), np.square(noise.sensor) ** -1.0, NOTHING)
        ]
        moved = np.hypot(*(self._measured[1:, :2] - self._measured[:-1, :2]).T)
        touches = [factors.touching(g, tip) for tip in self._tips]
        for tip, touch in zip(self._tips, touches, strict=True):
            residual, jacobian = factors.contact(touch, self._shared[2])
            blocks.append(StepBlock(_G, residual, jacobian, noise.contact_weight(residual), _DEPTH))
            if len(g) > 1:
                friction = self._shared[_FRICTION]
                angle = pushing_angle(g, e, touch, tip, friction)
                side = np.sign(angle)
                residual, jacobian = pushing(g[:-1], e[:-1], g[1:], e[1:], touch[1:], tip, friction, side)
                weight = noise.pushing_weight(residual, moved, tip, angle, friction[-1])
                blocks.append(NeighbourBlock(residual, jacobian, weight, _FRICTION))
        if len(self._pairs.i):
            i, j = self._pairs.i, self._pairs.j
            blocks.append(PairBlock(i, j, *factors.between(g[i], g[j], self._pairs.pose), self._pairs.information))
        if self._directions[:, 1].any():
            angle, information = self._directions.T
            residual, jacobian = factors.direction(touches[0], angle, self._shared[1])
            weight = noise.feeling_weight(residual, information[:, None] / noise.direction_share)
            blocks.append(StepBlock(_G, residual, jacobian, weight, _BIAS))
        if self._turns[:, 1].any():
            angle, information = self._turns.T
            residual, jacobian = factors.turn(g, self._shared[0], angle)
            weight = noise.feeling_weight(residual, information[:, None] / noise.turn_share)
            blocks.append(StepBlock(_G, residual, jacobian, weight, _OFFSET))
        if self._first is not None:
            known, root = self._first
            residual, jacobian = factors.known(g[0], e[0], self._shared[_LASTING], known.pose, known.lasting)
            weight = np.ones(len(residual))
            blocks.append(StepBlock(_BOTH, (root @ residual)[None], (root @ jacobian)[None], weight, _LASTING))
        blocks.append(self._marginal.at(self._poses, self._shared))
        return blocks


def _inverse(matrix: NDArray[np.floating]) -> Array:
    return np.linalg.inv(matrix).astype(np.float64, copy=False)


def _joined(angles: Array, said: ContactDirection | Turn | None) -> Array:
    """Add a step to angles (N, 2), each with its inverse variance [rad, 1/rad^2]; 0 where nothing is said."""
    last = [0.0, 0.0] if said is None else [said.angle, 1.0 / said.variance]
    return np.concatenate([angles, [last]])


@dataclass(frozen=True)
class _Marginal:
    """What was known of what is shared, and what the steps that left the window say of it and the oldest ones then."""

    poses: Array
    """Where it was linearised, (N, 2, 3) [m, m, rad]."""
    shared: Array
    """The same of what is shared, (SHARED,)."""
    information: Array
    """(6 N + SHARED, 6 N + SHARED)"""
    gradient: Array
    """Negative gradient there, (6 N + SHARED,)."""

    def at(self, poses: Array, shared: Array) -> DenseBlock:
        """Linearise at other poses (at least N, 2, 3) and other values of what is shared."""
        change = se2.log(se2.between(self.poses, poses[: len(self.poses)])).ravel()
        change = np.concatenate([change, shared - self.shared])
        return DenseBlock(self.information, self.gradient - self.information @ change)


@dataclass(frozen=True)
class _Pairs:
    """Relative poses between steps of the window."""

    i: Indices
    """Place of the earlier step in the window, (P,)."""
    j: Indices
    """Place of the later step, (P,)."""
    pose: Array
    """Measured `g_i^-1 g_j`, (P, 3) [m, m, rad]."""
    information: Array
    """Inverse covariance, (P, 3, 3)."""

    def joined(self, relative: RelativePoses, now: int) -> "_Pairs":
        """Add what touch says at step now, as far as the window reaches."""
        kept = relative.back <= now
        back = relative.back[kept]
        return _Pairs(
            np.concatenate([self.i, now - back]),
            np.concatenate([self.j, np.full(len(back), now)]),
            np.concatenate([self.pose, relative.pose[kept]]),
            np.concatenate([self.information, _inverse(relative.covariance[kept])]),
        )

    def without_oldest(self) -> "_Pairs":
        """Those not tied to the oldest step, with the window moved on by a step."""
        kept = self.i > 0
        return _Pairs(self.i[kept] - 1, self.j[kept] - 1, self.pose[kept], self.information[kept])


_NO_PAIRS = _Pairs(np.empty(0, int), np.empty(0, int), np.empty((0, 3)), np.empty((0, 3, 3)))
_NO_ANGLES = np.empty((0, 2))
