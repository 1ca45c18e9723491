"""The paper's smoother: GTSAM's iSAM2 over all steps of a contact.

Relative poses, turns and sensor priors are native. What is left for Python, contact, its direction and pushing, is one
custom factor a step: each call copies all values of the graph into Python, so their number decides the time.
"""

from collections.abc import Callable, Sequence

import gtsam
import numpy as np
from numpy.typing import NDArray

from palpate import se2
from palpate.errors import EstimationError
from palpate.graph import factors
from palpate.graph.factors import ContactModel
from palpate.graph.noise import GraphNoise
from palpate.graph.smoother import OFFSET_SIGMA, Belief, check_tips, continued, last_pushing_error
from palpate.measurement import ContactDirection, Feeling, Turn

Array = NDArray[np.float64]
RELINEARISE_ABOVE = 2e-3
"""[m], [rad]. The published 0.01 lets a pose be 10 mm off its linearisation, too coarse for touch."""

_ANYWHERE = 1e3  # [m]; the standard deviation of what a turn does not say
_OFFSET = gtsam.symbol("b", 0)
_EXTRA_UPDATES = 2  # more Gauss-Newton steps where the last pose turned out to be far from its first guess

Linearisation = Callable[..., tuple[Array, Array]]


class Isam2Smoother:
    """Smoother over the whole contact; a step gets dearer as the contact goes on."""

    def __init__(self, tips: Sequence[ContactModel], noise: GraphNoise) -> None:
        self._tips, self._noise = tips, noise
        self._parameters = gtsam.ISAM2Params()
        self._parameters.setRelinearizeThreshold(RELINEARISE_ABOVE)
        self._parameters.relinearizeSkip = 1

    def begin(self, sensor_pose: Array, object_pose: Array, covariance: Array, feeling: Feeling) -> None:
        """See Smoother."""
        check_tips(feeling, self._tips)
        self._isam = gtsam.ISAM2(self._parameters)
        self._last, self._measured, self._moved = 0, sensor_pose, 0.0
        self._turned = False  # whether there was a turn in this contact
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        direction = feeling.direction  # what the closure keeps; the graph keeps the rest

        def first(g: Array, e: Array) -> tuple[Array, Array]:
            residual, jacobian = factors.first_pose(g, e, object_pose)
            touching = self._touching_rows(g, direction, 6, 0)
            return _stacked([(root @ residual, root @ jacobian), *touching])

        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(_custom([_g(0), _e(0)], 3 + self._touching(feeling), first))
        self._update(graph, se2.between(object_pose, sensor_pose), sensor_pose, feeling)

    def add(self, sensor_pose: Array, feeling: Feeling) -> None:
        """See Smoother."""
        check_tips(feeling, self._tips)
        last, now = self._last, self._last + 1
        moved = self._moved = float(np.hypot(*(sensor_pose - self._measured)[:2]))
        direction = feeling.direction

        def step(g0: Array, e0: Array, g1: Array, e1: Array) -> tuple[Array, Array]:
            rows = self._touching_rows(g1, direction, 12, 6)
            for tip in self._tips:
                residual, jacobian = factors.pushing(g0, e0, g1, e1, tip)
                root = np.sqrt(self._noise.pushing_weight(residual, np.asarray(moved), tip))
                rows.append((root * residual, root[:, None] * jacobian))
            return _stacked(rows)

        graph = gtsam.NonlinearFactorGraph()
        rows = 3 * len(self._tips) + self._touching(feeling)
        graph.push_back(_custom([_g(last), _e(last), _g(now), _e(now)], rows, step))
        if (relative := feeling.relative) is not None:
            for back, pose, covariance in zip(relative.back, relative.pose, relative.covariance, strict=True):
                noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
                graph.push_back(gtsam.BetweenFactorPose2(_g(now - back), _g(now), gtsam.Pose2(*pose), noise))
        self._last, self._measured = now, sensor_pose
        self._update(graph, continued(self._g), sensor_pose, feeling)

    def belief(self) -> Belief:
        """See Smoother."""
        return Belief(self._g[-1], self._e[-1], self._covariance)

    def pushing_error(self) -> Array:
        """See Smoother."""
        return last_pushing_error(self._g, self._e, self._moved, self._tips, self._noise)

    def path(self) -> tuple[Array, Array]:
        """See Smoother."""
        return self._steps(0)

    def _steps(self, first: int) -> tuple[Array, Array]:
        """Estimates of the steps from the first one on: g (N, 3) and e (N, 3)."""
        steps = range(first, self._last + 1)
        g = np.array([_array(self._isam.calculateEstimatePose2(_g(step))) for step in steps])
        e = np.array([_array(self._isam.calculateEstimatePose2(_e(step))) for step in steps])
        return g, e

    def _update(self, graph: gtsam.NonlinearFactorGraph, g: Array, e: Array, feeling: Feeling) -> None:
        """Add the factors of the last step with its first guess, and solve."""
        values = gtsam.Values()
        values.insert(_g(self._last), gtsam.Pose2(*g))
        values.insert(_e(self._last), gtsam.Pose2(*e))
        sensor = gtsam.noiseModel.Diagonal.Sigmas(np.array(self._noise.sensor))
        graph.push_back(gtsam.PriorFactorPose2(_e(self._last), gtsam.Pose2(*e), sensor))
        if feeling.turn is not None:
            self._push_turn(graph, values, feeling.turn, g)
        try:
            self._isam.update(graph, values)
            for _ in range(_EXTRA_UPDATES):
                guess, g = g, _array(self._isam.calculateEstimatePose2(_g(self._last)))
                if np.abs(se2.log(se2.between(guess, g))).max() < RELINEARISE_ABOVE:
                    break
                self._isam.update()
            self._g, self._e = self._steps(max(0, self._last - 1))
            self._covariance = self._isam.jointMarginalCovariance([_g(self._last), _e(self._last)]).fullMatrix()
        except RuntimeError as error:
            raise EstimationError(f"step {self._last} of the contact is indeterminate") from error

    def _push_turn(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, turn: Turn, g: Array) -> None:
        """Tie yaw of the last step, first guessed to be at g, to the offset, which the first turn brings into being."""
        if not self._turned:
            # A pose of which only yaw counts. Under its kernel a turn far off the offset would hardly pull.
            values.insert(_OFFSET, gtsam.Pose2(0.0, 0.0, g[2] - turn.angle))
            weak = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.0, 1.0, OFFSET_SIGMA]))
            graph.push_back(gtsam.PriorFactorPose2(_OFFSET, gtsam.Pose2(), weak))
            self._turned = True
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([_ANYWHERE, _ANYWHERE, np.sqrt(turn.variance)]))
        if self._noise.feeling_kernel is not None:
            kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(self._noise.feeling_kernel)
            noise = gtsam.noiseModel.Robust.Create(kernel, noise)
        graph.push_back(gtsam.BetweenFactorPose2(_OFFSET, _g(self._last), gtsam.Pose2(0.0, 0.0, turn.angle), noise))

    def _touching(self, feeling: Feeling) -> int:
        """How many rows `_touching_rows` has."""
        return len(self._tips) + (feeling.direction is not None)

    def _touching_rows(
        self, g: Array, direction: ContactDirection | None, columns: int, place: int
    ) -> list[tuple[Array, Array]]:
        """Whitened rows of contact and its direction with their Jacobians, g standing at column place."""
        rows = []
        for tip in self._tips:
            residual, by_g = factors.contact(g, tip)
            rows.append(_whitened(residual, by_g, self._noise.contact_weight(residual), columns, place))
        if direction is not None:
            residual, by_g = factors.direction(g, direction.angle, self._tips[0])
            weight = self._noise.feeling_weight(residual, 1.0 / direction.variance)
            rows.append(_whitened(residual, by_g, weight, columns, place))
        return rows


def _whitened(residual: Array, by_g: Array, weight: Array, columns: int, place: int) -> tuple[Array, Array]:
    """A row times the root of its weight, its Jacobian spread over the columns of all poses."""
    root = np.sqrt(weight)
    jacobian = np.zeros((1, columns))
    jacobian[:, place : place + 3] = root * by_g
    return root * residual, jacobian


def _custom(keys: list[int], rows: int, linearise: Linearisation) -> gtsam.CustomFactor:
    """A GTSAM factor on poses from whitened rows and their Jacobian."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        residual, jacobian = linearise(*(_array(values.atPose2(key)) for key in keys))
        if jacobians is not None:
            for place in range(len(keys)):
                jacobians[place] = np.asfortranarray(jacobian[:, 3 * place : 3 * place + 3])
        return residual

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(rows), keys, error)


def _stacked(rows: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    return np.concatenate([residual for residual, _ in rows]), np.concatenate([jacobian for _, jacobian in rows])


def _array(pose: gtsam.Pose2) -> Array:
    return np.array([pose.x(), pose.y(), pose.theta()])


def _g(step: int) -> int:
    return gtsam.symbol("g", int(step))


def _e(step: int) -> int:
    return gtsam.symbol("e", int(step))
