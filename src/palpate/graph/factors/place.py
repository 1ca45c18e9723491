"""Contact place: touch measures the position along y at which a flat pad is touched.

The true place is that of the sensor's material point, the load-weighted mean over the pad's parts, so the residual [m]
is `y of material + bias - place`. On a flat pad a round outline always has its normal along x; the place is to a flat
pad what the contact direction is to a round tip.
"""

from palpate.graph.compiled import Integers, Records, compiled
from palpate.graph.factors.factor import Linear
from palpate.graph.factors.touch_measurement import TouchMeasurement
from palpate.graph.se2_kernels import cauchy
from palpate.graph.values import State
from palpate.graph.variables import IN_SHARED, PLACE_BIAS, SENSOR_IN_OBJECT
from palpate.types.measurements import ContactPlace

_BIAS = IN_SHARED[PLACE_BIAS].start


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple[float], out: Linear) -> None:
    (kernel,) = given
    for b in range(len(state.sign)):
        for t in range(len(step)):
            touch, inverse_variance = state.contact[b, step[t]], data[t].information
            place = state.sign[b] * data[t].value if data[t].from_touch else data[t].value
            error = touch.material.imag + state.shared[b, _BIAS] - place
            for c in range(3):
                out.jacobian[b, t, 0, c] = touch.material_by_g[c].imag
            out.jacobian[b, t, 0, 3] = 1.0
            out.residual[b, t, 0] = error
            out.information[b, t, 0] = inverse_variance
            out.weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * error**2, kernel)


class Place(TouchMeasurement):
    """One term for each contact place."""

    name = "place"
    on = (SENSOR_IN_OBJECT,)
    shared = (PLACE_BIAS,)
    measurement, field = ContactPlace, "place"
    kernel = _linearise
