"""What is believed of the object: before a contact, and by the graph of a contact at its last step."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.config import Priors
from palpate.geometry import se2
from palpate.graph.variables import IN_OBJECT, OBJECT_SIZE, Unknown

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the object when a contact begins."""

    pose: Array
    """world_T_object, (3,) [m, m, rad]."""
    values: Array
    """What belongs to the object, (OBJECT_SIZE,); see `unknowns`."""
    covariance: Array
    """Joint covariance of both, (3 + OBJECT_SIZE, 3 + OBJECT_SIZE); of the pose in the tangent space there (right, body
    frame)."""

    def __getitem__(self, unknown: Unknown) -> Array:
        """The value of an unknown of the object."""
        return self.values[IN_OBJECT[unknown]]

    @property
    def pose_covariance(self) -> Array:
        """That of the pose, (3, 3)."""
        return self.covariance[:3, :3]

    def loosened(self, covariance: Array) -> "Prior":
        """Return the same with the pose less certain by a covariance (3, 3)."""
        joint = self.covariance.copy()
        joint[:3, :3] += covariance
        return replace(self, covariance=joint)

    def at_next_contact(self, usual: Priors) -> "Prior":
        """Return the same with what belongs to the object changed, see `config.Priors`.

        It goes back towards what is usual by as much as it becomes less certain: where contacts teach nothing it is
        known as well as before the first one, and never worse.
        """
        changes = usual.changes_between_contacts
        keeps = np.sqrt(1.0 - changes / np.square(usual.deviation))
        left = np.concatenate([np.ones(3), keeps])
        joint = self.covariance * np.outer(left, left)
        joint[3:, 3:] += np.diag(changes)
        return replace(self, values=usual.mean + keeps * (self.values - usual.mean), covariance=joint)


@dataclass(frozen=True, eq=False)
class Belief:
    """What the graph says about its last step."""

    g: Array
    """Sensor pose in the object frame, (3,) [m, m, rad]."""
    e: Array
    """Sensor pose in the world, (3,) [m, m, rad]."""
    values: Array
    """What belongs to the object, (OBJECT_SIZE,)."""
    covariance: Array
    """Joint covariance (6 + OBJECT_SIZE, 6 + OBJECT_SIZE) of g and e, each in the tangent space at its estimate (right,
    body frame), and of what belongs to the object."""

    @property
    def prior(self) -> Prior:
        """Return what it says of the object, which is what the next contact begins with."""
        # o = e g^-1: o moves by Ad_g (d_e - d_g)
        by_g = se2.adjoint(self.g)
        by_all = np.eye(3 + OBJECT_SIZE, 6 + OBJECT_SIZE, 3)
        by_all[:3, :3], by_all[:3, 3:6] = -by_g, by_g
        covariance = by_all @ self.covariance @ by_all.T
        pose = se2.compose(self.e, se2.inverse(self.g))
        return Prior(pose, self.values, 0.5 * (covariance + covariance.T))
