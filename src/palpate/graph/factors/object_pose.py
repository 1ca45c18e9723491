"""Object pose measured by another source, such as a camera: `Log(measured^-1 e g^-1)`."""

import numpy as np

from palpate.graph.compiled import Array, Integers, Records, compiled
from palpate.graph.factors.factor import Factor, Linear, Step, Terms
from palpate.graph.se2_kernels import adjoint, log, log_by_pose, position, rotation, whiten, wrap
from palpate.graph.values import State
from palpate.graph.variables import SENSOR, SENSOR_IN_OBJECT
from palpate.types.measurements import ObjectPose as ObjectPoseMeasurement

DATA = np.dtype([("pose", np.float64, (3,)), ("root", np.float64, (3, 3))])
"""Measured world_T_object, and the whitening matrix of its covariance."""


@compiled
def object_pose_error(g: Array, e: Array, known: Array, residual: Array, jacobian: Array) -> None:
    """Write `Log(known^-1 e g^-1)` of poses (3,) to residual (3,), and its derivative by g and e to jacobian (3, 6)."""
    apart, by_object, turned = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    object_turn = rotation(e[2] - g[2])
    off = (position(e) - object_turn * position(g) - position(known)) * rotation(-known[2])
    apart[0], apart[1], apart[2] = off.real, off.imag, wrap(e[2] - g[2] - known[2])
    log(apart, residual)
    log_by_pose(residual, by_object)
    # With o = e g^-1: e exp(d) g^-1 = o exp(Ad_g d), and e (g exp(d))^-1 = o exp(-Ad_g d).
    adjoint(g, turned)
    for r in range(3):
        for c in range(3):
            by_e = 0.0
            for k in range(3):
                by_e += by_object[r, k] * turned[k, c]
            jacobian[r, c], jacobian[r, 3 + c] = -by_e, by_e


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple, out: Linear) -> None:
    error, by_g_and_e = np.empty(3), np.empty((3, 6))
    for b in range(len(state.sign)):
        for t in range(len(step)):
            g, e = state.sensor_in_object[b, step[t]], state.sensor[b, step[t]]
            object_pose_error(g, e, data[t].pose, error, by_g_and_e)
            whiten(data[t].root, error, by_g_and_e, out.residual[b, t], out.jacobian[b, t])
            for r in range(3):
                out.information[b, t, r] = out.weight[b, t, r] = 1.0


class ObjectPose(Factor):
    """One term for each measured pose of the object."""

    name = "object_pose"
    on = (SENSOR_IN_OBJECT, SENSOR)
    rows = 3
    data = DATA
    kernel = _linearise
    holds_at_rest = True

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        found = step.timed(ObjectPoseMeasurement)
        if not found:
            return None
        data = np.empty(len(found), DATA)
        data["pose"] = [one.pose for one in found]
        data["root"] = np.linalg.inv(np.linalg.cholesky(np.array([one.covariance for one in found])))
        return Terms(step.nearest(found), data)
