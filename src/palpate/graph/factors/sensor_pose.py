"""Measured sensor pose, `Log(measured^-1 e)` (paper Eq. 12)."""

import numpy as np

from palpate.config import SensorPoseSettings
from palpate.graph.compiled import Integers, Records, compiled
from palpate.graph.factors.factor import Factor, Linear, Step, Terms
from palpate.graph.se2_kernels import between, log, log_by_pose
from palpate.graph.values import State
from palpate.graph.variables import SENSOR

DATA = np.dtype([("pose", np.float64, (3,))])


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple[float, float, float], out: Linear) -> None:
    apart = np.empty(3)
    for b in range(len(state.sign)):
        for t in range(len(step)):
            between(data[t].pose, state.sensor[b, step[t]], apart)
            log(apart, out.residual[b, t])
            log_by_pose(out.residual[b, t], out.jacobian[b, t])
            for r in range(3):
                out.information[b, t, r] = out.weight[b, t, r] = given[r]


class SensorPose(Factor):
    """One term a step."""

    name = "sensor_pose"
    on = (SENSOR,)
    rows = 3
    data = DATA
    kernel = _linearise

    def __init__(self, settings: SensorPoseSettings) -> None:
        self.given = tuple(deviation**-2.0 for deviation in settings.deviation)

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return Terms(np.zeros(1, np.int64), np.array([(step.sensor_pose,)], DATA))
