"""Relative pose: touch tells how the sensor moved on the object between two steps (paper Eqs. 5 and 6).

With g = o^-1 e as the unknown, the paper's tactile factor is a plain between factor, `Log(measured^-1 g_i^-1 g_j)`.
"""

import numpy as np

from palpate.errors import EstimationError
from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.factor import Factor, Step, Terms
from palpate.graph.se2_kernels import adjoint, between, log, log_by_pose, whiten
from palpate.graph.values import State
from palpate.graph.variables import SENSOR_IN_OBJECT
from palpate.types.measurements import RelativePoses

DATA = np.dtype([("pose", np.float64, (3,)), ("root", np.float64, (3, 3))])
"""Measured `g_i^-1 g_j`, and the matrix that whitens its error."""


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
    g, _e, _shared, _touching, _angle, _c, _model_center, _knocks = state
    relative, apart, error, back = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    by_later, turned = np.empty((3, 3)), np.empty((3, 3))
    for b in range(len(g)):
        for t in range(len(places)):
            earlier, later = g[b, places[t, 0]], g[b, places[t, 1]]
            between(earlier, later, relative)
            between(data[t].pose, relative, apart)
            log(apart, error)
            log_by_pose(error, by_later)
            whiten(data[t].root, error, by_later, residual[b, t], jacobian[b, t, :, 3:])
            # The earlier pose moves what is seen from it the other way: exp(-Ad_relative^-1 d).
            between(later, earlier, back)
            adjoint(back, turned)
            for r in range(3):
                for c in range(3):
                    later_r = jacobian[b, t, r]
                    jacobian[b, t, r, c] = -(
                        later_r[3] * turned[0, c] + later_r[4] * turned[1, c] + later_r[5] * turned[2, c]
                    )
                information[b, t, r] = weight[b, t, r] = 1.0


class RelativePose(Factor):
    """One term for each earlier step that touch compares a step with."""

    name = "relative_pose"
    steps = ((SENSOR_IN_OBJECT,), (SENSOR_IN_OBJECT,))
    rows = 3
    data = DATA
    kernel = _linearise
    reads_outline = False
    given = ()

    def terms(self, step: Step) -> Terms | None:
        """See Factor. Raises EstimationError on a covariance that is not positive."""
        said = [one for one in step.measurements if isinstance(one, RelativePoses) and len(one.back)]
        if not said:
            return None
        back = np.concatenate([one.back for one in said])
        data = np.empty(len(back), DATA)
        data["pose"] = np.concatenate([one.pose for one in said])
        try:
            data["root"] = np.linalg.inv(np.linalg.cholesky(np.concatenate([one.covariance for one in said])))
        except np.linalg.LinAlgError:
            raise EstimationError("a relative pose has a covariance that is not positive definite") from None
        return Terms(np.column_stack([-back, np.zeros_like(back)]).astype(np.int64), data)
