"""The last poses of an object in a factor graph of fixed length, solved by Gauss-Newton steps.

Factors are a quasi-static push that sticks, D V - Vp as in `palpate_lab.paper.graph`, and contact with the outline as
it was known when touched. Poses that leave the window become a prior of the next one.
"""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array
from palpate.geometry import se2


@dataclass(frozen=True)
class SmootherSettings:
    """Settings of the graph."""

    length: int = 30
    """Number of poses in the window, those of a second."""
    motion: float = 3e-3
    """Deviation of the factor of pushing in a frame [m]: of the contact point's motion, and of the torque over c. It is
    large, as the errors of a contact that slides last."""
    contact: float = 3e-3
    """Deviation of the distance between contact point and outline [m], beside that of the outline."""
    steps: int = 2
    """Gauss-Newton steps at each new factor."""


@dataclass(frozen=True, eq=False)
class Pressure:
    """Pressure of the object on its support, which is not learnt."""

    radius: float
    """c, the ratio of largest friction torque to largest friction force [m]."""
    center: Array
    """Centre of friction in the object frame (2,) [m]."""


@dataclass(frozen=True, eq=False)
class Push:
    """Motion of T tips that touch, from one pose to the next, in the world."""

    points: Array
    """Contact points before it (T, 2) [m]."""
    motions: Array
    """Motions of the sensor's surface there (T, 2) [m]."""


@dataclass(frozen=True, eq=False)
class Tangent:
    """The outline near a contact, as a line."""

    touched: Array
    """Contact point in the world (2,) [m]."""
    point: Array
    """Point of the object frame (2,) [m] at which the line was taken."""
    distance: float
    """Distance of that point from the outline [m], negative inside."""
    deviation: float
    """Deviation of the distance [m]."""
    normal: Array
    """Outward normal (2,) in the object frame."""
    yaw: float
    """Yaw of the object by the direction of touch and this normal [rad]."""
    yaw_deviation: float
    """Its deviation [rad]; inf where no direction was measured."""


class Smoother:
    """Poses of the last frames of contact."""

    def __init__(self, pose: Array, covariance: Array, pressure: Pressure, settings: SmootherSettings) -> None:
        """Begin with a pose (3,) and its covariance (3, 3)."""
        self._settings = settings
        self._pressure = pressure
        self._poses: list[Array] = [pose]
        self._pushes: list[Push] = []  # from each pose to the next
        self._tangents: list[list[Tangent]] = [[]]  # of each pose
        self._prior_pose = pose
        self._prior = np.linalg.inv(covariance)  # information of the first pose in the window
        self._prior_vector = np.zeros(3)
        self.covariance: Array = covariance
        """Of the last pose (3, 3), tangent space there."""

    @property
    def pose(self) -> Array:
        """The last pose (3,)."""
        return self._poses[-1]

    def push(self, push: Push) -> None:
        """Add a pose, which a push has moved."""
        self._pushes.append(push)
        self._poses.append(self._poses[-1])
        self._tangents.append([])
        if len(self._poses) > self._settings.length:
            self._forget_first()
        self._solve()

    def touch(self, tangents: list[Tangent]) -> None:
        """Let the last pose have contact with the outline, instead of contacts that were told before."""
        self._tangents[-1] = tangents
        self._solve()

    def _solve(self) -> None:
        """Move all poses of the window to where they fit best, and see the covariance of the last one."""
        for _ in range(self._settings.steps):
            information, vector = self._normal_equations(len(self._poses))
            covariance = np.linalg.inv(information)
            moves = (covariance @ vector).reshape(-1, 3)
            self._poses = list(se2.compose(np.array(self._poses), se2.exp(moves)))
            self.covariance = covariance[-3:, -3:].astype(np.float64)

    def _forget_first(self) -> None:
        """Take the first pose from the window, and keep what it tells of the next one."""
        information, vector = self._normal_equations(1)
        gain = information[3:, :3] @ np.linalg.inv(information[:3, :3])
        self._prior = information[3:, 3:] - gain @ information[:3, 3:]
        self._prior_vector = vector[3:] - gain @ vector[:3]
        self._prior_pose = self._poses[1]
        del self._poses[0], self._pushes[0], self._tangents[0]

    def _normal_equations(self, count: int) -> tuple[Array, Array]:
        """Return information and vector of the factors of the first poses, and of the pushes that leave them."""
        pushes = self._pushes[:count]
        size = 3 * max(count, len(pushes) + 1)
        information = np.zeros((size, size))
        vector = np.zeros(size)
        off = se2.log(se2.between(self._prior_pose, self._poses[0]))
        information[:3, :3] = self._prior
        vector[:3] = self._prior_vector - self._prior @ off
        for k, tangents in enumerate(self._tangents[:count]):
            own = slice(3 * k, 3 * k + 3)
            for tangent in tangents:
                residuals, slopes = _contact_errors(self._poses[k], tangent)
                information[own, own] += slopes.T @ slopes
                vector[own] -= slopes.T @ residuals
        if pushes:
            residuals, slopes = self._push_errors(pushes)
            squares = np.swapaxes(slopes, 1, 2) @ slopes
            for k in range(len(pushes)):
                both = slice(3 * k, 3 * k + 6)
                information[both, both] += squares[k]
                vector[both] -= slopes[k].T @ residuals[k]
        return information, vector

    def _push_errors(self, pushes: list[Push]) -> tuple[Array, Array]:
        """Return errors (N, E) of the first N pushes and their derivatives (N, E, 6), in standard deviations."""
        poses = np.array(self._poses[: len(pushes) + 1])
        pairs = np.stack((poses[:-1], poses[1:]), axis=1)
        size = 1e-6
        steps = np.zeros((13, 1, 2, 3))
        for k in range(6):
            steps[1 + 2 * k, 0, k // 3, k % 3] = size
            steps[2 + 2 * k, 0, k // 3, k % 3] = -size
        points = np.array([push.points for push in pushes])
        motions = np.array([push.motions for push in pushes])
        errors = push_residual(self._pressure, se2.compose(pairs, se2.exp(steps)), points, motions)
        errors = errors / self._settings.motion
        slopes = np.moveaxis(errors[1::2] - errors[2::2], 0, -1) / (2.0 * size)
        return errors[0], slopes


def push_residual(pressure: Pressure, pairs: Array, points: Array, motions: Array) -> Array:
    """Return the errors (..., E) [m] of poses before and after a push (..., 2, 3), for points and motions (..., T, 2).

    They are D V - Vp in the object frame: contact points move with the sensor, and, of one tip, the torque fits the
    force. How two tips share the force is not known.
    """
    before = pairs[..., 0, :]
    moved = se2.log(se2.between(before, pairs[..., 1, :]))
    place = se2.transform(se2.inverse(before)[..., None, :], points)
    turned_back = before * (0.0, 0.0, -1.0)
    pushed = se2.transform(turned_back[..., None, :], motions)
    vx, vy, turn = np.moveaxis(moved[..., None, :], -1, 0)
    px, py = np.moveaxis(place, -1, 0)
    rows = [vx - turn * py - pushed[..., 0], vy + turn * px - pushed[..., 1]]
    if points.shape[-2] == 1:
        cx, cy = pressure.center
        torque = (px - cx) * (vy + turn * cx) - (py - cy) * (vx - turn * cy)
        rows.append(torque / pressure.radius - pressure.radius * turn)
    return np.concatenate(rows, axis=-1)


def _contact_errors(pose: Array, tangent: Tangent) -> tuple[Array, Array]:
    """Return the errors (2,) of a contact, distance and direction, and their derivatives (2, 3), in deviations."""
    point = se2.transform(se2.inverse(pose), tangent.touched)
    distance = tangent.distance + tangent.normal @ (point - tangent.point)
    moved = -np.array((*tangent.normal, tangent.normal @ (-point[1], point[0])))  # the object moves, its point back
    turned = np.array((0.0, 0.0, 1.0))
    deviations = np.array((tangent.deviation, tangent.yaw_deviation))
    residuals = np.array((distance, se2.wrap(float(pose[2] - tangent.yaw))))
    return residuals / deviations, np.vstack((moved, turned)) / deviations[:, None]
