"""Contact place: touch tells where along y a flat pad is touched.

The true place is that of the sensor's material point, the mean over the pad's parts by how much each bears, so the
residual [m] is `y of material + bias - place`. On a flat pad a round outline is touched with its normal along x
wherever it lies: what a contact direction tells on a round tip, this tells there.
"""

from dataclasses import dataclass

import numpy as np

from palpate.config.tunable import Settings, Tunable, setting
from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.one_term_each import OneTermEach
from palpate.graph.se2_kernels import cauchy
from palpate.graph.values import State
from palpate.graph.variables import IN_SHARED, PLACE_BIAS, SENSOR_IN_OBJECT
from palpate.types.measurements import ContactPlace

DATA = np.dtype([("place", np.float64), ("information", np.float64)])


@dataclass(frozen=True)
class PlaceSettings(Settings):
    """How far touch is to be believed about the contact place."""

    share: float = setting(2.0, tune=Tunable(1e-2, 100.0, usual=False))
    """Variance of a place as a share of what touch says."""
    kernel: float | None = setting(3.0, optional=True, tune=Tunable(0.1, 100.0, usual=False))
    """Scale of the Cauchy kernel [standard deviations]; None is a plain square."""


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
