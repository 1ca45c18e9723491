"""A smoother over the last steps of a contact: Gauss-Newton on a sliding window, older steps marginalised.

Every step relinearises the whole window, vectorised over its factors, so that a step costs the same at frame 10 000 as
at frame 500. A step that leaves the window leaves behind a Gaussian on the steps it was tied to (Schur complement),
linearised where they stood before the last Gauss-Newton step. That Gaussian is on the offset of the turns as well,
which belongs to no step and stays as long as the contact.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from threadpoolctl import ThreadpoolController

from palpate import se2
from palpate.errors import EstimationError
from palpate.graph import factors
from palpate.graph.factors import ContactModel
from palpate.graph.noise import GraphNoise
from palpate.graph.normal_equations import (
    Block,
    DenseBlock,
    NeighbourBlock,
    NormalEquations,
    OffsetBlock,
    PairBlock,
    StepBlock,
)
from palpate.graph.smoother import OFFSET_SIGMA, Belief, check_tips, continued, last_pushing_error
from palpate.measurement import ContactDirection, Feeling, RelativePoses, Turn

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

LAG = 40
"""Steps in the window: the last one and the 39 before it, as far back as touch compares images."""

_ITERATIONS = 4
_CONVERGED = 1e-3  # [m], [rad]; the next frame takes another Gauss-Newton step, which leaves about its square
_G, _E, _BOTH = slice(0, 3), slice(3, 6), slice(0, 6)  # the unknowns of a step


class FixedLagSmoother:
    """Smoother over a window of `lag` steps; the cost of a step is bounded, whatever the length of the contact."""

    def __init__(self, tips: Sequence[ContactModel], noise: GraphNoise, lag: int = LAG) -> None:
        self._tips, self._noise, self._lag = tips, noise, lag
        # Matrices this small gain nothing from BLAS threads, and wait for them for half a second whenever another
        # process holds a core.
        self._threads = ThreadpoolController()

    def begin(self, sensor_pose: Array, object_pose: Array, covariance: Array, feeling: Feeling) -> None:
        """See Smoother."""
        check_tips(feeling, self._tips)
        self._measured = sensor_pose[None]
        self._poses = np.stack([se2.between(object_pose, sensor_pose), sensor_pose])[None]  # g and e, (steps, 2, 3)
        self._offset = 0.0  # [rad]
        self._first: tuple[Array, Array] | None = (object_pose, _inverse(np.linalg.cholesky(covariance)))
        self._marginal = _Marginal(np.empty((0, 2, 3)), 0.0, np.array([[OFFSET_SIGMA**-2.0]]), np.zeros(1))
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
        return Belief(self._poses[-1, 0], self._poses[-1, 1], self._covariance)

    def pushing_error(self) -> Array:
        """See Smoother."""
        moved = np.hypot(*(self._measured[-1] - self._measured[-2 if len(self._measured) > 1 else -1])[:2])
        return last_pushing_error(self._poses[:, 0], self._poses[:, 1], moved, self._tips, self._noise)

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
            self._offset = float(se2.wrap(self._poses[-1, 0, 2] - feeling.turn.angle))
            self._turned = True

    def _solve(self) -> None:
        for _ in range(_ITERATIONS):
            if self._improve() < _CONVERGED:
                break

    def _improve(self) -> float:
        """Take a Gauss-Newton step and return its largest change [m], [rad]."""
        self._at, self._offset_at, self._blocks = self._poses, self._offset, self._linearised()
        normal = NormalEquations(len(self._at), self._blocks)
        try:
            # Transposed, the symmetric matrix is in LAPACK's order and need not be copied.
            root, _ = factor = cho_factor(normal.matrix.T, lower=True, overwrite_a=True, check_finite=False)
        except LinAlgError:
            raise EstimationError("the linear system of the window is indeterminate") from None
        change = cho_solve(factor, normal.vector, check_finite=False)
        if not np.isfinite(change).all():
            raise EstimationError("the solution of the window is not finite")
        self._poses = se2.compose(self._at, se2.exp(change[:-1].reshape(self._at.shape)))
        self._offset = self._offset_at + float(change[-1])
        # The last step and the offset come last in the elimination: their block of the root is that of their marginal.
        last = np.linalg.inv(np.tril(root[-7:, -7:]))
        self._covariance = (last.T @ last)[:6, :6]
        return float(np.abs(change).max())

    def _marginalise(self) -> None:
        """Replace the oldest step by a Gaussian on the others and the offset, as its factors were last linearised."""
        normal = NormalEquations(len(self._at), (block.of_oldest() for block in self._blocks))
        information, gradient = normal.matrix, normal.vector
        try:
            gain = np.linalg.solve(information[:6, :6], np.column_stack([information[:6, 6:], gradient[:6]]))
        except LinAlgError:
            raise EstimationError("the step that leaves the window is indeterminate") from None
        left = information[6:, 6:] - information[6:, :6] @ gain[:, :-1]
        gradient = gradient[6:] - information[6:, :6] @ gain[:, -1]
        self._marginal = _Marginal(self._at[1:], self._offset_at, 0.5 * (left + left.T), gradient)
        self._first = None
        self._pairs = self._pairs.without_oldest()
        self._directions, self._turns = self._directions[1:], self._turns[1:]
        self._left.append(self._poses[0].copy())  # not a view that keeps the whole window
        self._poses, self._measured = self._poses[1:], self._measured[1:]

    def _linearised(self) -> list[Block]:
        """All factors, linearised at the estimate."""
        g, e, noise = self._poses[:, 0], self._poses[:, 1], self._noise
        blocks: list[Block] = [StepBlock(_E, *factors.prior(e, self._measured), np.square(noise.sensor) ** -1.0)]
        moved = np.hypot(*(self._measured[1:, :2] - self._measured[:-1, :2]).T)
        for tip in self._tips:
            residual, jacobian = factors.contact(g, tip)
            blocks.append(StepBlock(_G, residual, jacobian, noise.contact_weight(residual)))
            if len(g) > 1:
                residual, jacobian = factors.pushing(g[:-1], e[:-1], g[1:], e[1:], tip)
                blocks.append(NeighbourBlock(residual, jacobian, noise.pushing_weight(residual, moved, tip)))
        if len(self._pairs.i):
            i, j = self._pairs.i, self._pairs.j
            blocks.append(PairBlock(i, j, *factors.between(g[i], g[j], self._pairs.pose), self._pairs.information))
        if self._directions[:, 1].any():
            angle, information = self._directions.T
            residual, jacobian = factors.direction(g, angle, self._tips[0])
            weight = noise.feeling_weight(residual, information[:, None])
            blocks.append(StepBlock(_G, residual, jacobian, weight))
        if self._turns[:, 1].any():
            angle, information = self._turns.T
            residual, jacobian = factors.turn(g, self._offset, angle)
            blocks.append(OffsetBlock(residual, jacobian, noise.feeling_weight(residual, information[:, None])))
        if self._first is not None:
            object_pose, root = self._first
            residual, jacobian = factors.first_pose(g[0], e[0], object_pose)
            blocks.append(StepBlock(_BOTH, (root @ residual)[None], (root @ jacobian)[None], np.ones((1, 3))))
        blocks.append(self._marginal.at(self._poses, self._offset))
        return blocks


def _inverse(matrix: NDArray[np.floating]) -> Array:
    return np.linalg.inv(matrix).astype(np.float64, copy=False)


def _joined(angles: Array, said: ContactDirection | Turn | None) -> Array:
    """Add a step to angles (N, 2), each with its inverse variance [rad, 1/rad^2]; 0 where nothing is said."""
    last = [0.0, 0.0] if said is None else [said.angle, 1.0 / said.variance]
    return np.concatenate([angles, [last]])


@dataclass(frozen=True)
class _Marginal:
    """What was known of the offset, and what the steps that left the window say about it and the oldest ones then."""

    poses: Array
    """Where it was linearised, (N, 2, 3) [m, m, rad]."""
    offset: float
    """The same of the offset [rad]."""
    information: Array
    """(6 N + 1, 6 N + 1)"""
    gradient: Array
    """Negative gradient there, (6 N + 1,)."""

    def at(self, poses: Array, offset: float) -> DenseBlock:
        """Linearise at other poses (at least N, 2, 3) and another offset."""
        change = se2.log(se2.between(self.poses, poses[: len(self.poses)])).ravel()
        change = np.append(change, offset - self.offset)
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
