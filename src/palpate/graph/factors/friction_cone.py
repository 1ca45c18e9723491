"""Friction cone: while the contact slides, the pushing force stays at the cone's edge (Coulomb; Lynch 1992).

The force points along the motion v of the centre of friction. The residual [m] is the distance of v outside the cone,
on its side (+1 counter-clockwise of the outline's inward normal, -1 clockwise): the part of v along the outline minus
grip times its part into the object. The term counts only while the force is beyond the edge, and not in a step with a
disturbance.
"""

import math

import numpy as np

from palpate.config import FrictionConeSettings
from palpate.graph.compiled import Integers, Records, compiled
from palpate.graph.factors.factor import Factor, Linear, Step, Terms, kernel_scale
from palpate.graph.factors.pushing import (
    DATA,
    beyond,
    center_moved,
    center_of_friction,
    pushing_terms,
    write_center_derivatives,
)
from palpate.graph.se2_kernels import cauchy, dot
from palpate.graph.values import SPREAD, State
from palpate.graph.variables import FRICTION_CENTER, GRIP, IN_SHARED, SENSOR, SENSOR_IN_OBJECT

_CENTER, _GRIP = IN_SHARED[FRICTION_CENTER].start, IN_SHARED[GRIP].start


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple, out: Linear) -> None:
    still, share, width, kernel = given
    g, e, c = state.sensor_in_object, state.sensor, state.friction_radius
    by_sensor0, by_sensor1 = np.empty(3, np.complex128), np.empty(3, np.complex128)
    for b in range(len(state.sign)):
        shared = state.shared[b]
        grip = shared[_GRIP]
        center = center_of_friction(state.centroid, c, shared[_CENTER], shared[_CENTER + 1])
        for t in range(len(step)):
            now = step[t]
            g0, e0, g1, e1 = g[b, now - 1], e[b, now - 1], g[b, now], e[b, now]
            touch, row = state.contact[b, now], out.jacobian[b, t, 0]
            force = state.force_angle[b, now]
            side = 1.0 if force > 0.0 else -1.0 if force < 0.0 else 0.0
            way, by_center = center_moved(g0, e0, g1, e1, center, by_sensor0, by_sensor1)
            edge = side - 1j * grip
            lever = edge * -touch.normal.conjugate()
            error = (lever * way).imag
            write_center_derivatives(lever, by_sensor0, by_sensor1, row)
            for k in range(3):
                row[6 + k] += (edge * way * -touch.normal_by_g[k].conjugate()).imag
            row[12] = c * (lever * by_center).imag
            row[13] = c * (lever * by_center).real
            row[14] = dot(touch.normal, way)
            outside = beyond(force, math.atan(grip), width) if state.disturbance[b, now, SPREAD] == 0.0 else 0.0
            inverse_variance = outside * math.hypot(still, share * data[t].moved) ** -2.0
            out.residual[b, t, 0] = error
            out.information[b, t, 0] = inverse_variance
            out.weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * error**2, kernel)


class FrictionCone(Factor):
    """One term a step, on the step and the one before."""

    name = "friction_cone"
    on = (SENSOR_IN_OBJECT, SENSOR)
    spans = 2
    shared = (FRICTION_CENTER, GRIP)
    rows = 1
    data = DATA
    kernel = _linearise
    is_of_pushing = True

    def __init__(self, settings: FrictionConeSettings) -> None:
        self.given = settings.still, settings.share or 0.0, settings.width, kernel_scale(settings.kernel)
        self._counts = settings.share is not None

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return pushing_terms(step) if self._counts else None
