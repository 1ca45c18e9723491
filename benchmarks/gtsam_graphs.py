"""The paper's graph in GTSAM as one would write it first, for comparison: with Python factors, and with native ones.

The variables of a step are the sensor pose in the object frame, g, and in the world, e. Numbers and residuals stand
here and not in palpate, so that ratios can be compared over time. Jacobians are with respect to right (body-frame)
perturbations, order x, y, theta.
"""

from collections import deque
from collections.abc import Sequence
from itertools import chain
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.models.pushing.contact_geometry import ContactModel

Array = NDArray[np.float64]

TACTILE = np.array([1.0, 1.0, 8e-2])  # [m, m, rad] of the relative pose of two steps
SENSOR = np.array([1e-4, 1e-4, 1e-3])  # [m, m, rad]
FIRST_POSE = np.array([5e-4, 5e-4, 5e-3])  # [m, m, rad]
CONTACT = np.array([1e-3])  # [m] of the gap
SLIP = 2e-5  # [m]
SLIP_SHARE = 0.06  # of the sensor's motion
TORQUE = 2e-7  # [m^2]
TORQUE_SHARE = 0.013  # of the sensor's motion times c
PAIRS = 30
"""Tactile factors of a step, each with one of the steps before."""
WINDOW = 40
"""Steps in the window of the native graph."""


class PlainGraph:
    """All steps of the contact in iSAM2; all factors but the priors are written in Python."""

    def __init__(self, model: ContactModel, object_pose: Array) -> None:
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(1e-3)
        parameters.relinearizeSkip = 1
        self._isam = gtsam.ISAM2(parameters)
        self._model = model
        self._first = object_pose
        self._true: list[Array] = []
        self._sensor = np.zeros(3)

    def update(self, given: tuple[Array, Array]) -> tuple[Array, Array]:
        """Add a step with true object pose, from which tactile factors are made, and sensor pose; return the estimate.

        Returns the object's pose (3,) and covariance (3, 3).
        """
        object_pose, sensor_pose = given
        now = len(self._true)
        graph = gtsam.NonlinearFactorGraph()
        values = gtsam.Values()
        self._true.append(se2.between(object_pose, sensor_pose))
        values.insert(_e(now), gtsam.Pose2(*sensor_pose))
        graph.push_back(gtsam.PriorFactorPose2(_e(now), gtsam.Pose2(*sensor_pose), _sigmas(SENSOR)))
        graph.push_back(_contact(_g(now), self._model))
        if now == 0:
            first = gtsam.Pose2(*se2.between(self._first, sensor_pose))
            values.insert(_g(0), first)
            graph.push_back(gtsam.PriorFactorPose2(_g(0), first, _sigmas(FIRST_POSE)))
        else:
            values.insert(_g(now), self._isam.calculateEstimatePose2(_g(now - 1)))
            moved = float(np.hypot(*(sensor_pose - self._sensor)[:2]))
            graph.push_back(_pushing([_g(now - 1), _e(now - 1), _g(now), _e(now)], moved, self._model))
        for back in range(1, min(PAIRS, now) + 1):
            measured = se2.between(self._true[now - back], self._true[now])
            graph.push_back(_tactile([_g(now - back), _g(now)], measured))
        self._isam.update(graph, values)
        self._sensor = sensor_pose
        touch = self._isam.calculateEstimatePose2(_g(now))
        sensor = self._isam.calculateEstimatePose2(_e(now))
        return _array(sensor.compose(touch.inverse())), self._isam.marginalCovariance(_g(now))


class NativeGraph:
    """A sliding window with factors in C++ only: priors on e, tactile and pushing as between factors, a prior on g.

    It has as many factors as palpate's window and the same two Gauss-Newton iterations, though not the same geometry.
    """

    def __init__(self) -> None:
        self._window: deque[list[Any]] = deque(maxlen=WINDOW)
        self._values = gtsam.Values()
        self._count = 0
        self._last = np.zeros((2, 3))

    def update(self, given: tuple[Array, Array]) -> tuple[Array, Array]:
        """Add a step with true object pose and sensor pose; return the object's pose (3,) and covariance (3, 3)."""
        object_pose, sensor_pose = given
        now = self._count
        self._count += 1
        begin = max(now - WINDOW + 1, 0)
        poses = np.stack([se2.between(object_pose, sensor_pose), sensor_pose])
        keys = (_g(now), _e(now))
        before = (_g(now - 1), _e(now - 1)) if now else ()
        factors = []
        for key, pose, sigmas in zip(keys, poses, (TACTILE, SENSOR), strict=True):
            self._values.insert(key, gtsam.Pose2(*pose))
            factors.append(gtsam.PriorFactorPose2(key, gtsam.Pose2(*pose), _sigmas(sigmas)))
        steps = [gtsam.Pose2(*step) for step in se2.between(self._last, poses)]
        ties = [gtsam.BetweenFactorPose2(*tie, _sigmas(TACTILE)) for tie in zip(before, keys, steps, strict=False)]
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
        touch = self._values.atPose2(keys[0])
        sensor = self._values.atPose2(keys[1])
        covariance = gtsam.Marginals(graph, self._values).marginalCovariance(keys[0])
        return _array(sensor.compose(touch.inverse())), covariance


def _tactile(keys: Sequence[int], measured: Array) -> gtsam.CustomFactor:
    """Return the tactile factor on g of two steps: a measured relative pose (3,)."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        relative = se2.between(*(_array(values.atPose2(key)) for key in keys))
        residual = se2.log(se2.between(measured, relative))
        if jacobians is not None:
            by_second = se2.right_jacobian_inverse(residual)
            jacobians[0] = np.asfortranarray(-by_second @ se2.adjoint(se2.inverse(relative)))
            jacobians[1] = np.asfortranarray(by_second)
        return residual

    return gtsam.CustomFactor(_sigmas(TACTILE), list(keys), error)


def _contact(key: int, model: ContactModel) -> gtsam.CustomFactor:
    """Return the contact factor: the gap between tip and outline is 0."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        contact = _geometry(model, _array(values.atPose2(key)))
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(contact["gap_by_g"][None])
        return np.array([contact["gap"]])

    return gtsam.CustomFactor(_sigmas(CONTACT), [key], error)


def _pushing(keys: Sequence[int], moved: float, model: ContactModel) -> gtsam.CustomFactor:
    """Return the factor of quasi-static pushing on g0, e0, g1, e1; the sensor moved this far [m]."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        poses = [_array(values.atPose2(key)) for key in keys]
        residual, jacobian = pushing(*poses, model=model)
        if jacobians is not None:
            for k in range(4):
                jacobians[k] = np.asfortranarray(jacobian[:, 3 * k : 3 * k + 3])
        return residual

    slip = np.hypot(SLIP, SLIP_SHARE * moved)
    torque = np.hypot(TORQUE, TORQUE_SHARE * moved * model.friction_radius)
    return gtsam.CustomFactor(_sigmas(np.array([slip, slip, torque])), list(keys), error)


def pushing(g0: Array, e0: Array, g1: Array, e1: Array, model: ContactModel) -> tuple[Array, Array]:
    """Return the residual of quasi-static pushing over a step (3,) and its Jacobian (3, 12) by g0, e0, g1, e1.

    Rows 1 and 2 [m]: sliding along the sensor, object frame. Row 3 [m^2]: balance of force and torque on the
    ellipsoidal limit surface, `p x v - c^2 omega`. Planar vectors are complex.
    """
    contact = _geometry(model, g1)
    center = model.friction_center
    c_squared = model.friction_radius**2
    turn_g0 = np.exp(1j * g0[2])
    turn_e0 = np.exp(1j * e0[2])
    turn_g1 = np.exp(1j * g1[2])
    turn_e1 = np.exp(1j * e1[2])
    # The centre was at `g1 e1^-1 e0 g0^-1 center` at step 0, seen from the object at step 1.
    in_sensor0 = np.conj(turn_g0) * (center - _place(g0))
    in_sensor1 = np.conj(turn_e1) * (_place(e0) + turn_e0 * in_sensor0 - _place(e1))
    motion = center - (_place(g1) + turn_g1 * in_sensor1)
    by_sensor0 = _moving(turn_g1 * np.conj(turn_e1) * turn_e0, in_sensor0)
    by_sensor1 = _moving(turn_g1, in_sensor1)
    slid = _place(g0) + turn_g0 * contact["material"] - contact["point"]
    slid_by_g0 = _moving(turn_g0, contact["material"])
    slid_by_g1 = turn_g0 * contact["material_by_g"] - contact["point_by_g"]
    arm = contact["point"] - center
    omega = se2.wrap(e1[2] - e0[2] - g1[2] + g0[2])
    jacobian = np.zeros((3, 12))
    jacobian[:2, 0:3] = np.stack([slid_by_g0.real, slid_by_g0.imag])
    jacobian[:2, 6:9] = np.stack([slid_by_g1.real, slid_by_g1.imag])
    jacobian[2, 0:3] = _cross(arm, by_sensor0)
    jacobian[2, 3:6] = -_cross(arm, by_sensor0)
    jacobian[2, 6:9] = _cross(contact["point_by_g"], motion) - _cross(arm, by_sensor1)
    jacobian[2, 9:12] = _cross(arm, by_sensor1)
    jacobian[2, [2, 11]] -= c_squared  # omega grows with the turns of g0 and e1,
    jacobian[2, [5, 8]] += c_squared  # and shrinks with those of e0 and g1
    return np.array([slid.real, slid.imag, _cross(arm, motion) - c_squared * omega]), jacobian


def _geometry(model: ContactModel, g: Array) -> Any:
    """Return the geometry of the contact at g (3,)."""
    return model.touching(g[None, None])[0, 0]


def _moving(turn: Any, point: Any) -> Any:
    """Return the derivative (3,) of a point of a body by a right perturbation of its pose."""
    return turn * np.array([1.0, 1j, 1j * point])


def _place(pose: Array) -> complex:
    return complex(pose[0], pose[1])


def _cross(a: Any, b: Any) -> Any:
    return (np.conj(a) * b).imag


def _sigmas(sigmas: Array) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(sigmas)


def _array(pose: gtsam.Pose2) -> Array:
    return np.array([pose.x(), pose.y(), pose.theta()])


def _g(step: int) -> int:
    return gtsam.symbol("g", step)


def _e(step: int) -> int:
    return gtsam.symbol("e", step)
