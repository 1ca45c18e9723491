"""Belief about the object at the beginning of a contact, as a factor.

It is a joint Gaussian on the object's pose o = e g^-1 and the object's variables. The residual is
`Log(known^-1 e g^-1)` followed by the differences of the variables, whitened together. It takes the place of the
paper's rest factor once the past is marginalised.
"""

import numpy as np

from palpate.graph.belief import Array, Belief, Indices
from palpate.graph.compiled import Integers, Records, compiled
from palpate.graph.factors.factor import Factor, Linear, Step, Terms, term_now
from palpate.graph.factors.object_pose import object_pose_error
from palpate.graph.values import State
from palpate.graph.variables import CONTACT_SIZE, OBJECT_SIZE, OF_OBJECT, SENSOR, SENSOR_IN_OBJECT


@compiled
def _linearise(state: State, step: Integers, data: Records, given: tuple[Array, Array, Array], out: Linear) -> None:
    pose, values, root = given
    off, by_poses = np.empty(3 + OBJECT_SIZE), np.empty((3, 6))
    for b in range(len(state.sign) if len(step) else 0):
        first = step[0]
        g, e = state.sensor_in_object[b, first], state.sensor[b, first]
        object_pose_error(g, e, pose[b], off[:3], by_poses)
        for k in range(OBJECT_SIZE):
            off[3 + k] = state.shared[b, CONTACT_SIZE + k] - values[b, k]
        for r in range(3 + OBJECT_SIZE):
            row, whitening = out.jacobian[b, 0, r], root[b, r]
            total = 0.0
            for k in range(3 + OBJECT_SIZE):
                total += whitening[k] * off[k]
            out.residual[b, 0, r] = total
            for k in range(6):
                row[k] = whitening[0] * by_poses[0, k] + whitening[1] * by_poses[1, k] + whitening[2] * by_poses[2, k]
            for k in range(OBJECT_SIZE):
                row[6 + k] = whitening[3 + k]
            out.information[b, 0, r] = out.weight[b, 0, r] = 1.0


class FirstPose(Factor):
    """One term, on the first step of a contact; each hypothesis has its own belief."""

    name = "first_pose"
    on = (SENSOR_IN_OBJECT, SENSOR)
    shared = OF_OBJECT
    rows = 3 + OBJECT_SIZE
    kernel = _linearise

    def __init__(self, belief: Belief) -> None:
        """Take the beliefs; a covariance that is not positive definite leaves its hypothesis without a solution."""
        self.given = belief.pose, belief.values, np.array([_whitening(one) for one in belief.covariance])

    def take(self, rows: Indices) -> "FirstPose":
        """Return the factor of these hypotheses."""
        taken = object.__new__(FirstPose)
        taken.given = tuple(array[rows] for array in self.given)
        return taken

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return term_now() if step.before is None else None


def _whitening(covariance: Array) -> Array:
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(covariance, np.nan)
