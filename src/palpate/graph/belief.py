"""Gaussian beliefs about the object, one a row: its pose and the variables that belong to it."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from palpate.arrays import Array, Flags, Integers
from palpate.config import Priors
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.variables import DEPTH, IN_OBJECT, OBJECT_SIZE, OUTLINE_SCALE, Variable

_DEPTH, _SIZE = IN_OBJECT[DEPTH].start, IN_OBJECT[OUTLINE_SCALE].start
Indices = Integers | Flags | list[int] | slice


class RowArrays:
    """Base of dataclasses whose fields all have one leading axis of rows, or are such dataclasses themselves."""

    def take(self, rows: Indices) -> Self:
        """Return these rows; a row may be taken several times."""
        every = vars(self).items()
        return type(self)(**{name: one[rows] if isinstance(one, np.ndarray) else one.take(rows) for name, one in every})

    def joined(self, other: Self) -> Self:
        """Return the rows of both, one after the other."""
        both = {}
        for name, one in vars(self).items():
            two = getattr(other, name)
            both[name] = np.concatenate([one, two]) if isinstance(one, np.ndarray) else one.joined(two)
        return type(self)(**both)


@dataclass(frozen=True, eq=False)
class Belief(RowArrays):
    """Belief about the object in each of B hypotheses."""

    pose: Array
    """world_T_object, (B, 3) [m, m, rad]."""
    values: Array
    """Variables that belong to the object, (B, OBJECT_SIZE)."""
    covariance: Array
    """Joint covariance (B, 3 + OBJECT_SIZE, 3 + OBJECT_SIZE); of the pose in its tangent space (right, body frame)."""

    def __getitem__(self, variable: Variable) -> Array:
        """Return a variable of the object, (B, dimension)."""
        return self.values[:, IN_OBJECT[variable]]

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def pose_covariance(self) -> Array:
        """Covariance of the pose, (B, 3, 3)."""
        return self.covariance[:, :3, :3]

    def variances(self, derivatives: Array) -> Array:
        """Return the variances (B, P) of numbers with these derivatives (B, P, 3 + OBJECT_SIZE) by the belief."""
        return np.einsum("bpi,bij,bpj->bp", derivatives, self.covariance, derivatives)

    def inflated(self, covariance: Array) -> "Belief":
        """Return the same with covariances (3, 3) or (B, 3, 3) added to that of the pose."""
        joint = self.covariance.copy()
        joint[:, :3, :3] += covariance
        return Belief(self.pose, self.values, joint)

    def at_next_contact(self, priors: Priors) -> "Belief":
        """Return the belief for the next contact, between which the object's variables may have changed.

        They move back towards their priors by as much as they become less certain, so that without measurements they
        return to the priors.
        """
        changes = priors.changes[0]
        keeps = np.sqrt(1.0 - changes / np.square(priors.deviation))
        left = np.concatenate([np.ones(3), keeps])
        joint = self.covariance * np.outer(left, left)
        joint[:, 3:, 3:] += np.diag(changes)
        return Belief(self.pose, priors.mean + keeps * (self.values - priors.mean), joint)


def clearances(belief: Belief, model: ContactModel, sensor_poses: Array) -> tuple[Array, Array]:
    """Return the distances (B, P) [m] of sensor poses (P, 3) from the object, and their derivatives by the belief.

    These are (B, P, 3 + OBJECT_SIZE), in the order of `Belief.covariance`.
    """
    g = se2.between(belief.pose[:, None], sensor_poses)
    near = model.touching(g)
    gap, normal = near["gap"], near["normal"]
    reach = np.real(np.conj(normal) * (near["point"] - model.friction_center)) - gap * np.square(np.abs(normal))
    # A wrench on the sensor, moved to the object's origin: moving the object is moving the sensor backwards.
    place, by_g = g[..., 0] + 1j * g[..., 1], near["gap_by_g"]
    force = np.exp(1j * g[..., 2]) * (by_g[..., 0] + 1j * by_g[..., 1])
    by = np.zeros((*gap.shape, 3 + OBJECT_SIZE))
    by[..., 0], by[..., 1], by[..., 2] = -force.real, -force.imag, -by_g[..., 2] - (place.conj() * force).imag
    by[..., 3 + _DEPTH], by[..., 3 + _SIZE] = 1.0, -reach
    return gap + belief[DEPTH] - belief[OUTLINE_SCALE] * reach, by
