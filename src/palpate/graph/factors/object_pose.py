"""Object pose: another source, such as a camera, sees where the object is, `Log(measured^-1 e g^-1)`."""

import numpy as np

from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.factor import Factor, Step, Terms
from palpate.graph.factors.first_pose import object_pose_error
from palpate.graph.se2_kernels import whiten
from palpate.graph.values import State
from palpate.graph.variables import SENSOR, SENSOR_IN_OBJECT
from palpate.types.measurements import ObjectPose as ObjectPoseMeasurement

DATA = np.dtype([("pose", np.float64, (3,)), ("root", np.float64, (3, 3))])
"""Measured world_T_object, and the matrix that whitens its error."""


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
    g, e, _shared, _touching, _angle, _c, _model_center, _knocks = state
    error, by_g_and_e = np.empty(3), np.empty((3, 6))
    for b in range(len(g)):
        for t in range(len(places)):
            object_pose_error(g[b, places[t, 0]], e[b, places[t, 0]], data[t].pose, error, by_g_and_e)
            whiten(data[t].root, error, by_g_and_e, residual[b, t], jacobian[b, t])
            for r in range(3):
                information[b, t, r] = weight[b, t, r] = 1.0


class ObjectPose(Factor):
    """One term for each measured pose of the object."""

    name = "object_pose"
    steps = ((SENSOR_IN_OBJECT, SENSOR),)
    rows = 3
    data = DATA
    kernel = _linearise
    reads_outline = False
    given = ()
    holds_at_rest = True

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        said = step.of(ObjectPoseMeasurement)
        if not said:
            return None
        data = np.empty(len(said), DATA)
        data["pose"] = [one.pose for one in said]
        data["root"] = np.linalg.inv(np.linalg.cholesky(np.array([one.covariance for one in said])))
        return Terms(step.places_of(said), data)
