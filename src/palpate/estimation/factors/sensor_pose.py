"""The measured pose of the sensor: `Log(measured^-1 e)` (paper Eq. 12)."""

from dataclasses import dataclass

import numpy as np

from palpate.estimation.compiled import Array, Places, Records, compiled
from palpate.estimation.factors.factor import Factor, Rows, Step, Terms, terms_now
from palpate.estimation.planar import between, log, log_by_pose
from palpate.estimation.setting import Settings, Tunable, setting
from palpate.estimation.unknowns import SENSOR
from palpate.estimation.values import Values

Sigmas = tuple[float, float, float]
DATA = np.dtype([("pose", np.float64, (3,))])


@dataclass(frozen=True)
class SensorPoseSettings(Settings):
    """How well the robot knows where its sensor is."""

    deviation: Sigmas = setting((1e-4, 1e-4, 1e-3), tune=Tunable(1e-6, 1e-2, usual=False, components=(0, 1, 2)))
    """Measured sensor pose [m, m, rad], body frame: a good robot's kinematics or motion capture."""


class SensorPose(Factor):
    """One term a step: the sensor is where it was measured to be."""

    name = "sensor_pose"
    steps = ((SENSOR,),)
    rows = 3
    is_motion = True

    def __init__(self, settings: SensorPoseSettings) -> None:
        self._information = np.square(settings.deviation) ** -1.0

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return terms_now([(step.sensor_pose,)], DATA)

    def linearise(self, at: Values, terms: Terms) -> Rows:
        """See Factor."""
        e = at[SENSOR]
        rows = Rows.empty(len(e), len(terms.data), self.rows, 3)
        rows.information[:] = rows.weight[:] = self._information
        _linearise(e, terms.places, terms.data, rows.residual, rows.jacobian)
        return rows


@compiled
def _linearise(e: Array, places: Places, data: Records, residual: Array, jacobian: Array) -> None:
    apart = np.empty(3)
    for b in range(len(e)):
        for t in range(len(places)):
            between(data[t].pose, e[b, places[t, 0]], apart)
            log(apart, residual[b, t])
            log_by_pose(residual[b, t], jacobian[b, t])
