"""The paper's smoother: GTSAM's iSAM2 over all steps of a contact.

Relative poses, turns and sensor priors are native. What is left for Python, contact, its direction and pushing, is one
custom factor a step: each call copies all values of the graph into Python, so their number decides the time.

A custom factor has its own two steps at hand and what lasts, but the angle of the pushing force, which says whether the
contact sticks, is sought over several steps. So the weights of pushing are given to it as they are at the estimate, and
for ANGLE_STEPS steps it is replaced whenever they change. What is learnt later does not change them, as it does in the
fixed lag.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph import factors
from palpate.graph.factors import ContactModel, Touching
from palpate.graph.noise import GraphNoise
from palpate.graph.pushing import ANGLE_STEPS, pushing, pushing_angle
from palpate.graph.smoother import (
    DEPTH,
    FRICTION,
    LASTING,
    OFFSET_SIGMA,
    Belief,
    Known,
    check_tips,
    continued,
    last_pushing_error,
)
from palpate.recording.measurements import ContactDirection, Feeling, Turn

Array = NDArray[np.float64]
RELINEARISE_ABOVE = (2e-3, 2e-3, 5e-3)
"""[m, m, rad]. The published 0.01 lets a pose be 10 mm off its linearisation, too coarse for touch; yaw that is off by
5e-3 leaves an error of 1e-5 of a length."""
RELINEARISE_LASTING_ABOVE = 0.05
"""[rad], [m], 1. What lasts is in all factors, so that all would be relinearised, and they are nearly linear in it."""

_ANYWHERE = 1e3  # [m]; the standard deviation of what a turn does not say
_OFFSET, _LASTING = gtsam.symbol("b", 0), gtsam.symbol("l", 0)
_BIAS = 0  # of what lasts
_UPDATES = 4  # at most for a step, as long as weights or the last pose change
_CHANGED = 0.2  # share by which a weight must change for its factor to be replaced

Linearisation = Callable[..., tuple[Array, Array]]


@dataclass
class _Pushed:
    """A step whose angle of force is not settled yet."""

    now: int
    moved: float
    """Way of the sensor [m]."""
    feeling: Feeling
    place: int = -1
    """Of its factor among all; -1 before it is there."""
    weights: Array = field(default_factory=lambda: np.empty(0))
    """Side of the cone and inverse variances of the pushing rows, (tips, 5)."""


class Isam2Smoother:
    """Smoother over the whole contact; a step gets dearer as the contact goes on."""

    def __init__(self, tips: Sequence[ContactModel], noise: GraphNoise) -> None:
        self._tips, self._noise = tips, noise
        self._parameters = gtsam.ISAM2Params()
        thresholds = gtsam.ISAM2ThresholdMap()
        for name in "geb":
            thresholds.insert((name, np.array(RELINEARISE_ABOVE)))
        thresholds.insert(("l", np.full(LASTING, RELINEARISE_LASTING_ABOVE)))
        self._parameters.setRelinearizeThreshold(thresholds)
        self._parameters.relinearizeSkip = 1
        self._parameters.setFactorization("QR")  # Cholesky fails where slip and balance are known well

    def begin(self, sensor_pose: Array, known: Known, feeling: Feeling) -> None:
        """See Smoother."""
        check_tips(feeling, self._tips)
        self._isam = gtsam.ISAM2(self._parameters)
        self._last, self._measured, self._moved = 0, sensor_pose, 0.0
        self._turned = False  # whether there was a turn in this contact
        self._recent: list[_Pushed] = []
        self._g = self._e = np.empty((0, 3))
        self._lasting = known.lasting
        root = np.linalg.inv(np.linalg.cholesky(known.covariance))
        direction = feeling.direction  # what the closure keeps; the graph keeps the rest

        def first(g: Array, e: Array, lasting: Array) -> tuple[Array, Array]:
            residual, jacobian = factors.known(g, e, lasting, known.pose, known.lasting)
            touches = [factors.touching(g, tip) for tip in self._tips]
            rows = self._touching_rows(touches, lasting, direction, 0, 6)
            return _stacked([(root @ residual, root @ jacobian), *rows])

        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        graph.push_back(_custom([_g(0), _e(0), _LASTING], 3 + LASTING + self._touching(feeling), first))
        values.insert(_LASTING, known.lasting)
        self._update(graph, values, se2.between(known.pose, sensor_pose), sensor_pose, feeling)

    def add(self, sensor_pose: Array, feeling: Feeling) -> None:
        """See Smoother."""
        check_tips(feeling, self._tips)
        now = self._last + 1
        self._moved = float(np.hypot(*(sensor_pose - self._measured)[:2]))
        self._recent = [*self._recent[-ANGLE_STEPS:], _Pushed(now, self._moved, feeling)]
        graph = gtsam.NonlinearFactorGraph()
        if (relative := feeling.relative) is not None:
            for back, pose, covariance in zip(relative.back, relative.pose, relative.covariance, strict=True):
                noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
                graph.push_back(gtsam.BetweenFactorPose2(_g(now - back), _g(now), gtsam.Pose2(*pose), noise))
        self._last, self._measured = now, sensor_pose
        self._update(graph, gtsam.Values(), continued(self._g[-2:]), sensor_pose, feeling)

    def belief(self) -> Belief:
        """See Smoother."""
        return Belief(self._g[-1], self._e[-1], self._lasting, self._covariance)

    def pushing_error(self) -> Array:
        """See Smoother."""
        return last_pushing_error(self._g, self._e, self._lasting, self._moved, self._tips, self._noise)

    def path(self) -> tuple[Array, Array]:
        """See Smoother."""
        return self._steps(0)

    def _steps(self, first: int) -> tuple[Array, Array]:
        """Estimates of the steps from the first one on: g (N, 3) and e (N, 3)."""
        steps = range(first, self._last + 1)
        g = np.array([_array(self._isam.calculateEstimatePose2(_g(step))) for step in steps])
        e = np.array([_array(self._isam.calculateEstimatePose2(_e(step))) for step in steps])
        return g, e

    def _update(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, g: Array, e: Array, feeling: Feeling
    ) -> None:
        """Add factors and the last step with its first guess, and solve until little changes."""
        values.insert(_g(self._last), gtsam.Pose2(*g))
        values.insert(_e(self._last), gtsam.Pose2(*e))
        sensor = gtsam.noiseModel.Diagonal.Sigmas(np.array(self._noise.sensor))
        graph.push_back(gtsam.PriorFactorPose2(_e(self._last), gtsam.Pose2(*e), sensor))
        if feeling.turn is not None:
            self._push_turn(graph, values, feeling.turn, g)
        self._g, self._e = np.concatenate([self._g, g[None]]), np.concatenate([self._e, e[None]])
        try:
            weighed = self._weighed()
            for _ in range(_UPDATES):
                for step in weighed:
                    graph.push_back(self._factor(step))
                replaced = [step.place for step in weighed if step.place >= 0]
                places = self._isam.update(graph, values, replaced).getNewFactorsIndices()
                for step, place in zip(weighed, places[len(places) - len(weighed) :], strict=True):
                    step.place = place
                graph, values, before = gtsam.NonlinearFactorGraph(), gtsam.Values(), self._g[-1]
                self._g, self._e = self._steps(max(0, self._last - 2 * ANGLE_STEPS))
                self._lasting = self._isam.calculateEstimateVector(_LASTING)
                weighed = self._weighed()
                if not weighed and (np.abs(se2.log(se2.between(before, self._g[-1]))) < RELINEARISE_ABOVE).all():
                    break
            keys = [_g(self._last), _e(self._last), _LASTING]
            joint = self._isam.jointMarginalCovariance(keys)
            self._covariance = np.block([[joint.at(row, column) for column in keys] for row in keys])
        except RuntimeError as error:
            raise EstimationError(f"step {self._last} of the contact is indeterminate") from error

    def _weighed(self) -> list["_Pushed"]:
        """Weigh the recent steps at the estimates, and return those whose weights changed."""
        count = len(self._recent)
        if not count:
            return []
        g, e, friction = self._g, self._e, self._lasting[FRICTION]
        moved = np.array([step.moved for step in self._recent])
        before, after = slice(-count - 1, -1), slice(-count, None)
        found = []
        for tip in self._tips:
            touch = factors.touching(g, tip)
            angle = pushing_angle(g, e, touch, tip, friction)[-count:]
            steps = g[before], e[before], g[after], e[after], touch[after]
            residual, _ = pushing(*steps, tip, friction, np.sign(angle))
            if self._recent[-1].place < 0:
                residual[-1] = 0.0  # a first guess tells nothing of it
            weight = self._noise.pushing_weight(residual, moved, tip, angle, friction[-1])
            found.append(np.column_stack([np.sign(angle), weight]))
        changed = []
        for step, weights in zip(self._recent, np.stack(found, axis=1), strict=True):
            if step.place < 0 or (np.abs(weights - step.weights) > _CHANGED * np.abs(step.weights)).any():
                step.weights = weights
                changed.append(step)
        return changed

    def _factor(self, step: "_Pushed") -> gtsam.CustomFactor:
        """Contact, direction and pushing at a step, on it and the one before."""
        direction, weights = step.feeling.direction, step.weights

        def linearise(g0: Array, e0: Array, g1: Array, e1: Array, lasting: Array) -> tuple[Array, Array]:
            touches = [factors.touching(g1, tip) for tip in self._tips]
            rows = self._touching_rows(touches, lasting, direction, 6, 12)
            for tip, touch, (side, *weight) in zip(self._tips, touches, weights, strict=True):
                residual, jacobian = pushing(g0, e0, g1, e1, touch, tip, lasting[FRICTION], side)
                parts = {0: jacobian[:, :12], 12 + FRICTION.start: jacobian[:, 12:]}
                rows.append(_whitened(residual, parts, np.array(weight), 12 + LASTING))
            return _stacked(rows)

        keys = [_g(step.now - 1), _e(step.now - 1), _g(step.now), _e(step.now), _LASTING]
        return _custom(keys, 4 * len(self._tips) + self._touching(step.feeling), linearise)

    def _push_turn(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, turn: Turn, g: Array) -> None:
        """Tie yaw of the last step, first guessed to be at g, to the offset, which the first turn brings into being."""
        if not self._turned:
            # A pose of which only yaw counts. Under its kernel a turn far off the offset would hardly pull.
            values.insert(_OFFSET, gtsam.Pose2(0.0, 0.0, g[2] - turn.angle))
            weak = gtsam.noiseModel.Diagonal.Sigmas(np.array([1.0, 1.0, OFFSET_SIGMA]))
            graph.push_back(gtsam.PriorFactorPose2(_OFFSET, gtsam.Pose2(), weak))
            self._turned = True
        deviation = np.sqrt(turn.variance * self._noise.turn_share)
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([_ANYWHERE, _ANYWHERE, deviation]))
        if self._noise.feeling_kernel is not None:
            kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(self._noise.feeling_kernel)
            noise = gtsam.noiseModel.Robust.Create(kernel, noise)
        graph.push_back(gtsam.BetweenFactorPose2(_OFFSET, _g(self._last), gtsam.Pose2(0.0, 0.0, turn.angle), noise))

    def _touching(self, feeling: Feeling) -> int:
        """How many rows `_touching_rows` has."""
        return len(self._tips) + (feeling.direction is not None)

    def _touching_rows(
        self, touches: list[Touching], lasting: Array, direction: ContactDirection | None, place: int, end: int
    ) -> list[tuple[Array, Array]]:
        """Whitened rows of contact and its direction, g standing at column place and what lasts at column end."""
        rows = []
        for touch in touches:
            residual, jacobian = factors.contact(touch, lasting[DEPTH])
            parts = {place: jacobian[:, :3], end + DEPTH: jacobian[:, 3:]}
            rows.append(_whitened(residual, parts, self._noise.contact_weight(residual), end + LASTING))
        if direction is not None:
            residual, jacobian = factors.direction(touches[0], direction.angle, lasting[_BIAS])
            parts = {place: jacobian[:, :3], end + _BIAS: jacobian[:, 3:]}
            weight = self._noise.feeling_weight(residual, 1.0 / (direction.variance * self._noise.direction_share))
            rows.append(_whitened(residual, parts, weight, end + LASTING))
        return rows


def _whitened(residual: Array, parts: dict[int, Array], weight: Array, columns: int) -> tuple[Array, Array]:
    """Rows (R,) and their Jacobian, given in parts by their first column, both times the root of the weight (R,)."""
    root = np.sqrt(weight)
    jacobian = np.zeros((len(residual), columns))
    for first, part in parts.items():
        jacobian[:, first : first + part.shape[1]] = root[:, None] * part
    return root * residual, jacobian


def _custom(keys: list[int], rows: int, linearise: Linearisation) -> gtsam.CustomFactor:
    """A GTSAM factor on poses, and last of all what lasts, from whitened rows and their Jacobian."""
    *poses, last = keys

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        residual, jacobian = linearise(*(_array(values.atPose2(key)) for key in poses), values.atVector(last))
        if jacobians is not None:
            for place in range(len(poses)):
                jacobians[place] = np.asfortranarray(jacobian[:, 3 * place : 3 * place + 3])
            jacobians[-1] = np.asfortranarray(jacobian[:, 3 * len(poses) :])
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
