"""The measured pose of the sensor: `Log(measured^-1 e)` (paper Eq. 12)."""

import numpy as np

from palpate.config import SensorPoseSettings
from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.factor import Factor, Step, Terms, terms_now
from palpate.graph.se2_kernels import between, log, log_by_pose
from palpate.graph.values import State
from palpate.graph.variables import SENSOR

DATA = np.dtype([("pose", np.float64, (3,))])


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
    _g, e, _shared, _touching, _angle, _c, _model_center, _knocks = state
    apart = np.empty(3)
    for b in range(len(e)):
        for t in range(len(places)):
            between(data[t].pose, e[b, places[t, 0]], apart)
            log(apart, residual[b, t])
            log_by_pose(residual[b, t], jacobian[b, t])
            for r in range(3):
                information[b, t, r] = weight[b, t, r] = given[r]


class SensorPose(Factor):
    """One term a step: the sensor is where it was measured to be."""

    name = "sensor_pose"
    steps = ((SENSOR,),)
    rows = 3
    data = DATA
    kernel = _linearise
    reads_outline = False
    is_motion = True

    def __init__(self, settings: SensorPoseSettings) -> None:
        self.given = tuple(deviation**-2.0 for deviation in settings.deviation)

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return terms_now([(step.sensor_pose,)], DATA)
