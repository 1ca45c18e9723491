"""Contact direction: touch tells where on its round surface the tip is touched.

The true direction is from the tip's centre to the nearest point of the outline, which is against the outline's outward
normal n there, seen in the sensor frame. The residual is the angle of `-n exp(i (bias - theta - (1 - scale) angle))`,
in (-pi, pi]. It is absolute and does not drift: yaw on a straight edge, the place along a round one.
"""

import math

import numpy as np

from palpate.filter.belief import Prior
from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.one_term_each import OneTermEach
from palpate.graph.se2_kernels import cauchy, cross, rotation
from palpate.graph.values import State
from palpate.graph.variables import DIRECTION_BIAS, DIRECTION_SCALE, IN_SHARED, SENSOR_IN_OBJECT
from palpate.types.measurements import ContactDirection

DATA = np.dtype([("angle", np.float64), ("information", np.float64)])
_NO_GRADIENT = 1e-12  # squared length of a gradient that points nowhere


_BIAS, _SCALE = IN_SHARED[DIRECTION_BIAS].start, IN_SHARED[DIRECTION_SCALE].start


@compiled
def _linearise(
    state: State,
    places: Places,
    data: Records,
    given: Given,
    residual: Array,
    jacobian: Array,
    information: Array,
    weight: Array,
) -> None:
    g, _e, shared, touching, _angle, _c, _model_center, _knocks = state
    (kernel,) = given
    for b in range(len(g)):
        for t in range(len(places)):
            k = places[t, 0]
            touch, inverse_variance = touching[b, k], data[t].information
            normal = touch.normal
            told = (1.0 - shared[_SCALE, b]) * data[t].angle
            off = -normal * rotation(shared[_BIAS, b] - told - g[b, k, 2])
            residual[b, t, 0] = math.atan2(off.imag, off.real)
            # The spline's gradient has length 1 but near the medial axis; where it vanishes there is no direction.
            square = max(normal.real**2 + normal.imag**2, _NO_GRADIENT)
            for k in range(3):
                jacobian[b, t, 0, k] = cross(normal, touch.normal_by_g[k]) / square
            jacobian[b, t, 0, 2] -= 1.0  # the direction stays while the sensor turns
            jacobian[b, t, 0, 3], jacobian[b, t, 0, 4] = 1.0, data[t].angle
            information[b, t, 0] = inverse_variance
            weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * residual[b, t, 0] ** 2, kernel)


def true_angle(said: ContactDirection, prior: Prior) -> float:
    """Return the angle [rad] that is meant by what touch says, by what is believed of bias and scale."""
    return (1.0 - float(prior[DIRECTION_SCALE][0])) * said.angle - float(prior[DIRECTION_BIAS][0])


class Direction(OneTermEach):
    """One term for each contact direction that touch tells."""

    name = "direction"
    steps = ((SENSOR_IN_OBJECT,),)
    shared = (DIRECTION_BIAS, DIRECTION_SCALE)
    measurement, value = ContactDirection, "angle"
    data = DATA
    kernel = _linearise
