"""Sticking: inside the friction cone the sensor's material point stays on the object (paper Eqs. 7 to 10, two rows).

The residual [m] is the sliding of the object along the sensor, in the object frame. The sensor's material point m that
touches the outline point p at step 1 was at `g0 g1^-1 p` at step 0, so the residual is `g0 m - p`. Rolling by a small
angle keeps the point in place up to r angle^2 / 2. This is the paper's `V + omega x p - Vp` without linearising the
rotation, which would let the object drift by omega^2 p / 2 a step.

The standard deviation depends on the angle of the pushing force: inside the cone a step slides by a small share of the
sensor's motion, at the cone's edge by any amount. In a step with a disturbance the object slides along the outline by
the disturbance's mean, within its deviation.
"""

import math

from palpate.config import StickingSettings
from palpate.graph.compiled import Array, Integers, Records, compiled
from palpate.graph.factors.factor import Factor, Linear, Step, Terms, kernel_scale
from palpate.graph.factors.pushing import DATA, beyond, pushing_terms
from palpate.graph.se2_kernels import cauchy, position, rotation
from palpate.graph.values import SLIDE, SPREAD, State
from palpate.graph.variables import GRIP, IN_SHARED, SENSOR_IN_OBJECT

_GRIP = IN_SHARED[GRIP].start
_ACROSS = 2e-3  # [m] motion of a disturbed object across the outline in a step


@compiled
def _rotate_to_outline(slid: complex, touch: Records, mean: float, residual: Array, jacobian: Array) -> None:
    """Replace rows along x and y of the object by one along the outline, minus its mean, and one across it."""
    along = slid * (1j * touch.normal).conjugate()
    residual[0], residual[1] = along.real - mean, along.imag
    for k in range(6):
        by = complex(jacobian[0, k], jacobian[1, k]) * (1j * touch.normal).conjugate()
        if k >= 3:
            by += slid * (1j * touch.normal_by_g[k - 3]).conjugate()
        jacobian[0, k], jacobian[1, k] = by.real, by.imag


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple, out: Linear) -> None:
    still, share, sliding_share, margin, width, kernel = given
    for b in range(len(state.sign)):
        edge = math.atan(state.shared[b, _GRIP])
        for t in range(len(step)):
            now, moved = step[t], data[t].moved
            g0, touch = state.sensor_in_object[b, now - 1], state.contact[b, now]
            residual, jacobian = out.residual[b, t], out.jacobian[b, t]
            turn0, material = rotation(g0[2]), touch.material
            slid = position(g0) + turn0 * material - touch.point
            residual[0], residual[1] = slid.real, slid.imag
            by_turn = 1j * turn0 * material
            jacobian[0, 0], jacobian[1, 0] = turn0.real, turn0.imag
            jacobian[0, 1], jacobian[1, 1] = -turn0.imag, turn0.real
            jacobian[0, 2], jacobian[1, 2] = by_turn.real, by_turn.imag
            for c in range(3):
                by_g1 = turn0 * touch.material_by_g[c] - touch.point_by_g[c]
                jacobian[0, 3 + c], jacobian[1, 3 + c] = by_g1.real, by_g1.imag
            spread = state.disturbance[b, now, SPREAD]
            if spread > 0.0:
                _rotate_to_outline(slid, touch, state.disturbance[b, now, SLIDE], residual, jacobian)
                out.information[b, t, 0] = out.weight[b, t, 0] = spread**-2.0
                out.information[b, t, 1] = out.weight[b, t, 1] = _ACROSS**-2.0
                continue
            deviation = math.hypot(still, share * moved)
            slides = beyond(state.force_angle[b, now], edge - margin, width)
            deviation *= (math.hypot(still, sliding_share * moved) / deviation) ** slides
            inverse_variance = deviation**-2.0
            square = inverse_variance * (slid.real**2 + slid.imag**2)
            for r in range(2):
                out.information[b, t, r] = inverse_variance
                out.weight[b, t, r] = inverse_variance * cauchy(square, kernel)


class Sticking(Factor):
    """One term a step, on the step and the one before."""

    name = "sticking"
    on = (SENSOR_IN_OBJECT,)
    spans = 2
    rows = 2
    data = DATA
    kernel = _linearise
    is_of_pushing = True
    is_consistency_test = True

    def __init__(self, settings: StickingSettings) -> None:
        shares = settings.still, settings.share, settings.sliding_share
        self.given = *shares, settings.margin, settings.width, kernel_scale(settings.kernel)

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return pushing_terms(step)
