"""Sticking: inside the friction cone the sensor's material point stays on the object (paper Eqs. 7 to 10, two rows).

The residual [m] is how far the object slid along the sensor, object frame: the sensor's material point m that touches
the outline point p at step 1 was at `g0 g1^-1 p` at step 0, so it is `g0 m - p`. Rolling by a small angle leaves it in
place too, up to r angle^2 / 2. This is the paper's `V + omega x p - Vp` without linearising the rotation, which would
let the object drift by omega^2 p / 2 a step. With r > 0 it is the material point that pushes, while p moves over the
tip as the sensor turns.

How firmly it holds depends on the angle of the pushing force: inside the cone a step slides by a small share of the
sensor's motion, at the cone's edge by any amount.
"""

import math

from palpate.config import StickingSettings
from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.factor import Factor, Step, Terms, kernel_scale
from palpate.graph.factors.pushing import DATA, beyond, pushing_terms
from palpate.graph.se2_kernels import cauchy, position, rotation
from palpate.graph.values import SLID, SPREAD, State
from palpate.graph.variables import GRIP, IN_SHARED, SENSOR_IN_OBJECT

_GRIP = IN_SHARED[GRIP].start
_ACROSS = 2e-3  # [m] by which a knocked object comes off the sensor or into it in a step


@compiled
def _put_knocked(slid: complex, touch: Records, mean: float, residual: Array, jacobian: Array) -> None:
    """Turn rows along x and y of the object into one along the outline, less what is expected, and one across it."""
    along = slid * (1j * touch.normal).conjugate()
    residual[0], residual[1] = along.real - mean, along.imag
    for k in range(6):
        by = complex(jacobian[0, k], jacobian[1, k]) * (1j * touch.normal).conjugate()
        if k >= 3:
            by += slid * (1j * touch.normal_by_g[k - 3]).conjugate()
        jacobian[0, k], jacobian[1, k] = by.real, by.imag


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
    g, _e, shared, touching, angle, _c, _model_center, knocks = state
    still, share, sliding_share, margin, width, kernel = given
    for b in range(len(g)):
        edge = math.atan(shared[_GRIP, b])
        for t in range(len(places)):
            now, moved = places[t, 1], data[t].moved
            g0, touch = g[b, places[t, 0]], touching[b, now]
            turn0, material = rotation(g0[2]), touch.material
            slid = position(g0) + turn0 * material - touch.point
            residual[b, t, 0], residual[b, t, 1] = slid.real, slid.imag
            by_turn = 1j * turn0 * material
            jacobian[b, t, 0, 0], jacobian[b, t, 1, 0] = turn0.real, turn0.imag
            jacobian[b, t, 0, 1], jacobian[b, t, 1, 1] = -turn0.imag, turn0.real
            jacobian[b, t, 0, 2], jacobian[b, t, 1, 2] = by_turn.real, by_turn.imag
            for k in range(3):
                by_g1 = turn0 * touch.material_by_g[k] - touch.point_by_g[k]
                jacobian[b, t, 0, 3 + k], jacobian[b, t, 1, 3 + k] = by_g1.real, by_g1.imag
            if knocks[b, now, SPREAD] > 0.0:
                _put_knocked(slid, touch, knocks[b, now, SLID], residual[b, t], jacobian[b, t])
                information[b, t, 0] = weight[b, t, 0] = knocks[b, now, SPREAD] ** -2.0
                information[b, t, 1] = weight[b, t, 1] = _ACROSS**-2.0
                continue
            deviation = math.hypot(still, share * moved)
            slides = beyond(angle[b, now], edge - margin, width)
            deviation *= (math.hypot(still, sliding_share * moved) / deviation) ** slides
            inverse_variance = deviation**-2.0
            square = inverse_variance * (slid.real**2 + slid.imag**2)
            for r in range(2):
                information[b, t, r] = inverse_variance
                weight[b, t, r] = inverse_variance * cauchy(square, kernel)


class Sticking(Factor):
    """One term a step, on the step and the one before."""

    name = "sticking"
    steps = ((SENSOR_IN_OBJECT,), (SENSOR_IN_OBJECT,))
    rows = 2
    data = DATA
    kernel = _linearise
    is_motion = True
    is_of_pushing = True
    tells_strain = True

    def __init__(self, settings: StickingSettings) -> None:
        shares = settings.still, settings.share, settings.sliding_share
        self.given = *shares, settings.margin, settings.width, kernel_scale(settings.kernel)

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return pushing_terms(step)
