"""A plain sliding window in GTSAM, all factors in C++, for comparison.

The variables of a step are the sensor pose in the object frame, g, and in the world, e. Numbers stand here and not in
palpate, so that ratios can be compared over time.
"""

from collections import deque
from itertools import chain
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2

Array = NDArray[np.float64]

TACTILE = np.array([1.0, 1.0, 8e-2])  # [m, m, rad] of the relative pose of two steps
SENSOR = np.array([1e-4, 1e-4, 1e-3])  # [m, m, rad]
FIRST_POSE = np.array([5e-4, 5e-4, 5e-3])  # [m, m, rad]
WINDOW = 40
"""Steps in the window."""


class NativeGraph:
    """A sliding window: priors on e, tactile and pushing as between factors, a prior on g.

    It has as many factors as palpate's window and the same two Gauss-Newton iterations, though not the same geometry.
    """

    def __init__(self) -> None:
        self._window: deque[list[Any]] = deque(maxlen=WINDOW)
        self._values, self._count = gtsam.Values(), 0
        self._last = np.zeros((2, 3))

    def update(self, given: tuple[Array, Array]) -> tuple[Array, Array]:
        """Add a step with true object pose and sensor pose; return the object's pose (3,) and covariance (3, 3)."""
        object_pose, sensor_pose = given
        now, self._count = self._count, self._count + 1
        begin, poses = max(now - WINDOW + 1, 0), np.stack([se2.between(object_pose, sensor_pose), sensor_pose])
        keys, before = (_g(now), _e(now)), (_g(now - 1), _e(now - 1)) if now else ()
        factors = []
        for key, pose, sigmas in zip(keys, poses, (TACTILE, SENSOR), strict=True):
            self._values.insert(key, gtsam.Pose2(*pose))
            factors.append(gtsam.PriorFactorPose2(key, gtsam.Pose2(*pose), _sigmas(sigmas)))
        steps = [gtsam.Pose2(*step) for step in se2.between(self._last, poses)]
        ties = [gtsam.BetweenFactorPose2(*each, _sigmas(TACTILE)) for each in zip(before, keys, steps, strict=False)]
        if begin > 0:
            for key in (_g(begin - 1), _e(begin - 1)):
                self._values.erase(key)
            self._window[1] = self._window[1][:2]  # no longer tied to the step that leaves
        self._window.append(factors + ties)
        self._last = poses
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(gtsam.PriorFactorPose2(_g(begin), self._values.atPose2(_g(begin)), _sigmas(FIRST_POSE)))
        for factor in chain.from_iterable(self._window):
            graph.push_back(factor)
        for _ in range(2):
            self._values = self._values.retract(graph.linearize(self._values).optimize())
        touch, sensor = self._values.atPose2(keys[0]), self._values.atPose2(keys[1])
        covariance = gtsam.Marginals(graph, self._values).marginalCovariance(keys[0])
        found = sensor.compose(touch.inverse())
        return np.array([found.x(), found.y(), found.theta()]), covariance


def _sigmas(sigmas: Array) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(sigmas)


def _g(step: int) -> int:
    return gtsam.symbol("g", step)


def _e(step: int) -> int:
    return gtsam.symbol("e", step)
