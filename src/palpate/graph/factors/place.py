"""Contact place: touch tells where along y a flat pad is touched.

The true place is that of the sensor's material point, the mean over the pad's parts by how much each bears, so the
residual [m] is `y of material + bias - place`. On a flat pad a round outline is touched with its normal along x
wherever it lies: what a contact direction tells on a round tip, this tells there.
"""

import numpy as np

from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.one_term_each import OneTermEach
from palpate.graph.se2_kernels import cauchy
from palpate.graph.values import State
from palpate.graph.variables import IN_SHARED, PLACE_BIAS, SENSOR_IN_OBJECT
from palpate.types.measurements import ContactPlace

DATA = np.dtype([("place", np.float64), ("information", np.float64)])


_BIAS = IN_SHARED[PLACE_BIAS].start


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
            touch, inverse_variance = touching[b, places[t, 0]], data[t].information
            residual[b, t, 0] = touch.material.imag + shared[_BIAS, b] - data[t].place
            for k in range(3):
                jacobian[b, t, 0, k] = touch.material_by_g[k].imag
            jacobian[b, t, 0, 3] = 1.0
            information[b, t, 0] = inverse_variance
            weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * residual[b, t, 0] ** 2, kernel)


class Place(OneTermEach):
    """One term for each contact place that touch tells."""

    name = "place"
    steps = ((SENSOR_IN_OBJECT,),)
    shared = (PLACE_BIAS,)
    measurement, value = ContactPlace, "place"
    data = DATA
    kernel = _linearise
