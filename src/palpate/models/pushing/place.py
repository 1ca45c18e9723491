"""Contact place: touch measures the position along y at which a flat pad is touched.

On a flat pad a round outline always has its normal along x; the place is to a flat pad what the contact direction is to
a round tip.
"""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar
from palpate.models.pushing.direction import variance
from palpate.types.measurements import ContactPlace


def residual(now: Any, measured: Any, place_bias: Scalar) -> tuple[Scalar]:
    """Return `y of the material point + bias - place` [m].

    The material point is the load-weighted mean over the pad's parts.
    """
    return (now.touch.material.y + place_bias - measured.sign * measured.place,)


PLACE = Factor("place", residual, variance, measurement=ContactPlace, data=("place",), kernel="each")
