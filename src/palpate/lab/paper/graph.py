"""The factor graph of a contact episode in GTSAM with iSAM2 (paper Sec. III and IV-B, Eq. 3).

Variables are the sensor pose in the object frame, g = o^-1 e, and the sensor pose e; the object pose is o = e g^-1. So
the tactile factor (Eq. 5) is a native between factor on g, and the contact factor (Eq. 11) is a factor of g alone. Each
episode has a graph, which starts from the marginal of the last one: between episodes the object rests.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.distance_field import DistanceField

Array = NDArray[np.float64]
BACK = np.arange(10, 40)
"""Frames between the two of a tactile factor, as in the authors' code (paper: a subset of the training window)."""


@dataclass(frozen=True)
class GraphSettings:
    """Standard deviations of the factors and settings of iSAM2.

    The authors' are (1, 1, 1e-5) for tactile factors, 1e-3 quasi-static, 1e-2 contact, 1e-5 sensor and first pose, with
    threshold 0.01 and skip 10. A threshold of 10 mm is far too coarse for touch, and with 1e-5 rad for a turn that is
    predicted to some hundredths the factors contradict each other; so these are milder.
    """

    tactile: float = 1e-3
    """Turn of a pair [rad]; x and y do not count."""
    quasi_static: tuple[float, float, float] = (1e-4, 1e-4, 1e-3)
    """Sticking in x and y [m], which is good physics, and torque [m^2 over the unit of length], which is not."""
    contact: float = 1e-3
    """Distance of the contact point from the outline [m]."""
    sensor: tuple[float, float, float] = (1e-4, 1e-4, 1e-3)
    """Measured sensor pose [m, m, rad]."""
    first_pose: tuple[float, float, float] = (5e-4, 5e-4, 5e-3)
    """Object pose before the first episode [m, m, rad]."""
    threshold: float = 1e-3
    """Change of a variable at which iSAM2 linearises it anew [m, rad]."""


@dataclass(frozen=True, eq=False)
class Model:
    """Object and sensor."""

    field: DistanceField
    """Signed distance of the outline."""
    c: float
    """Ratio of the limit surface: largest torque over largest force [m]."""
    radius: float
    """Radius of the sensor's tip [m]; 0 is the paper's contact point."""

    def contact_point(self, g: Array) -> tuple[Array, Array]:
        """Return the gap [m] between tip and outline (...), and the contact point (..., 2) in the object frame."""
        centre = se2.transform(g, [-self.radius, 0.0])
        distance, gradient, _ = self.field.value_gradient_hessian(centre)
        return distance - self.radius, centre - distance[..., None] * gradient

    def contact_residual(self, poses: Array) -> Array:
        """Return the contact error (..., 1) of g (..., 1, 3): Eq. 11, two-sided."""
        return self.contact_point(poses[..., 0, :])[0][..., None]

    def quasi_static_residual(self, poses: Array) -> Array:
        """Return the errors (..., 3) of g and e before and after a step (..., 4, 3): Eqs. 7 to 10, D V - Vp."""
        g0, e0, g1, e1 = (poses[..., k, :] for k in range(4))
        before, after = se2.compose(e0, se2.inverse(g0)), se2.compose(e1, se2.inverse(g1))
        vx, vy, omega = np.moveaxis(se2.log(se2.between(before, after)), -1, 0)
        _, p = self.contact_point(g1)
        # The material point of the sensor that is in contact, before the step, in the object frame after it.
        came_from = se2.transform(se2.between(after, se2.compose(e0, se2.between(e1, after))), p)
        pushed = p - came_from
        px, py = p[..., 0], p[..., 1]
        rows = (
            vx - omega * py - pushed[..., 0],
            vy + omega * px - pushed[..., 1],
            px * vy - py * vx - self.c**2 * omega,
        )
        return np.stack(rows, axis=-1)


class Tracker:
    """Online estimate of the object pose over contact episodes."""

    def __init__(self, model: Model, first_pose: Array, settings: GraphSettings) -> None:
        self._model, self._settings = model, settings
        self.pose, self.covariance = first_pose, np.diag(np.square(settings.first_pose))
        self._isam: gtsam.ISAM2 | None = None
        self._sensor: list[Array] = []  # measured, of this episode

    def rest(self) -> None:
        """End an episode: the object rests where it was last estimated."""
        self._isam = None

    def step(self, sensor_pose: Array, turns: Sequence[tuple[int, float]], sigma: float) -> bool:
        """Add a frame of contact with turns [rad] since so many frames ago; return False if iSAM2 cannot solve it.

        The estimate is kept then, and the next frame begins a graph from it.
        """
        settings, graph, values = self._settings, gtsam.NonlinearFactorGraph(), gtsam.Values()
        if self._isam is None:
            self._isam, self._sensor = _isam2(settings.threshold), []
        t = len(self._sensor)
        self._sensor.append(sensor_pose)
        guess = se2.between(self.pose, sensor_pose)
        if t == 0:
            turned = se2.adjoint(se2.inverse(guess))
            first = turned @ self.covariance @ turned.T
            graph.push_back(
                gtsam.PriorFactorPose2(_g(0), gtsam.Pose2(*guess), gtsam.noiseModel.Gaussian.Covariance(first))
            )
        else:
            guess = _array(self._isam.calculateEstimatePose2(_g(t - 1)))  # it sticks
            keys = [_g(t - 1), _e(t - 1), _g(t), _e(t)]
            graph.push_back(_factor(keys, self._model.quasi_static_residual, settings.quasi_static))
        values.insert(_g(t), gtsam.Pose2(*guess))
        values.insert(_e(t), gtsam.Pose2(*sensor_pose))
        graph.push_back(gtsam.PriorFactorPose2(_e(t), gtsam.Pose2(*sensor_pose), _sigmas(settings.sensor)))  # Eq. 12
        graph.push_back(_factor([_g(t)], self._model.contact_residual, (settings.contact,)))
        for back, turn in turns:
            measured = gtsam.Pose2(0.0, 0.0, turn)
            graph.push_back(gtsam.BetweenFactorPose2(_g(t - back), _g(t), measured, _sigmas((1.0, 1.0, sigma))))
        try:
            self._isam.update(graph, values)
            g, e = (_array(self._isam.calculateEstimatePose2(key)) for key in (_g(t), _e(t)))
            of_g, of_e = (self._isam.marginalCovariance(key) for key in (_g(t), _e(t)))
        except RuntimeError:  # an indeterminate linear system
            self._isam = None
            return False
        turned = se2.adjoint(g)
        self.pose, self.covariance = se2.compose(e, se2.inverse(g)), turned @ (of_g + of_e) @ turned.T
        return True


def track_episodes(
    model: Model,
    sensor_pose: Array,
    episode: NDArray[np.int_],
    turns: dict[int, list[tuple[int, float]]],
    first_pose: Array,
    sigma: float,
    settings: GraphSettings | None = None,
) -> tuple[Array, Array, Array, int]:
    """Track a sequence of N frames; `turns` has the tactile measurements by frame, `sigma` their deviation [rad].

    Return poses (N, 3), covariances (N, 3, 3), the time of each step (N,) [ms] and the number of frames not solved.
    """
    tracker = Tracker(model, first_pose, settings or GraphSettings())
    poses, covariances, took, refused = [], [], [], 0
    for t, pose in enumerate(sensor_pose):
        begin = time.perf_counter()
        if episode[t] < 0 or (t and episode[t] != episode[t - 1]):
            tracker.rest()
        if episode[t] >= 0:
            steps = len(tracker._sensor) if tracker._isam is not None else 0
            usable = [(back, turn) for back, turn in turns.get(t, []) if back <= steps]
            refused += not tracker.step(pose, usable, sigma)
        took.append(1e3 * (time.perf_counter() - begin))
        poses.append(tracker.pose)
        covariances.append(tracker.covariance)
    return np.array(poses), np.array(covariances), np.array(took), refused


def compared_frames(age: int) -> list[int]:
    """Return how many frames ago the frames are that one of this age in its episode is compared with.

    A young frame is compared with the first as well, which has the prior: without that its yaw drifts.
    """
    found = BACK[age >= BACK].tolist()
    return [*found, age] if 0 < age <= BACK[-1] and age not in found else found


def _factor(keys: Sequence[int], residual: object, sigmas: Sequence[float]) -> gtsam.CustomFactor:
    """Return a factor of poses with central differences in the tangent space, all of them in one call."""
    count = 3 * len(keys)
    steps = np.zeros((1 + 2 * count, len(keys), 3))
    for k in range(count):
        steps[1 + 2 * k, k // 3, k % 3], steps[2 + 2 * k, k // 3, k % 3] = 1e-6, -1e-6
    moves = se2.exp(steps)

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        poses = np.array([_array(values.atPose2(key)) for key in factor.keys()])  # noqa: SIM118
        if jacobians is None:
            return residual(poses)  # type: ignore[operator]
        found = residual(se2.compose(poses, moves))  # type: ignore[operator]
        slopes = (found[1::2] - found[2::2]) / 2e-6
        for k in range(len(keys)):
            jacobians[k] = np.asfortranarray(slopes[3 * k : 3 * k + 3].T)
        return found[0]

    return gtsam.CustomFactor(_sigmas(sigmas), list(keys), error)


def _isam2(threshold: float) -> gtsam.ISAM2:
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(threshold)
    parameters.relinearizeSkip = 1
    return gtsam.ISAM2(parameters)


def _sigmas(sigmas: Sequence[float]) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.asarray(sigmas, dtype=np.float64))


def _array(pose: gtsam.Pose2) -> Array:
    return np.array([pose.x(), pose.y(), pose.theta()])


def _g(t: int) -> int:
    return gtsam.symbol("g", t)


def _e(t: int) -> int:
    return gtsam.symbol("e", t)
