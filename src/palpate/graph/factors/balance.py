"""Balance of force and torque on the ellipsoidal limit surface (paper Eq. 7, torque row; Lynch 1992, Zhou 2017).

The residual [m^2] is `p x v - c^2 omega`, with the object's motion v [m], omega [rad] in the step and the pushed point
p, both relative to the centre of friction. It holds while sliding, too. c^2 is that of the assumed pressure
distribution times `exp(friction_ratio)`.

In a step with a disturbance only the object's turn is limited, by the residual `-c^2 omega` with the nominal c: a hand
turns an object by some tenths of a radian while sliding it by a centimetre.
"""

import math

import numpy as np

from palpate.config import BalanceSettings
from palpate.graph.compiled import Integers, Records, compiled
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.factor import Factor, Linear, Step, Terms, kernel_scale
from palpate.graph.factors.pushing import (
    DATA,
    center_moved,
    center_of_friction,
    pushing_terms,
    write_center_derivatives,
)
from palpate.graph.se2_kernels import cauchy, cross, wrap
from palpate.graph.values import SPREAD, State
from palpate.graph.variables import FRICTION_CENTER, FRICTION_RATIO, IN_SHARED, SENSOR, SENSOR_IN_OBJECT

_TURNED = 3.0  # ratio of c times the turn of a disturbed object to its slide
_RATIO, _CENTER = IN_SHARED[FRICTION_RATIO].start, IN_SHARED[FRICTION_CENTER].start


@compiled
def _deviation(moved: float, c: float, still: float, share: float, load: float) -> float:
    return math.hypot(math.hypot(still, share * moved * c), load * moved)


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple, out: Linear) -> None:
    still, share, load, kernel = given
    g, e, c = state.sensor_in_object, state.sensor, state.friction_radius
    by_sensor0, by_sensor1 = np.empty(3, np.complex128), np.empty(3, np.complex128)
    for b in range(len(state.sign)):
        shared = state.shared[b]
        c_squared = c * c * math.exp(shared[_RATIO])
        center = center_of_friction(state.centroid, c, shared[_CENTER], shared[_CENTER + 1])
        for t in range(len(step)):
            now = step[t]
            g0, e0, g1, e1 = g[b, now - 1], e[b, now - 1], g[b, now], e[b, now]
            touch, row = state.contact[b, now], out.jacobian[b, t, 0]
            way, by_center = center_moved(g0, e0, g1, e1, center, by_sensor0, by_sensor1)
            arm = touch.point - center
            omega = wrap(e1[2] - e0[2] - g1[2] + g0[2])
            spread = state.disturbance[b, now, SPREAD]
            if spread > 0.0:
                deviation, torque, row[:] = _TURNED * c * spread, c * c, 0.0
                error = -torque * omega
            else:
                deviation, torque = _deviation(data[t].moved, c, still, share, load), c_squared
                lever = arm.conjugate()
                error = cross(arm, way) - torque * omega
                write_center_derivatives(lever, by_sensor0, by_sensor1, row)
                for k in range(3):
                    row[6 + k] += cross(touch.point_by_g[k], way)
                row[12] = -c_squared * omega
                row[13] = c * ((lever * by_center).imag - way.imag)
                row[14] = c * ((lever * by_center).real + way.real)
            row[2] -= torque  # omega grows with the turns of g0 and e1,
            row[11] -= torque
            row[5] += torque  # and shrinks with those of e0 and g1
            row[8] += torque
            inverse_variance = deviation**-2.0
            out.residual[b, t, 0] = error
            out.information[b, t, 0] = inverse_variance
            out.weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * error**2, kernel)


class Balance(Factor):
    """One term a step, on the step and the one before."""

    name = "balance"
    on = (SENSOR_IN_OBJECT, SENSOR)
    spans = 2
    shared = (FRICTION_RATIO, FRICTION_CENTER)
    rows = 1
    data = DATA
    kernel = _linearise
    is_of_pushing = True
    is_consistency_test = True

    def __init__(self, settings: BalanceSettings, model: ContactModel) -> None:
        self._sizes = settings.still, settings.share, settings.load * model.span
        self._c = model.friction_radius
        self.given = *self._sizes, kernel_scale(settings.kernel)

    def deviation(self, moved: float) -> float:
        """Return the standard deviation [m^2] of the imbalance in a step in which the sensor moves by `moved` [m]."""
        return _deviation(moved, self._c, *self._sizes)

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return pushing_terms(step)
