"""Contact point between sensor and object, and the probability that the contact slides."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.graph.belief import Belief
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.variables import GRIP

Array = NDArray[np.float64]

_EDGE = 0.02
"""Angle over which sticking turns into sliding at the cone's edge [rad]. While a contact slides, the graph holds the
force at the edge, so that friction and angle err together; on simulated pushes, of the steps with a given probability
about that share did slide."""


class ContactPoint(NamedTuple):
    """A contact at one instant, world frame."""

    point: Array
    """Point of the outline in contact, (2,) [m]; of a wide pad or several tips the load-weighted mean."""
    normal: Array
    """Outward normal of the outline there, (2,)."""
    sliding: float
    """Probability that the contact slides, 0 to 1; NaN if unknown."""


def contact_point(model: ContactModel, sensor_in_object: Array, belief: Belief, force_angle: float) -> ContactPoint:
    """Return the contact point of one belief; force_angle is that of the force from the inward normal [rad]."""
    nearest = model.touching(np.ascontiguousarray(sensor_in_object)[None, None])[0, 0]
    x, y, theta = belief.pose[0].tolist()
    turn = complex(math.cos(theta), math.sin(theta))
    point = complex(x, y) + turn * nearest["point"]
    normal = turn * nearest["normal"] / abs(nearest["normal"])
    beyond = math.atan(float(belief[GRIP][0, 0])) - abs(force_angle)
    sliding = 0.5 * math.erfc(beyond / (math.sqrt(2.0) * _EDGE))
    return ContactPoint(np.array([point.real, point.imag]), np.array([normal.real, normal.imag]), sliding)
