"""The reference of the benchmark: the paper's graph as one would write it first, apart from palpate's own factors.

Object and sensor poses `o` and `e` are the variables, every factor but the priors is a Python `CustomFactor` in NumPy,
and GTSAM's iSAM2 solves. It must stay as it is, in content and in speed, for ratios to it to be compared over time; so
its residuals and its numbers stand here and not in palpate. Its contact sticks, whatever the angle of the force.

Inside, a planar vector is a complex number. `g = o^-1 e` is the sensor in the object frame; Jacobians are with respect
to right (body-frame) perturbations, order x, y, theta.
"""

from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.touch.relative import OracleTouch
from palpate.types.frame import Frame
from palpate.types.measurements import RelativePoses

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_TACTILE = (1.0, 1.0, 8e-2)  # [m, m, rad] of a pair
_SENSOR = (1e-4, 1e-4, 1e-3)  # [m, m, rad]
_FIRST_POSE = (5e-4, 5e-4, 5e-3)  # [m, m, rad]
_CONTACT = 1e-3  # [m]
_STICKING, _STICKING_SHARE = 2e-5, 0.06  # [m], and as a share of the sensor's motion
_TURNING, _TURNING_SHARE = 2e-7, 0.013  # [m^2], and as a share of the sensor's motion times c

# What lasts: bias of directions, depth, logarithm of the ratio of c^2, centre of friction x and y, grip.
_LASTING_MEAN = np.array([0.0, 3e-4, 0.2, 0.0, 0.0, 0.4])
_LASTING_DEVIATION = np.array([1e-2, 4e-4, 0.66, 0.06, 0.06, 0.1])
_LASTING_SIZE, _DEPTH, _FRICTION = 6, 1, slice(2, 6)

_RELINEARISE_ABOVE = (2e-3, 2e-3, 5e-3)  # [m, m, rad]
_RELINEARISE_LASTING_ABOVE = 0.05
_LASTING = gtsam.symbol("l", 0)


class PlainGraph:
    """The paper's graph with poses as variables and residuals in Python."""

    def __init__(self, model: ContactModel, first_pose: Array) -> None:
        """Take what touches what, of which the outline and the numbers are used, and world_T_object (3,) at first."""
        parameters, thresholds = gtsam.ISAM2Params(), gtsam.ISAM2ThresholdMap()
        for name in "oe":
            thresholds.insert((name, np.array(_RELINEARISE_ABOVE)))
        thresholds.insert(("l", np.full(_LASTING_SIZE, _RELINEARISE_LASTING_ABOVE)))
        parameters.setRelinearizeThreshold(thresholds)
        parameters.relinearizeSkip = 1
        self._isam = gtsam.ISAM2(parameters)
        self._model, self._first, self._steps = model, first_pose, 0
        self._touch = OracleTouch(_TACTILE)
        self._sensor = np.zeros(3)

    def update(self, frame: Frame) -> tuple[Array, Array]:
        """Add a frame and return the object's pose (3,) and covariance (3, 3)."""
        now, graph, values = self._steps, gtsam.NonlinearFactorGraph(), gtsam.Values()
        moved = float(np.hypot(*(frame.sensor_pose - self._sensor)[:2]))
        guess = gtsam.Pose2(*self._first) if now == 0 else self._isam.calculateEstimatePose2(_o(now - 1))
        values.insert(_o(now), guess)
        values.insert(_e(now), gtsam.Pose2(*frame.sensor_pose))
        graph.push_back(gtsam.PriorFactorPose2(_e(now), gtsam.Pose2(*frame.sensor_pose), _sigmas(_SENSOR)))
        graph.push_back(_custom_contact([_o(now), _e(now), _LASTING], self._model))
        if now == 0:
            values.insert(_LASTING, _LASTING_MEAN)
            graph.push_back(gtsam.PriorFactorVector(_LASTING, _LASTING_MEAN, _sigmas(_LASTING_DEVIATION)))
            graph.push_back(gtsam.PriorFactorPose2(_o(0), guess, _sigmas(_FIRST_POSE)))
        else:
            keys = [_o(now - 1), _e(now - 1), _o(now), _e(now), _LASTING]
            graph.push_back(_custom_pushing(keys, moved, self._model))
        for relative in self._touch.measure(frame):
            assert isinstance(relative, RelativePoses)
            for back, pose in zip(relative.back, relative.pose, strict=True):
                keys = [_o(now - back), _e(now - back), _o(now), _e(now)]
                graph.push_back(_custom_between(keys, pose))
        self._isam.update(graph, values)
        pose = self._isam.calculateEstimatePose2(_o(now))
        covariance = self._isam.marginalCovariance(_o(now))
        self._steps, self._sensor = now + 1, frame.sensor_pose
        return _array(pose), covariance


def _custom_between(keys: list[int], measured: Array) -> gtsam.CustomFactor:
    """The tactile factor on o and e of two steps: a measured relative pose `g_0^-1 g_1`."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        o0, e0, o1, e1 = (_array(values.atPose2(key)) for key in keys)
        touching = se2.between(o0, e0), se2.between(o1, e1)
        value, by_touching = between(*touching, measured)
        if jacobians is not None:
            for k, g in enumerate(touching):
                by_g = by_touching[:, 3 * k : 3 * k + 3]
                jacobians[2 * k] = np.asfortranarray(-by_g @ se2.adjoint(se2.inverse(g)))
                jacobians[2 * k + 1] = np.asfortranarray(by_g)
        return value

    return gtsam.CustomFactor(_sigmas(_TACTILE), keys, error)


def _custom_contact(keys: list[int], model: ContactModel) -> gtsam.CustomFactor:
    """The contact factor on o and e of a step and what lasts."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        g = se2.between(*(_array(values.atPose2(key)) for key in keys[:2]))
        value, jacobian = contact(touching(g, model), values.atVector(_LASTING)[_DEPTH])
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(-jacobian[:, :3] @ se2.adjoint(se2.inverse(g)))
            jacobians[1] = np.asfortranarray(jacobian[:, :3])
            jacobians[2] = np.zeros((1, _LASTING_SIZE), order="F")
            jacobians[2][:, _DEPTH] = jacobian[:, 3]
        return value

    return gtsam.CustomFactor(_sigmas([_CONTACT]), keys, error)


def _custom_pushing(keys: list[int], moved: float, model: ContactModel) -> gtsam.CustomFactor:
    """The rows of sticking and of balance on o and e of two steps and what lasts; the sensor moved so far [m]."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        o0, e0, o1, e1 = (_array(values.atPose2(key)) for key in keys[:4])
        g0, g1 = se2.between(o0, e0), se2.between(o1, e1)
        friction = values.atVector(_LASTING)[_FRICTION]
        value, jacobian = pushing(g0, e0, g1, e1, touching(g1, model), model, friction)
        if jacobians is not None:
            for k, g in enumerate((g0, g1)):
                by_g, by_e = jacobian[:, 6 * k : 6 * k + 3], jacobian[:, 6 * k + 3 : 6 * k + 6]
                jacobians[2 * k] = np.asfortranarray(-by_g @ se2.adjoint(se2.inverse(g)))
                jacobians[2 * k + 1] = np.asfortranarray(by_g + by_e)
            jacobians[4] = np.zeros((3, _LASTING_SIZE), order="F")
            jacobians[4][:, _FRICTION] = jacobian[:, 12:]
        return value

    slip = np.hypot(_STICKING, _STICKING_SHARE * moved)
    turning = np.hypot(_TURNING, _TURNING_SHARE * moved * model.friction_radius)
    return gtsam.CustomFactor(_sigmas([slip, slip, turning]), keys, error)


def between(pose_i: Array, pose_j: Array, measured: Array) -> tuple[Array, Array]:
    """Return `Log(measured^-1 pose_i^-1 pose_j)` (3,) [m, m, rad] and its Jacobian (3, 6) by both poses."""
    relative = se2.between(pose_i, pose_j)
    residual = se2.log(se2.between(measured, relative))
    by_j = se2.right_jacobian_inverse(residual)
    by_i = -by_j @ se2.adjoint(se2.inverse(relative))
    return residual, np.concatenate([by_i, by_j], axis=-1)


@dataclass(frozen=True)
class Touching:
    """How tip and outline touch at a sensor pose in the object frame, with derivatives (3,) with respect to it."""

    gap: Array
    """Distance between the tip's surface and the outline () [m]."""
    gap_by_g: Array
    point: Complex
    """The point of the tip's surface nearest to the outline, object frame () [m]."""
    point_by_g: Complex
    material: Complex
    """The same point in the sensor frame () [m]."""
    material_by_g: Complex


def touching(g: Array, model: ContactModel) -> Touching:
    """Return how the tip touches the outline at g (3,)."""
    turn = np.exp(1j * g[..., 2])
    center = complex(model.parts[0])
    placed, placed_by_g = _position(g) + turn * center, _moving(turn, center)
    distance, gradient, hessian = model.field.value_gradient_hessian(np.array([placed.real, placed.imag]))
    normal, bend_x, bend_y = _position(gradient), _position(hessian[..., 0]), _position(hessian[..., 1])
    normal_by_g = bend_x[..., None] * placed_by_g.real + bend_y[..., None] * placed_by_g.imag
    normal_in_sensor = np.conj(turn) * normal
    material_by_g = -model.radius * np.conj(turn)[..., None] * normal_by_g
    material_by_g[..., 2] += 1j * model.radius * normal_in_sensor
    return Touching(
        distance - model.radius,
        (np.conj(normal)[..., None] * placed_by_g).real,
        placed - model.radius * normal,
        placed_by_g - model.radius * normal_by_g,
        center - model.radius * normal_in_sensor,
        material_by_g,
    )


def contact(touch: Touching, depth: float) -> tuple[Array, Array]:
    """Return by how much more tip and outline are apart than depth [m] says, (1,) [m], and its Jacobian (1, 4)."""
    jacobian = np.ones((1, 4))
    jacobian[..., :3] = touch.gap_by_g
    return (touch.gap + depth)[..., None], jacobian


def pushing(
    g0: Array, e0: Array, g1: Array, e1: Array, touch: Touching, model: ContactModel, friction: Array
) -> tuple[Array, Array]:
    """Return the error of quasi-static pushing over a step (3,) and its Jacobian (3, 16) by g0, e0, g1, e1, friction.

    Rows 1 and 2 [m]: how far the object slid along the sensor, object frame. Row 3 [m^2]: balance of force and torque
    on the ellipsoidal limit surface, `p x v - c^2 omega`. friction (4,) is the logarithm of the ratio of c^2, the
    centre of friction x and y [c], and the grip, which is of no account here.
    """
    c = model.friction_radius
    c_squared = c**2 * np.exp(friction[0])
    center = np.asarray(model.friction_center + c * (friction[1] + 1j * friction[2]))
    turn_g0, turn_e0, turn_e1, turn_g1 = (np.exp(1j * pose[..., 2]) for pose in (g0, e0, e1, g1))
    # The centre was at `g1 e1^-1 e0 g0^-1 center` at step 0, seen from the object at step 1.
    in_sensor0 = np.conj(turn_g0) * (center - _position(g0))
    in_world = _position(e0) + turn_e0 * in_sensor0
    in_sensor1 = np.conj(turn_e1) * (in_world - _position(e1))
    turn_sensor0 = turn_g1 * np.conj(turn_e1) * turn_e0
    way = center - (_position(g1) + turn_g1 * in_sensor1)
    way_by_sensor0, way_by_sensor1 = _moving(turn_sensor0, in_sensor0), _moving(turn_g1, in_sensor1)
    way_by_center = 1.0 - turn_sensor0 * np.conj(turn_g0)
    residual, jacobian = np.zeros(3), np.zeros((3, 16))

    slid = _position(g0) + turn_g0 * touch.material - touch.point
    residual[0], residual[1] = slid.real, slid.imag
    jacobian[:2, 0:3] = _real_rows(_moving(turn_g0, touch.material))
    jacobian[:2, 6:9] = _real_rows(turn_g0[..., None] * touch.material_by_g - touch.point_by_g)

    arm = touch.point - center
    omega = se2.wrap(e1[..., 2] - e0[..., 2] - g1[..., 2] + g0[..., 2])
    residual[2] = _cross(arm, way) - c_squared * omega
    lever = np.conj(arm)
    by_sensor0, by_sensor1 = (lever * way_by_sensor0).imag, (lever * way_by_sensor1).imag
    jacobian[2, 0:3], jacobian[2, 3:6] = by_sensor0, -by_sensor0
    jacobian[2, 6:9], jacobian[2, 9:12] = -by_sensor1 + _cross(touch.point_by_g, way[..., None]), by_sensor1
    jacobian[2, [2, 11]] -= c_squared  # omega grows with the turns of g0 and e1,
    jacobian[2, [5, 8]] += c_squared  # and shrinks with those of e0 and g1
    by_center = lever * way_by_center
    jacobian[2, 12] = -c_squared * omega
    jacobian[2, 13], jacobian[2, 14] = c * (by_center.imag - way.imag), c * (by_center.real + way.real)
    return residual, jacobian


def _moving(turn: Complex, point: Complex | complex) -> Complex:
    """How a point of a body moves with the body: derivative by a right perturbation of its pose, complex (3,)."""
    moved = np.empty(3, dtype=np.complex128)
    moved[0] = turn
    moved[1] = 1j * turn
    moved[2] = moved[1] * point
    return moved


def _position(vector: Array) -> Complex:
    """The first two components of a vector as a complex number ()."""
    return vector[..., 0] + 1j * vector[..., 1]


def _real_rows(columns: Complex) -> Array:
    """A complex Jacobian (columns,) as a real one (2, columns)."""
    rows = np.empty((2, len(columns)))
    rows[0], rows[1] = columns.real, columns.imag
    return rows


def _cross(a: Complex, b: Complex) -> Array:
    """Cross product of planar vectors."""
    return (np.conj(a) * b).imag


def _sigmas(sigmas: object) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.asarray(sigmas, dtype=np.float64))


def _array(pose: gtsam.Pose2) -> Array:
    return np.array([pose.x(), pose.y(), pose.theta()])


def _o(step: int) -> int:
    return gtsam.symbol("o", int(step))


def _e(step: int) -> int:
    return gtsam.symbol("e", int(step))
