"""Balance of force and torque on the ellipsoidal limit surface (paper Eq. 7, torque row; Lynch 1992, Zhou 2017).

The residual [m^2] is `p x v - c^2 omega`, with the object's motion v [m], omega [rad] over the step and the pushed
point p both taken at the centre of friction. Sliding does not break it. c^2 is that of the chosen pressure times
`exp(friction_ratio)`.

In a step in which something else moves the object only its turn is held back, `-c^2 omega` with the model's c: a hand
turns it by some tenths of a radian while it slides by a centimetre. Without touch that tells directions nothing else
would.
"""

import math

import numpy as np

from palpate.config import BalanceSettings
from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.factor import Factor, Step, Terms, kernel_scale
from palpate.graph.factors.pushing import (
    DATA,
    center_moved,
    center_of_friction,
    pushing_terms,
    put_center_derivatives,
)
from palpate.graph.se2_kernels import cauchy, cross, wrap
from palpate.graph.values import SPREAD, State
from palpate.graph.variables import FRICTION_CENTER, FRICTION_RATIO, IN_SHARED, SENSOR, SENSOR_IN_OBJECT

_TURNED = 3.0  # times as far as a knocked object slides goes what is at the distance c from its centre
_RATIO, _CENTER = IN_SHARED[FRICTION_RATIO].start, IN_SHARED[FRICTION_CENTER].start


@compiled
def _deviation(moved: float, c: float, still: float, share: float, off: float) -> float:
    return math.hypot(math.hypot(still, share * moved * c), off * moved)


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
    g, e, shared, touching, _angle, c, model_center, knocks = state
    still, share, off, kernel = given
    by_sensor0, by_sensor1 = np.empty(3, np.complex128), np.empty(3, np.complex128)
    for b in range(len(g)):
        c_squared = c * c * math.exp(shared[_RATIO, b])
        center = center_of_friction(model_center, c, shared[_CENTER, b], shared[_CENTER + 1, b])
        for t in range(len(places)):
            before, now = places[t, 0], places[t, 1]
            g0, e0, g1, e1 = g[b, before], e[b, before], g[b, now], e[b, now]
            touch, row = touching[b, now], jacobian[b, t, 0]
            way, by_center = center_moved(g0, e0, g1, e1, center, by_sensor0, by_sensor1)
            arm = touch.point - center
            omega = wrap(e1[2] - e0[2] - g1[2] + g0[2])
            spread = knocks[b, now, SPREAD]
            if spread > 0.0:
                deviation, held_back, row[:] = _TURNED * c * spread, c * c, 0.0
                residual[b, t, 0] = -held_back * omega
            else:
                deviation, held_back = _deviation(data[t].moved, c, still, share, off), c_squared
                lever = arm.conjugate()
                residual[b, t, 0] = cross(arm, way) - held_back * omega
                put_center_derivatives(lever, by_sensor0, by_sensor1, row)
                for k in range(3):
                    row[6 + k] += cross(touch.point_by_g[k], way)
                row[12] = -c_squared * omega
                row[13] = c * ((lever * by_center).imag - way.imag)
                row[14] = c * ((lever * by_center).real + way.real)
            row[2] -= held_back  # omega grows with the turns of g0 and e1,
            row[11] -= held_back
            row[5] += held_back  # and shrinks with those of e0 and g1
            row[8] += held_back
            inverse_variance = deviation**-2.0
            information[b, t, 0] = inverse_variance
            weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * residual[b, t, 0] ** 2, kernel)


class Balance(Factor):
    """One term a step, on the step and the one before."""

    name = "balance"
    steps = ((SENSOR_IN_OBJECT, SENSOR), (SENSOR_IN_OBJECT, SENSOR))
    shared = (FRICTION_RATIO, FRICTION_CENTER)
    rows = 1
    data = DATA
    kernel = _linearise
    is_motion = True
    is_of_pushing = True
    tells_strain = True

    def __init__(self, settings: BalanceSettings, model: ContactModel) -> None:
        self._sizes = settings.still, settings.share, settings.load * model.span
        self._c = model.friction_radius
        self.given = *self._sizes, kernel_scale(settings.kernel)

    def deviation(self, moved: float) -> float:
        """Return the standard deviation of the imbalance in a step in which the sensor moves so far [m] [m^2]."""
        return _deviation(moved, self._c, *self._sizes)

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return pushing_terms(step)
