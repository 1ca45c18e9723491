"""Corner: touch measures the angle of the contact's inward normal off the bisector of the corner touched.

The corner is the one nearest to the contact, and h is half the angle between the normals of its sides. At a corner psi,
the angle of the inward normal off the bisector, follows the sensor's position; on its sides it is constant, so that a
measured angle inside the cone speaks against them. Outlines without corners have no such residual.
"""

import math
from typing import Any

from palpate.arrays import Array, Records
from palpate.compiled import kernel
from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar, bearing, clamp
from palpate.manifolds.planar import Pose, Vector
from palpate.models.pushing.contact_geometry import HALF_RIGHT_ANGLE
from palpate.models.pushing.direction import variance
from palpate.types.measurements import ContactCorner


@kernel
def nearest_corner(now: Records, corners: Array) -> tuple[float, float, float]:
    """Return cosine and sine of the bisector of the corner nearest to the contact, and h [rad]; -1 without corners.

    Corners (K, 4) are those of `ContactModel.corners`.
    """
    return _corner_nearest_to(now.touch.point, corners)


@kernel
def nearest_corner_of(now: Records, finger: int, corners: Array) -> tuple[float, float, float]:
    """Return the same of the contact of a finger."""
    return _corner_nearest_to(now.touch_of[finger].point, corners)


@kernel
def _corner_nearest_to(point: complex, corners: Array) -> tuple[float, float, float]:
    nearest = -1
    least = math.inf
    for i in range(len(corners)):
        distance = abs(point - complex(corners[i, 0], corners[i, 1]))
        if distance < least:
            nearest = i
            least = distance
    if nearest < 0:
        return 1.0, 0.0, -1.0
    bisector = corners[nearest, 2]
    return math.cos(bisector), math.sin(bisector), corners[nearest, 3]


def residual(now: Any, measured: Any, known: Any, corner_bias: Scalar) -> tuple[Scalar]:
    """Return `psi - angle - slope (h - 45 deg) - bias` [rad], with psi within -h to h."""
    bisector = Pose(Vector(0.0, 0.0), known.cos, known.sin, 0.0)
    inward = bisector.rotate_back(-now.touch.normal)
    psi = clamp(bearing(inward.x, inward.y), known.half)
    angle = measured.sign * (measured.angle + measured.slope * (known.half - HALF_RIGHT_ANGLE))
    return (psi - angle - corner_bias,)


def applies(known: Any) -> Any:
    """Return True for outlines that have corners."""
    return known.half > 0.0


CORNER = Factor(
    "corner",
    residual,
    variance,
    measurement=ContactCorner,
    data=("angle", "slope"),
    kernel="each",
    applies=applies,
    lookup=nearest_corner,
    found=("cos", "sin", "half"),
)
