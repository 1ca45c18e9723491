"""Turn: touch measures the sensor's yaw in the object frame, up to an offset that is constant within a contact.

The residual [rad] is `theta - offset - angle`, wrapped to (-pi, pi], with theta the yaw of g.
"""

from palpate.geometry import se2
from palpate.graph.compiled import Array, Integers, Records, compiled
from palpate.graph.factors.factor import Linear, Terms
from palpate.graph.factors.touch_measurement import TouchMeasurement
from palpate.graph.se2_kernels import cauchy, wrap
from palpate.graph.values import State, Values
from palpate.graph.variables import IN_SHARED, SENSOR_IN_OBJECT, TURN_OFFSET, Variable
from palpate.types.measurements import Turn as TurnMeasurement

_OFFSET = IN_SHARED[TURN_OFFSET].start


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple[float], out: Linear) -> None:
    (kernel,) = given
    for b in range(len(state.sign)):
        for t in range(len(step)):
            inverse_variance = data[t].information
            angle = state.sign[b] * data[t].value if data[t].from_touch else data[t].value
            error = wrap(state.sensor_in_object[b, step[t], 2] - state.shared[b, _OFFSET] - angle)
            out.jacobian[b, t, 0, 2], out.jacobian[b, t, 0, 3] = 1.0, -1.0
            out.residual[b, t, 0] = error
            out.information[b, t, 0] = inverse_variance
            out.weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * error**2, kernel)


class Turn(TouchMeasurement):
    """One term for each turn."""

    name = "turn"
    on = (SENSOR_IN_OBJECT,)
    shared = (TURN_OFFSET,)
    measurement = TurnMeasurement
    kernel = _linearise

    def first_guess(self, at: Values, terms: Terms) -> dict[Variable, Array]:
        """See Factor. Far from the true offset, the robust kernel would leave a turn hardly any weight."""
        first = terms.data[0]
        angle = first["value"] * (at.sign if first["from_touch"] else 1.0)
        return {TURN_OFFSET: se2.wrap(at.sensor_in_object[:, terms.step[0], 2] - angle)[:, None]}
