"""Contact direction: touch measures the direction in which a round tip is touched.

The true direction points from the tip's centre to the nearest outline point, opposite to the outward normal n there,
seen in the sensor frame. The residual [rad] is the angle of `-n exp(i (bias - theta - (1 - scale) angle))`, in
(-pi, pi]. It is absolute and does not drift: it determines yaw on a straight edge, and the place on a round one.
"""

import math

from palpate.graph.belief import Belief
from palpate.graph.compiled import Array, Integers, Records, compiled
from palpate.graph.factors.factor import Linear
from palpate.graph.factors.touch_measurement import TouchMeasurement
from palpate.graph.se2_kernels import cauchy, cross, rotation
from palpate.graph.values import State
from palpate.graph.variables import DIRECTION_BIAS, DIRECTION_SCALE, IN_SHARED, SENSOR_IN_OBJECT
from palpate.types.measurements import ContactDirection

_NO_GRADIENT = 1e-12  # squared length of a gradient without direction
_BIAS, _SCALE = IN_SHARED[DIRECTION_BIAS].start, IN_SHARED[DIRECTION_SCALE].start


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple[float], out: Linear) -> None:
    (kernel,) = given
    for b in range(len(state.sign)):
        for t in range(len(step)):
            k = step[t]
            touch, inverse_variance = state.contact[b, k], data[t].information
            angle = state.sign[b] * data[t].value if data[t].from_touch else data[t].value
            normal, row = touch.normal, out.jacobian[b, t, 0]
            scaled = (1.0 - state.shared[b, _SCALE]) * angle
            off = -normal * rotation(state.shared[b, _BIAS] - scaled - state.sensor_in_object[b, k, 2])
            error = math.atan2(off.imag, off.real)
            # The spline's gradient has length 1 except near the medial axis, where it may vanish.
            square = max(normal.real**2 + normal.imag**2, _NO_GRADIENT)
            for c in range(3):
                row[c] = cross(normal, touch.normal_by_g[c]) / square
            row[2] -= 1.0  # the direction stays while the sensor turns
            row[3], row[4] = 1.0, angle
            out.residual[b, t, 0] = error
            out.information[b, t, 0] = inverse_variance
            out.weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * error**2, kernel)


def true_angle(measured: ContactDirection, belief: Belief, sign: Array) -> Array:
    """Return the true angle (B,) [rad] of a measured direction, given the believed bias and scale.

    `sign` (B,) is -1 where touch images are taken as mirrored.
    """
    return (1.0 - belief[DIRECTION_SCALE][:, 0]) * (sign * measured.angle) - belief[DIRECTION_BIAS][:, 0]


class Direction(TouchMeasurement):
    """One term for each contact direction."""

    name = "direction"
    on = (SENSOR_IN_OBJECT,)
    shared = (DIRECTION_BIAS, DIRECTION_SCALE)
    measurement = ContactDirection
    kernel = _linearise
