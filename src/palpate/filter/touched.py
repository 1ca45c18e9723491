"""Where the sensor touches the object, and whether the contact holds there or slides."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.filter.belief import Belief
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.variables import GRIP, IN_OBJECT

Array = NDArray[np.float64]

_EDGE = 0.02
"""[rad] over which holding goes over into sliding at the cone's edge. Where a contact slides the graph holds the force
at the edge, so that friction and angle err together; on simulated pushes, of the steps of a likelihood about that share
did slide."""


@dataclass(frozen=True, eq=False)
class Touched:
    """A contact at one instant, world frame."""

    point: Array
    """Where the tip touches the outline, (2,) [m]; of a wide pad or several tips the middle of what bears the load."""
    normal: Array
    """The outline's outward normal there, (2,)."""
    sliding: float
    """How likely it is that the contact slides, 0 to 1; NaN where that is not known."""


def touched(model: ContactModel, belief: Belief, force_angle: float) -> Touched:
    """Return what is touched by a belief; force_angle is that of the pushing force from the inward normal [rad]."""
    nearest = model.touching_at(belief.g)
    pose = belief.prior.pose
    turn = complex(math.cos(pose[2]), math.sin(pose[2]))
    point = complex(pose[0], pose[1]) + turn * nearest["point"]
    normal = turn * nearest["normal"] / abs(nearest["normal"])
    sliding = _sliding(float(belief.values[IN_OBJECT[GRIP].start]), force_angle)
    return Touched(np.array([point.real, point.imag]), np.array([normal.real, normal.imag]), sliding)


def _sliding(friction: float, force_angle: float) -> float:
    """How likely it is that the force is outside the friction cone."""
    return 0.5 * math.erfc((math.atan(friction) - abs(force_angle)) / (math.sqrt(2.0) * _EDGE))
