"""Contact: the tip's round surface is on the outline, up to a depth by which it overlaps (paper Eq. 11, two-sided).

The residual is `gap + depth` [m]: positive where tip and outline are further apart than the depth says, negative where
they overlap more. The gap is the outline's signed distance at the tip's centre of curvature less the tip's radius.
"""

from dataclasses import dataclass

import numpy as np

from palpate.compiled import Array, Given, Places, Records, compiled
from palpate.estimation.contact_model import ContactModel
from palpate.estimation.factors.factor import Factor, Step, Terms, kernel_scale, terms_now
from palpate.estimation.planar import cauchy
from palpate.estimation.setting import Settings, Tunable, setting
from palpate.estimation.unknowns import DEPTH, IN_SHARED, SENSOR_IN_OBJECT
from palpate.estimation.values import State

DATA = np.dtype([("tip", np.int64)])


@dataclass(frozen=True)
class ContactSettings(Settings):
    """How well outline, gel and motion capture agree."""

    deviation: float = setting(1e-3, tune=Tunable(1e-5, 1e-2, usual=False))
    """Distance between sensor and outline in contact [m]."""
    kernel: float | None = setting(3.0, optional=True, tune=Tunable(0.1, 100.0, usual=False))
    """Scale of the Cauchy kernel [standard deviations]; None is a plain square."""


_DEPTH = IN_SHARED[DEPTH].start


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
    inverse_variance, kernel = given
    for b in range(len(g)):
        for t in range(len(places)):
            touch = touching[b, places[t, 0], data[t].tip]
            residual[b, t, 0] = touch.gap + shared[_DEPTH, b]
            jacobian[b, t, 0, :3] = touch.gap_by_g
            jacobian[b, t, 0, 3] = 1.0
            information[b, t, 0] = inverse_variance
            weight[b, t, 0] = inverse_variance * cauchy(inverse_variance * residual[b, t, 0] ** 2, kernel)


class Contact(Factor):
    """One term a step and tip: they touch."""

    name = "contact"
    steps = ((SENSOR_IN_OBJECT,),)
    shared = (DEPTH,)
    rows = 1
    data = DATA
    kernel = _linearise

    def __init__(self, settings: ContactSettings, model: ContactModel) -> None:
        self.given = settings.deviation**-2.0, kernel_scale(settings.kernel)
        self._tips = [(tip,) for tip in range(model.tips)]

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return terms_now(self._tips, DATA)
