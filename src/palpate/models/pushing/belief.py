"""Gaussian beliefs about the object, one a row: its pose and the variables that belong to it."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array, Records
from palpate.compiled import compiled
from palpate.estimation.records import POSE
from palpate.estimation.rows import RowArrays
from palpate.estimation.variable import Variable
from palpate.manifolds.se2_kernels import position, rotation
from palpate.models.pushing.contact_geometry import CONTACT_GEOMETRY, SURFACE, ContactModel, Surface, put_touch
from palpate.models.pushing.hand import hand_model, variable_of
from palpate.models.pushing.model import MODEL
from palpate.models.pushing.priors import ObjectPrior
from palpate.models.pushing.variables import DEPTH, OUTLINE_SCALE

_IN_OBJECT = MODEL.in_object
_SCALE = _IN_OBJECT[OUTLINE_SCALE].start


@dataclass(frozen=True, eq=False)
class Belief(RowArrays):
    """Belief about the object in each of B hypotheses."""

    pose: Array
    """world_T_object, (B, 3) [m, m, rad]."""
    values: Array
    """Variables that belong to the object, (B, V)."""
    covariance: Array
    """Joint covariance (B, 3 + V, 3 + V); of the pose in its tangent space (right, body frame)."""

    def __getitem__(self, variable: Variable) -> Array:
        """Return a variable of pushing that belongs to the object, (B, dimension)."""
        return self.values[:, _IN_OBJECT[variable]]

    def of_finger(self, variable: Variable, finger: int) -> Array:
        """Return the variable of a finger of a hand that is this one of a single sensor, (B, dimension)."""
        return self.values[:, place_of(variable, finger)]

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def pose_covariance(self) -> Array:
        """Covariance of the pose, (B, 3, 3)."""
        return self.covariance[:, :3, :3]

    def variances(self, derivatives: Array) -> Array:
        """Return the variances (B, P) of numbers with these derivatives (B, P, 3 + V) by the belief."""
        return np.einsum("bpi,bij,bpj->bp", derivatives, self.covariance, derivatives)

    def inflated(self, covariance: Array) -> "Belief":
        """Return the same with covariances (3, 3) or (B, 3, 3) added to that of the pose."""
        joint = self.covariance.copy()
        joint[:, :3, :3] += covariance
        return Belief(self.pose, self.values, joint)

    def at_next_contact(self, prior: ObjectPrior) -> "Belief":
        """Return the belief for the next contact, between which the object's variables may have changed.

        They move back towards their prior by as much as they become less certain, so that without measurements they
        return to it.
        """
        changes = prior.change_between_contacts
        keeps = np.sqrt(1.0 - changes / np.square(prior.deviation))
        left = np.concatenate([np.ones(POSE), keeps])
        joint = self.covariance * np.outer(left, left)
        joint[:, POSE:, POSE:] += np.diag(changes)
        return Belief(self.pose, prior.mean + keeps * (self.values - prior.mean), joint)


def place_of(variable: Variable, finger: int) -> slice:
    """Return the place of a finger's variable among those of the object, whatever number of fingers comes after it."""
    if finger == 0:
        return _IN_OBJECT[variable]
    return hand_model(finger + 1).in_object[variable_of(variable, finger)]


def clearances(belief: Belief, model: ContactModel, sensor_poses: Array) -> tuple[Array, Array]:
    """Return the distances (B, P) [m] of sensor poses (P, 3) or (B, P, 3) from the object, and their derivatives.

    These are (B, P, 3 + V), by the belief in the order of `Belief.covariance`.
    """
    poses = np.ascontiguousarray(sensor_poses.reshape(-1, *sensor_poses.shape[-2:]))
    shape = (len(belief), poses.shape[1])
    near = np.empty(shape, CONTACT_GEOMETRY)
    gap = np.empty(shape)
    derivative = np.zeros((*shape, POSE + belief.values.shape[1]))
    depth = place_of(DEPTH, model.finger).start
    _put_clearances(
        belief.pose, belief.values, poses, depth, model.friction_center, model.surface, near, gap, derivative
    )
    return gap, derivative


@compiled(
    np.zeros((1, 3)),
    np.zeros((1, 1)),
    np.zeros((1, 1, 3)),
    0,
    0j,
    SURFACE,
    np.zeros((1, 1), CONTACT_GEOMETRY),
    np.zeros((1, 1)),
    np.zeros((1, 1, 1)),
)
def _put_clearances(
    poses: Array,
    values: Array,
    sensor_poses: Array,
    depth: int,
    center: complex,
    surface: Surface,
    near: Records,
    gap: Array,
    derivative: Array,
) -> None:
    """Write the geometry of contact (B, P), gaps (B, P) and derivatives; the depth has this place among the values.

    Sensor poses (B, P, 3) are those of each belief, or (1, P, 3) those of all.
    """
    for b in range(len(poses)):
        sensors = sensor_poses[min(b, len(sensor_poses) - 1)]
        for p in range(len(sensors)):
            back = rotation(-poses[b, 2])
            place = back * (position(sensors[p]) - position(poses[b]))
            turn = back * rotation(sensors[p, 2])
            touch = near[b, p]
            put_touch(place, turn, surface, touch)
            normal = touch.normal
            extent = (normal.conjugate() * (touch.point - center)).real
            extent -= touch.gap * (normal.real**2 + normal.imag**2)
            gap[b, p] = touch.gap + values[b, depth] - values[b, _SCALE] * extent
            # To move the object is to move the sensor backwards. So the derivative is that by the sensor's pose, moved
            # to the object's origin as a force and a torque would be.
            force = turn * complex(touch.gap_by_g[0], touch.gap_by_g[1])
            out = derivative[b, p]
            out[0] = -force.real
            out[1] = -force.imag
            out[2] = -touch.gap_by_g[2] - (place.conjugate() * force).imag
            out[POSE + depth] = 1.0
            out[POSE + _SCALE] = -extent
