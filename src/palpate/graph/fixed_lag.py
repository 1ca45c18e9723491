"""A smoother over the last steps of a contact: Gauss-Newton on a sliding window, older steps marginalised.

Every step relinearises the whole window, vectorised over its factors, so that a step costs the same at frame 10 000 as
at frame 500. A step that leaves the window leaves behind a Gaussian on the steps it was tied to (Schur complement),
linearised where they stood before the last Gauss-Newton step.
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
    PairBlock,
    StepBlock,
)
from palpate.graph.smoother import Belief, continued, last_pushing_error
from palpate.measurement import RelativePoses

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

LAG = 40
"""Steps in the window: the last one and the 39 before it, as far back as touch compares images."""

_ITERATIONS = 4
_CONVERGED = 1e-3  # [m], [rad]; the next frame takes another Gauss-Newton step, which leaves about its square
_G, _E = slice(0, 3), slice(3, 6)  # the unknowns of a step


class FixedLagSmoother:
    """Smoother over a window of `lag` steps; the cost of a step is bounded, whatever the length of the contact."""

    def __init__(self, tips: Sequence[ContactModel], noise: GraphNoise, lag: int = LAG) -> None:
        self._tips, self._noise, self._lag = tips, noise, lag
        # Matrices this small gain nothing from BLAS threads, and wait for them for half a second whenever another
        # process holds a core.
        self._threads = ThreadpoolController()

    def begin(self, sensor_pose: Array, object_pose: Array, covariance: Array) -> None:
        """See Smoother."""
        self._measured = sensor_pose[None]
        self._poses = np.stack([se2.between(object_pose, sensor_pose), sensor_pose])[None]  # g and e, (steps, 2, 3)
        self._first: tuple[Array, Array] | None = (object_pose, _inverse(covariance))
        self._marginal: _Marginal | None = None
        self._pairs = _NO_PAIRS
        self._left: list[Array] = []
        with self._threads.limit(limits=1, user_api="blas"):
            self._solve()

    def add(self, sensor_pose: Array, relative: RelativePoses | None) -> None:
        """See Smoother."""
        with self._threads.limit(limits=1, user_api="blas"):
            if len(self._poses) == self._lag:
                self._marginalise()
            now = len(self._poses)
            guess = np.stack([continued(self._poses[-2:, 0]), sensor_pose])
            self._measured = np.concatenate([self._measured, sensor_pose[None]])
            self._poses = np.concatenate([self._poses, guess[None]])
            if relative is not None:
                self._pairs = self._pairs.joined(relative, now)
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

    def _solve(self) -> None:
        for _ in range(_ITERATIONS):
            if self._improve() < _CONVERGED:
                break

    def _improve(self) -> float:
        """Take a Gauss-Newton step and return its largest change [m], [rad]."""
        self._at, self._blocks = self._poses, self._linearised()
        normal = NormalEquations(len(self._at), self._blocks)
        try:
            root, _ = factor = cho_factor(normal.matrix(), lower=True, overwrite_a=True, check_finite=False)
        except LinAlgError:
            raise EstimationError("the linear system of the window is indeterminate") from None
        change = cho_solve(factor, normal.vector(), check_finite=False).reshape(self._at.shape)
        if not np.isfinite(change).all():
            raise EstimationError("the solution of the window is not finite")
        self._poses = se2.compose(self._at, se2.exp(change))
        # The last step comes last in the elimination, so its block of the root is that of its marginal.
        last = np.linalg.inv(np.tril(root[-6:, -6:]))
        self._covariance = last.T @ last
        return float(np.abs(change).max())

    def _marginalise(self) -> None:
        """Replace the oldest step by a Gaussian on the others, as its factors were last linearised."""
        normal = NormalEquations(len(self._at), (block.of_oldest() for block in self._blocks))
        information, gradient = normal.matrix(), normal.vector()
        try:
            gain = np.linalg.solve(information[:6, :6], np.column_stack([information[:6, 6:], gradient[:6]]))
        except LinAlgError:
            raise EstimationError("the step that leaves the window is indeterminate") from None
        left = information[6:, 6:] - information[6:, :6] @ gain[:, :-1]
        self._marginal = _Marginal(
            self._at[1:], 0.5 * (left + left.T), gradient[6:] - information[6:, :6] @ gain[:, -1]
        )
        self._first = None
        self._pairs = self._pairs.without_oldest()
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
        if self._first is not None:
            object_pose, information = self._first
            residual, jacobian = factors.first_pose(g[0], e[0], object_pose)
            pulled = jacobian.T @ information
            blocks.append(DenseBlock(pulled @ jacobian, -pulled @ residual))
        if self._marginal is not None:
            blocks.append(self._marginal.at(self._poses))
        return blocks


def _inverse(covariance: Array) -> Array:
    return np.linalg.inv(covariance).astype(np.float64, copy=False)


@dataclass(frozen=True)
class _Marginal:
    """What the steps that left the window say about those that were oldest in it then."""

    poses: Array
    """Where it was linearised, (N, 2, 3) [m, m, rad]."""
    information: Array
    """(6 N, 6 N)"""
    gradient: Array
    """Negative gradient there, (6 N,)."""

    def at(self, poses: Array) -> DenseBlock:
        """Linearise at other poses (at least N, 2, 3)."""
        change = se2.log(se2.between(self.poses, poses[: len(self.poses)])).ravel()
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
