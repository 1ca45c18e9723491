"""Gaussian beliefs about the object, one a row: its pose and the variables that belong to it."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.config import Priors
from palpate.graph.compiled import Records, compiled
from palpate.graph.contact_geometry import CONTACT_GEOMETRY, ContactModel, Surface, put_touch
from palpate.graph.se2_kernels import between, cross, dot, position, rotation
from palpate.graph.variables import DEPTH, IN_OBJECT, OBJECT_SIZE, OUTLINE_SCALE, Variable

Array = NDArray[np.float64]
_DEPTH, _SIZE, _NUMBERS = IN_OBJECT[DEPTH].start, IN_OBJECT[OUTLINE_SCALE].start, 3 + OBJECT_SIZE
Indices = NDArray[np.int64] | NDArray[np.bool_] | list[int] | slice
R = TypeVar("R", bound="RowArrays")


class RowArrays:
    """Base of dataclasses whose fields all have one leading axis of rows, or are such dataclasses themselves."""

    def take(self: R, rows: Indices) -> R:
        """Return these rows; a row may be taken several times."""
        every = vars(self).items()
        return type(self)(**{name: one[rows] if isinstance(one, np.ndarray) else one.take(rows) for name, one in every})

    def joined(self: R, other: R) -> R:
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
    """Return the distances [m] of sensor poses (P, 3) from the object and their variances [m^2], (B, P) each.

    From the second pose on, the variance is that of the difference from the first distance.
    """
    gaps, variances = np.empty((2, len(belief), len(sensor_poses)))
    pose, values, covariance = map(np.ascontiguousarray, (belief.pose, belief.values, belief.covariance))
    touch, room = np.empty(1, CONTACT_GEOMETRY), (np.empty(3), np.zeros((2, _NUMBERS)))
    _put_clearances(
        pose, values, covariance, sensor_poses, model.surface, model.friction_center, touch, room, gaps, variances
    )
    return gaps, variances


@compiled
def _put_clearances(
    poses: Array,
    values: Array,
    covariances: Array,
    sensor_poses: Array,
    surface: Surface,
    center: complex,
    touch: Records,
    room: tuple[Array, Array],
    gaps: Array,
    variances: Array,
) -> None:
    g, derivatives = room
    near = touch[0]
    for b in range(gaps.shape[0]):
        for p in range(gaps.shape[1]):
            between(poses[b], sensor_poses[p], g)
            put_touch(position(g), rotation(g[2]), surface, near)
            reach = dot(near.normal, near.point - center) - near.gap * dot(near.normal, near.normal)
            gaps[b, p] = near.gap + values[b, _DEPTH] - values[b, _SIZE] * reach
            # A wrench on the sensor, moved to the object's origin: moving the object is moving the sensor backwards.
            force, by = rotation(g[2]) * complex(near.gap_by_g[0], near.gap_by_g[1]), derivatives[min(p, 1)]
            by[0], by[1], by[2] = -force.real, -force.imag, -near.gap_by_g[2] - cross(position(g), force)
            by[3 + _DEPTH], by[3 + _SIZE] = 1.0, -reach
            variances[b, p] = 0.0
            for i in range(_NUMBERS):
                by[i] -= derivatives[0, i] if p > 0 else 0.0
            for i in range(_NUMBERS):
                for j in range(_NUMBERS):
                    variances[b, p] += by[i] * covariances[b, i, j] * by[j]
