"""The factor graph of a contact episode in GTSAM with iSAM2 (paper Sec. III and IV-B, Eq. 3).

Variables are the sensor pose in the object frame, g = o^-1 e, and the sensor pose e; the object pose is o = e g^-1. So
the tactile factor (Eq. 5) is a native between factor on g, and the contact factor (Eq. 11) is a factor of g alone. Each
episode has a graph, which starts from the marginal of the last one: between episodes the object rests.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import gtsam
import numpy as np
from gtsam.symbol_shorthand import E, G
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.geometry import se2
from palpate.models.pushing.contact_geometry import ContactModel

_log = logging.getLogger(__name__)
Indices = NDArray[np.int_]
BACK = np.arange(10, 40)
"""Frames between the two of a tactile factor, as in the authors' code (paper: a subset of the training window)."""
FRICTION_RADIUS = {"disc": 0.088 / 3.0, "rect": 0.2842, "ellip": 0.2033}
"""Largest torque over largest force c of each object [m], as the authors have it (Eq. 7).

For the rectangle it is the whole diagonal, twice what pressure at the corners alone gives.
"""
CAPTURE = (1e-4, 1e-4, 2.6e-3)
"""Standard deviations of a measured pose [m, m, rad], as simulated: of Eq. 12 and of the first object pose."""


@dataclass(frozen=True)
class PhysicsNoise:
    """Standard deviations of the factors of physics; the authors have 1e-3 each and 1e-2."""

    quasi_static: tuple[float, float, float]
    """Of Eq. 8: two of the contact point's step [m], one of the torque's balance [m^2]."""
    contact: float
    """Of Eq. 11, the gap between tip and outline [m]."""


def contact_point(model: ContactModel, g: Array) -> tuple[Array, Array]:
    """Return the gap [m] between tip and outline (...), and the contact point (..., 2) in the object frame."""
    touch = model.touching(np.ascontiguousarray(g.reshape(1, -1, 3))).reshape(g.shape[:-1])
    point = touch["point"] - touch["gap"] * touch["normal"]
    return touch["gap"], np.stack((np.real(point), np.imag(point)), axis=-1)


def contact_residual(model: ContactModel, poses: Array) -> Array:
    """Return the contact error (..., 1) of g (..., 1, 3): Eq. 11, two-sided."""
    return contact_point(model, poses[..., 0, :])[0][..., None]


def quasi_static_residual(model: ContactModel, poses: Array) -> Array:
    """Return the errors (..., 3) of g and e before and after a step (..., 4, 3): Eqs. 7 to 10, D V - Vp."""
    g0, e0, g1, e1 = np.moveaxis(poses, -2, 0)
    before = se2.compose(e0, se2.inverse(g0))
    after = se2.compose(e1, se2.inverse(g1))
    vx, vy, omega = np.moveaxis(se2.log(se2.between(before, after)), -1, 0)
    _, p = contact_point(model, g1)
    # The material point of the sensor that is in contact, before the step, in the object frame after it.
    came_from = se2.transform(se2.between(after, se2.compose(e0, se2.between(e1, after))), p)
    pushed = p - came_from
    px = p[..., 0]
    py = p[..., 1]
    rows = (
        vx - omega * py - pushed[..., 0],
        vy + omega * px - pushed[..., 1],
        px * vy - py * vx - model.friction_radius**2 * omega,
    )
    return np.stack(rows, axis=-1)


def tactile_error(earlier: Indices, later: Indices, error: Array) -> float:
    """Return the error of the turn over an episode, from tactile factors alone, over their deviation each.

    Factors are between frames of the episode, counted from 0, and their errors (P,) [rad]. Factors share images and
    errors last, so a deviation of single pairs would promise too much.
    """
    rows = np.zeros((len(error), later.max() + 1))
    pairs = np.arange(len(error))
    rows[pairs, later] += 1.0
    rows[pairs, earlier] -= 1.0
    covariance = np.linalg.inv(rows[:, 1:].T @ rows[:, 1:])  # the first frame is the reference
    return float((covariance @ rows[:, 1:].T @ error)[-1] / np.sqrt(covariance[-1, -1]))


def physics_errors(model: ContactModel, object_pose: Array, sensor_pose: Array) -> Array:
    """Return the errors (4,) of Eqs. 8 and 11 over a contact episode, in units of an even error of one frame.

    Errors last, so their sum over the episode counts: with deviations of this size the graph is as uncertain after it
    as it is wrong. Poses (N, 3) are true ones.
    """
    relative = se2.between(object_pose, sensor_pose)
    steps = np.stack((relative[:-1], sensor_pose[:-1], relative[1:], sensor_pose[1:]), axis=1)
    moved = quasi_static_residual(model, steps)
    gap = contact_point(model, relative)[0]
    return np.append(moved.sum(axis=0) / np.sqrt(len(moved)), gap.sum() / np.sqrt(len(gap)))


def physics_noise(errors: Array) -> PhysicsNoise:
    """Return the noise that errors of episodes (E, 4) show, by their medians: a few contacts slide."""
    *moved, gap = (1.4826 * np.median(np.abs(errors), axis=0)).tolist()
    return PhysicsNoise(tuple(moved), gap)


class Tracker:
    """Online estimate of the object pose over contact episodes."""

    def __init__(
        self, model: ContactModel, noise: PhysicsNoise, first_pose: Array, first_sigma: Sequence[float]
    ) -> None:
        self._model = model
        self._noise = noise
        self.pose = first_pose
        self.covariance = np.diag(np.square(first_sigma))
        self.steps = 0
        """Frames in the graph of this episode; 0 begins one, for which the object rests where it was estimated."""
        self._isam = gtsam.ISAM2()

    def step(self, sensor_pose: Array, turns: Sequence[tuple[int, float]], sigma: float) -> None:
        """Add a frame of contact with turns [rad] since so many frames ago.

        If iSAM2 cannot solve it the estimate is kept, and the next frame begins a graph from it.
        """
        t = self.steps
        graph = gtsam.NonlinearFactorGraph()
        values = gtsam.Values()
        if t == 0:
            self._isam = _isam2()
            guess = se2.between(self.pose, sensor_pose)
            turned = se2.adjoint(se2.inverse(guess))
            first = gtsam.noiseModel.Gaussian.Covariance(turned @ self.covariance @ turned.T)
            graph.push_back(gtsam.PriorFactorPose2(G(0), gtsam.Pose2(*guess), first))
        else:
            guess = _array(self._isam.calculateEstimatePose2(G(t - 1)))  # as if the contact sticks
            keys = [G(t - 1), E(t - 1), G(t), E(t)]
            moved = partial(quasi_static_residual, self._model)
            graph.push_back(_factor(keys, moved, self._noise.quasi_static))
        values.insert(G(t), gtsam.Pose2(*guess))
        values.insert(E(t), gtsam.Pose2(*sensor_pose))
        graph.push_back(gtsam.PriorFactorPose2(E(t), gtsam.Pose2(*sensor_pose), _sigmas(CAPTURE)))  # Eq. 12
        graph.push_back(_factor([G(t)], partial(contact_residual, self._model), (self._noise.contact,)))
        for back, turn in turns:
            if back <= t:
                measured = gtsam.Pose2(0.0, 0.0, turn)
                noise = _sigmas((1.0, 1.0, sigma))  # x and y do not count
                graph.push_back(gtsam.BetweenFactorPose2(G(t - back), G(t), measured, noise))
        try:
            self._isam.update(graph, values)
            g = _array(self._isam.calculateEstimatePose2(G(t)))
            e = _array(self._isam.calculateEstimatePose2(E(t)))
            covariance = self._isam.marginalCovariance(G(t)) + self._isam.marginalCovariance(E(t))
        except RuntimeError as error:  # an indeterminate linear system
            _log.warning("a frame of contact is left out: %s", error)
            self.steps = 0
            return
        turned = se2.adjoint(g)
        self.pose = se2.compose(e, se2.inverse(g))
        self.covariance = turned @ covariance @ turned.T
        self.steps += 1


def track_episodes(
    model: ContactModel,
    noise: PhysicsNoise,
    sensor_pose: Array,
    episode: Indices,
    turns: dict[int, list[tuple[int, float]]],
    first_pose: Array,
    sigma: float,
    first_sigma: Sequence[float] = CAPTURE,
) -> tuple[Array, Array, Array]:
    """Track a sequence of N frames; `turns` has the tactile measurements by frame, `sigma` their deviation [rad],
    and `first_sigma` is that of the first pose [m, m, rad].

    Return poses (N, 3), covariances (N, 3, 3) and the time of each step (N,) [ms].
    """
    tracker = Tracker(model, noise, first_pose, first_sigma)
    poses = []
    covariances = []
    step_ms = []
    for t, pose in enumerate(sensor_pose):
        begin = time.perf_counter()
        if episode[t] < 0 or (t and episode[t] != episode[t - 1]):
            tracker.steps = 0
        if episode[t] >= 0:
            tracker.step(pose, turns.get(t, []), sigma)
        step_ms.append(1e3 * (time.perf_counter() - begin))
        poses.append(tracker.pose)
        covariances.append(tracker.covariance)
    return np.array(poses), np.array(covariances), np.array(step_ms)


def compared_frames(age: int) -> list[int]:
    """Return the distances [frames] to the earlier frames that a frame of this age in its episode is compared with.

    A young frame is compared with the first as well, which has the prior: without that its yaw drifts.
    """
    distances = BACK[age >= BACK].tolist()
    if 0 < age <= BACK[-1] and age not in distances:
        distances.append(age)
    return distances


def _factor(keys: Sequence[int], residual: object, sigmas: Sequence[float]) -> gtsam.CustomFactor:
    """Return a factor of poses with central differences in the tangent space, all of them in one call."""
    count = 3 * len(keys)
    steps = np.zeros((1 + 2 * count, len(keys), 3))
    for k in range(count):
        steps[1 + 2 * k, k // 3, k % 3] = 1e-6
        steps[2 + 2 * k, k // 3, k % 3] = -1e-6
    moves = se2.exp(steps)

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        poses = np.array([_array(values.atPose2(key)) for key in factor.keys()])  # noqa: SIM118
        if jacobians is None:
            return residual(poses)  # type: ignore[operator]
        errors = residual(se2.compose(poses, moves))  # type: ignore[operator]
        slopes = (errors[1::2] - errors[2::2]) / 2e-6
        for k in range(len(keys)):
            jacobians[k] = np.asfortranarray(slopes[3 * k : 3 * k + 3].T)
        return errors[0]

    return gtsam.CustomFactor(_sigmas(sigmas), list(keys), error)


def _isam2() -> gtsam.ISAM2:
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(0.01)  # [m, rad], as the authors have it
    parameters.relinearizeSkip = 1
    return gtsam.ISAM2(parameters)


def _sigmas(sigmas: Sequence[float]) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.asarray(sigmas, dtype=np.float64))


def _array(pose: gtsam.Pose2) -> Array:
    return np.array([pose.x(), pose.y(), pose.theta()])
