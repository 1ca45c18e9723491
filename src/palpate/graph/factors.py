"""The residuals of the factor graph and their Jacobians, for one step or for a whole window of steps at once.

The variables of step t are the sensor pose in the object frame `g_t = o_t^-1 e_t` and the sensor pose in the world
`e_t`; the object pose is `o_t = e_t g_t^-1`. Jacobians are with respect to right (body-frame) perturbations of these
poses, order x, y, theta. All leading axes are free: poses are (..., 3), residuals (..., rows), Jacobians
(..., rows, columns).

With these variables the paper's tactile factor (Eqs. 5, 6) is a plain between factor on `g_i, g_j`, and contact needs
no sensor pose. Between contacts the object rests, `o_t = o_t-1`: the graph of the next contact begins with a
`first_pose` factor whose covariance is the last marginal plus that of resting, which is what remains of the paper's
rest factor once the past is marginalised.

Inside, a planar vector is a complex number: `exp(i theta)` turns it by theta, `i` by 90 degrees.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.distance_field import DistanceField
from palpate.geometry.shapes import Shape
from palpate.recording.sensor import SensorProfile

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_NO_GRADIENT = 1e-12  # squared length of a gradient that points nowhere
_FIELD_MARGIN = 0.04  # [m] beyond the outline within which distances come from the grid


@dataclass(frozen=True)
class ContactModel:
    """What touches what: the object's outline and friction, and one round tip of the sensor."""

    field: DistanceField
    """Signed distance of the object's outline [m], object frame."""
    center: tuple[float, float]
    """Centre of curvature of the tip [m], sensor frame."""
    radius: float
    """Radius of curvature of the tip [m]; 0 is the paper's point."""
    friction_radius: float
    """c [m], the largest friction torque over the largest friction force between object and table."""
    friction_center: tuple[float, float] = (0.0, 0.0)
    """Centre of the pressure distribution [m], object frame."""
    alone: bool = True
    """Whether the whole pushing force acts here. One of several tips bears an unknown share of it, so that the balance
    of force and torque says nothing about it."""


def contact_models(shape: Shape, sensor: SensorProfile, pressure: str | float = "uniform") -> list[ContactModel]:
    """Return what each tip of the sensor is to an object of this shape.

    pressure is how the object presses on the table ("uniform", "rim" or "corner"), which gives c, or c itself [m].
    """
    field = DistanceField.of(shape, margin=max(_FIELD_MARGIN, 2.0 * sensor.radius))
    c = shape.friction_radius(pressure)
    x, y = shape.centroid.tolist()
    alone = len(sensor.tips) == 1
    return [ContactModel(field, (cx, cy), sensor.radius, c, (x, y), alone) for cx, cy in sensor.centers.tolist()]


@dataclass(frozen=True)
class Touching:
    """How tip and outline touch at a sensor pose g (..., 3) in the object frame, with derivatives with respect to g.

    It is what contact, direction and pushing need of the outline, so that it is looked up once for all of them.
    """

    turn: Complex
    """The sensor's turn as a rotation, `exp(i theta)`, (...)."""
    gap: Array
    """Distance between the tip's surface and the outline, negative where they overlap, (...) [m]."""
    gap_by_g: Array
    """(..., 3)"""
    point: Complex
    """The point of the tip's surface nearest to the outline, object frame, (...) [m]."""
    point_by_g: Complex
    """(..., 3)"""
    material: Complex
    """The same point in the sensor frame, (...) [m]."""
    material_by_g: Complex
    """(..., 3)"""
    normal: Complex
    """The outline's outward normal there, object frame, (...)."""
    normal_by_g: Complex
    """(..., 3)"""

    def __getitem__(self, steps: slice) -> "Touching":
        """Return those steps, of the first axis."""
        return Touching(*(getattr(self, field.name)[steps] for field in fields(self)))


def touching(g: Array, model: ContactModel) -> Touching:
    """Return how tip and outline touch at g (..., 3)."""
    turn = np.exp(1j * g[..., 2])
    center = complex(*model.center)
    placed, placed_by_g = position(g) + turn * center, moving(turn, center)
    distance, gradient, hessian = model.field.value_gradient_hessian(_real(placed))
    normal = as_complex(gradient)
    bend_x, bend_y = as_complex(hessian[..., 0]), as_complex(hessian[..., 1])
    normal_by_g = bend_x[..., None] * placed_by_g.real + bend_y[..., None] * placed_by_g.imag
    normal_in_sensor = np.conj(turn) * normal
    material_by_g = -model.radius * np.conj(turn)[..., None] * normal_by_g
    material_by_g[..., 2] += 1j * model.radius * normal_in_sensor
    return Touching(
        turn,
        distance - model.radius,
        (np.conj(normal)[..., None] * placed_by_g).real,
        placed - model.radius * normal,
        placed_by_g - model.radius * normal_by_g,
        center - model.radius * normal_in_sensor,
        material_by_g,
        normal,
        normal_by_g,
    )


def between(pose_i: Array, pose_j: Array, measured: Array) -> tuple[Array, Array]:
    """Error of a measured relative pose, `Log(measured^-1 pose_i^-1 pose_j)`: the tactile factor (Eq. 5).

    Returns the residual (..., 3) [m, m, rad] and its Jacobian (..., 3, 6) with respect to pose_i and pose_j.
    """
    relative = se2.between(pose_i, pose_j)
    residual, by_j = prior(relative, measured)
    by_i = -by_j @ se2.adjoint(se2.inverse(relative))
    return residual, np.concatenate([by_i, by_j], axis=-1)


def prior(pose: Array, measured: Array) -> tuple[Array, Array]:
    """Error of a measured pose, `Log(measured^-1 pose)`: the sensor pose prior (Eq. 12).

    Returns the residual (..., 3) [m, m, rad] and its Jacobian (..., 3, 3).
    """
    residual = se2.log(se2.between(measured, pose))
    return residual, se2.right_jacobian_inverse(residual)


def first_pose(g: Array, e: Array, measured: Array) -> tuple[Array, Array]:
    """Error of a known object pose, `Log(measured^-1 e g^-1)`.

    Returns the residual (..., 3) [m, m, rad] and its Jacobian (..., 3, 6) with respect to g and e.
    """
    residual, by_object = prior(se2.compose(e, se2.inverse(g)), measured)
    # With o = e g^-1: e exp(d) g^-1 = o exp(Ad_g d), and e (g exp(d))^-1 = o exp(-Ad_g d).
    by_e = by_object @ se2.adjoint(g)
    return residual, np.concatenate([-by_e, by_e], axis=-1)


def known(g: Array, e: Array, lasting: Array, pose: Array, known_lasting: Array) -> tuple[Array, Array]:
    """Error of a known object pose and of known unknowns of the contact that last: `first_pose`, then the difference.

    Returns the residual (3 + L,) and its Jacobian (3 + L, 6 + L) with respect to g, e and what lasts (L,).
    """
    residual, by_poses = first_pose(g, e, pose)
    jacobian = np.eye(3 + len(lasting), 6 + len(lasting), 3)
    jacobian[:3, :6] = by_poses
    return np.concatenate([residual, lasting - known_lasting]), jacobian


def contact(touch: Touching, depth: float) -> tuple[Array, Array]:
    """Distance between the tip's round surface and the outline (Eq. 11, two-sided), with a depth by which they overlap.

    Returns the residual (..., 1) [m], positive where they are further apart than depth [m] says and negative where
    they overlap more, and its Jacobian (..., 1, 4) with respect to g and the depth.
    """
    jacobian = np.ones((*touch.gap.shape, 4))
    jacobian[..., :3] = touch.gap_by_g
    return (touch.gap + depth)[..., None], jacobian[..., None, :]


def direction(touch: Touching, angle: Array | float, bias: Array | float) -> tuple[Array, Array]:
    """Error of a measured contact direction: from the tip's centre to the nearest point of the outline, plus a bias.

    The centre lies outside the object, so that this is down the gradient of the signed distance there. angle (...)
    [rad] is measured in the sensor frame, 0 along +x; bias [rad] is what all angles are too large by. Returns the
    residual (..., 1) [rad] in (-pi, pi] and its Jacobian (..., 1, 4) with respect to g and the bias.
    """
    normal = touch.normal
    residual = np.angle(-normal * np.conj(touch.turn) * np.exp(1j * (np.asarray(bias) - np.asarray(angle))))
    # The spline's gradient has length 1 but near the outline's medial axis; where it vanishes there is no direction.
    square = np.maximum((np.conj(normal) * normal).real, _NO_GRADIENT)
    jacobian = np.ones((*residual.shape, 4))
    jacobian[..., :3] = cross(normal[..., None], touch.normal_by_g) / square[..., None]
    jacobian[..., 2] -= 1.0  # the direction stays while the sensor turns
    return residual[..., None], jacobian[..., None, :]


def turn(g: Array, offset: Array | float, angle: Array | float) -> tuple[Array, Array]:
    """Error of a measured turn: yaw of the sensor in the object frame less the offset (...) and the angle (...) [rad].

    Returns the residual (..., 1) [rad] in (-pi, pi] and its Jacobian (..., 1, 4) with respect to g and the offset.
    """
    residual = se2.wrap(np.asarray(g[..., 2] - offset - angle))
    jacobian = np.broadcast_to([0.0, 0.0, 1.0, -1.0], (*residual.shape, 1, 4))
    return residual[..., None], jacobian


def moving(turn: Complex, point: Complex | complex) -> Complex:
    """How a point of a body moves with the body: derivative by a right perturbation of its pose, complex (..., 3)."""
    moved = np.empty((*turn.shape, 3), dtype=np.complex128)
    moved[..., 0] = turn
    moved[..., 1] = 1j * turn
    moved[..., 2] = moved[..., 1] * point
    return moved


def position(pose: Array) -> Complex:
    """Place of poses (..., 3) as complex (...) [m]."""
    return as_complex(pose)


def as_complex(vector: Array) -> Complex:
    """The first two components of vectors (..., 2 or more) as complex (...)."""
    return vector[..., 0] + 1j * vector[..., 1]


def _real(vector: Complex) -> Array:
    parts = np.empty((*vector.shape, 2))  # np.stack takes three times as long, and this is done for every step
    parts[..., 0], parts[..., 1] = vector.real, vector.imag
    return parts


def real_rows(columns: Complex) -> Array:
    """A complex Jacobian (..., columns) as a real one (..., 2, columns)."""
    rows = np.empty((*columns.shape[:-1], 2, columns.shape[-1]))
    rows[..., 0, :], rows[..., 1, :] = columns.real, columns.imag
    return rows


def cross(a: Complex | complex, b: Complex) -> Array:
    """Cross product of planar vectors."""
    return (np.conj(a) * b).imag
