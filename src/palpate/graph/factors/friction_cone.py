"""Friction cone: at its edge the pushing force stays while the contact slides (Coulomb; Lynch 1992).

The force points along the motion v of the centre of friction. The residual [m] is how far v is outside the cone on one
side (+1 counter-clockwise of the outline's inward normal, -1 clockwise): its part along the outline less grip times its
part into the object. The term counts where the force is beyond the edge, and not where it is inside.
"""

import math

import numpy as np

from palpate.config import FrictionConeSettings
from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.factor import Factor, Step, Terms, kernel_scale
from palpate.graph.factors.pushing import (
    DATA,
    beyond,
    center_moved,
    center_of_friction,
    pushing_terms,
    put_center_derivatives,
)
from palpate.graph.se2_kernels import cauchy, dot
from palpate.graph.values import SPREAD, State
from palpate.graph.variables import FRICTION_CENTER, GRIP, IN_SHARED, SENSOR, SENSOR_IN_OBJECT

_CENTER, _GRIP = IN_SHARED[FRICTION_CENTER].start, IN_SHARED[GRIP].start


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
    g, e, shared, touching, angle, c, model_center, knocks = state
    still, share, width, kernel = given
    by_sensor0, by_sensor1 = np.empty(3, np.complex128), np.empty(3, np.complex128)
    for b in range(len(g)):
        grip = shared[_GRIP, b]
        center = center_of_friction(model_center, c, shared[_CENTER, b], shared[_CENTER + 1, b])
        for t in range(len(places)):
            before, now = places[t, 0], places[t, 1]
            g0, e0, g1, e1 = g[b, before], e[b, before], g[b, now], e[b, now]
            touch, row = touching[b, now], jacobian[b, t, 0]
            force = angle[b, now]
            side = 1.0 if force > 0.0 else -1.0 if force < 0.0 else 0.0
            way, by_center = center_moved(g0, e0, g1, e1, center, by_sensor0, by_sensor1)
            edge = side - 1j * grip
            lever = edge * -touch.normal.conjugate()
            residual[b, t, 0] = (lever * way).imag
            put_center_derivatives(lever, by_sensor0, by_sensor1, row)
            for k in range(3):
                row[6 + k] += (edge * way * -touch.normal_by_g[k].conjugate()).imag
            row[12] = c * (lever * by_center).imag
            row[13] = c * (lever * by_center).real
            row[14] = dot(touch.normal, way)
            outside = beyond(force, math.atan(grip), width) if knocks[b, now, SPREAD] == 0.0 else 0.0
            inverse_variance = outside * math.hypot(still, share * data[t].moved) ** -2.0
            information[b, t, 0] = inverse_variance
            weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * residual[b, t, 0] ** 2, kernel)


class FrictionCone(Factor):
    """One term a step, on the step and the one before."""

    name = "friction_cone"
    steps = ((SENSOR_IN_OBJECT, SENSOR), (SENSOR_IN_OBJECT, SENSOR))
    shared = (FRICTION_CENTER, GRIP)
    rows = 1
    data = DATA
    kernel = _linearise
    is_motion = True
    is_of_pushing = True

    def __init__(self, settings: FrictionConeSettings) -> None:
        self.given = settings.still, settings.share or 0.0, settings.width, kernel_scale(settings.kernel)
        self._counts = settings.share is not None

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return pushing_terms(step) if self._counts else None
