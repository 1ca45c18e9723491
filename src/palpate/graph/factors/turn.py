"""Turn: touch tells the sensor's yaw in the object frame, up to an offset that a contact has for itself.

The residual is `theta - offset - angle`, wrapped to (-pi, pi], with theta the yaw of g.
"""

import numpy as np

from palpate.geometry import se2
from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.factor import Terms
from palpate.graph.factors.one_term_each import OneTermEach
from palpate.graph.se2_kernels import cauchy, wrap
from palpate.graph.values import State, Values
from palpate.graph.variables import IN_SHARED, SENSOR_IN_OBJECT, TURN_OFFSET, Unknown
from palpate.types.measurements import Turn as TurnMeasurement

DATA = np.dtype([("angle", np.float64), ("information", np.float64)])


_OFFSET = IN_SHARED[TURN_OFFSET].start


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
    g, _e, shared, _touching, _angle, _c, _model_center, _knocks = state
    (kernel,) = given
    for b in range(len(g)):
        for t in range(len(places)):
            inverse_variance = data[t].information
            residual[b, t, 0] = wrap(g[b, places[t, 0], 2] - shared[_OFFSET, b] - data[t].angle)
            jacobian[b, t, 0, 2], jacobian[b, t, 0, 3] = 1.0, -1.0
            information[b, t, 0] = inverse_variance
            weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * residual[b, t, 0] ** 2, kernel)


class Turn(OneTermEach):
    """One term for each turn that touch tells."""

    name = "turn"
    steps = ((SENSOR_IN_OBJECT,),)
    shared = (TURN_OFFSET,)
    measurement, value = TurnMeasurement, "angle"
    data = DATA
    kernel = _linearise
    reads_outline = False

    def first_guess(self, at: Values, terms: Terms) -> dict[Unknown, Array]:
        """See Factor. Under its kernel a turn far off the offset would hardly pull."""
        yaw = at[SENSOR_IN_OBJECT][:, terms.places[0, 0], 2]
        return {TURN_OFFSET: se2.wrap(yaw - terms.data["angle"][0])[None]}
