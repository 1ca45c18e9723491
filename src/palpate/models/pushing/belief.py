"""Gaussian beliefs about the object, one a row: its pose and the variables that belong to it."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array
from palpate.estimation.rows import RowArrays
from palpate.estimation.variable import Variable
from palpate.geometry import se2
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.hand import hand_model, variable_of
from palpate.models.pushing.model import MODEL
from palpate.models.pushing.priors import ObjectPrior
from palpate.models.pushing.variables import DEPTH, OUTLINE_SCALE

_IN_OBJECT = MODEL.in_object
_SCALE = 3 + _IN_OBJECT[OUTLINE_SCALE].start
_TANGENT = 3  # numbers of a pose


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
        left = np.concatenate([np.ones(_TANGENT), keeps])
        joint = self.covariance * np.outer(left, left)
        joint[:, _TANGENT:, _TANGENT:] += np.diag(changes)
        return Belief(self.pose, prior.mean + keeps * (self.values - prior.mean), joint)


def place_of(variable: Variable, finger: int) -> slice:
    """Return the place of a finger's variable among those of the object, whatever number of fingers comes after it."""
    if finger == 0:
        return _IN_OBJECT[variable]
    return hand_model(finger + 1).in_object[variable_of(variable, finger)]


def clearances(belief: Belief, model: ContactModel, sensor_poses: Array) -> tuple[Array, Array]:
    """Return the distances (B, P) [m] of sensor poses (P, 3) from the object, and their derivatives by the belief.

    These are (B, P, 3 + V), in the order of `Belief.covariance`.
    """
    g = se2.between(belief.pose[:, None], sensor_poses)
    near = model.touching(g)
    gap = near["gap"]
    normal = near["normal"]
    arm = near["point"] - model.friction_center
    extent = np.real(np.conj(normal) * arm) - gap * np.square(np.abs(normal))
    # A wrench on the sensor, moved to the object's origin: moving the object is moving the sensor backwards.
    position = g[..., 0] + 1j * g[..., 1]
    by_g = near["gap_by_g"]
    force = np.exp(1j * g[..., 2]) * (by_g[..., 0] + 1j * by_g[..., 1])
    derivative = np.zeros((*gap.shape, _TANGENT + belief.values.shape[1]))
    derivative[..., 0] = -force.real
    derivative[..., 1] = -force.imag
    derivative[..., 2] = -by_g[..., 2] - (position.conj() * force).imag
    depth = place_of(DEPTH, model.finger)
    derivative[..., 3 + depth.start] = 1.0
    derivative[..., _SCALE] = -extent
    return gap + belief.values[:, depth] - belief[OUTLINE_SCALE] * extent, derivative
