"""First pose: what is known of the object when a contact begins.

It is one Gaussian on the object's pose o = e g^-1 and on what belongs to the object: at the first contact as it was
given, at a later one as the last contact left it, plus the motion of resting. The residual is `Log(known^-1 e g^-1)`,
then the differences of what belongs to the object, whitened together. It is what remains of the paper's rest factor
once the past is marginalised.
"""

from collections.abc import Sequence

import numpy as np

from palpate.errors import EstimationError
from palpate.filter.belief import Prior
from palpate.graph.compiled import Array, Given, Places, Records, compiled
from palpate.graph.factors.factor import NOTHING, Factor, Step, Terms, term_now
from palpate.graph.se2_kernels import adjoint, log, log_by_pose, position, rotation, wrap
from palpate.graph.values import State
from palpate.graph.variables import CONTACT_SIZE, OBJECT_SIZE, OF_OBJECT, SENSOR, SENSOR_IN_OBJECT


@compiled
def object_pose_error(g: Array, e: Array, known: Array, residual: Array, jacobian: Array) -> None:
    """Put `Log(known^-1 e g^-1)` of poses (3,) into residual (3,), its derivative by g and e into jacobian (3, 6)."""
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
    g, e, shared, _touching, _angle, _c, _model_center, _knocks = state
    known_pose, known_values, root = given
    off, by_poses = np.empty(3 + OBJECT_SIZE), np.empty((3, 6))
    for b in range(len(g) if len(places) else 0):
        first = places[0, 0]
        object_pose_error(g[b, first], e[b, first], known_pose[b], off[:3], by_poses)
        for k in range(OBJECT_SIZE):
            off[3 + k] = shared[CONTACT_SIZE + k, b] - known_values[b, k]
        for r in range(3 + OBJECT_SIZE):
            row, whitening = jacobian[b, 0, r], root[b, r]
            total = 0.0
            for k in range(3 + OBJECT_SIZE):
                total += whitening[k] * off[k]
            residual[b, 0, r] = total
            for k in range(6):
                row[k] = whitening[0] * by_poses[0, k] + whitening[1] * by_poses[1, k] + whitening[2] * by_poses[2, k]
            for k in range(OBJECT_SIZE):
                row[6 + k] = whitening[3 + k]
            information[b, 0, r] = weight[b, 0, r] = 1.0


class FirstPose(Factor):
    """One term, on the first step of a contact; made anew for each contact."""

    name = "first_pose"
    steps = ((SENSOR_IN_OBJECT, SENSOR),)
    shared = OF_OBJECT
    rows = 3 + OBJECT_SIZE
    data = NOTHING
    kernel = _linearise
    reads_outline = False

    def __init__(self, priors: Sequence[Prior]) -> None:
        """Take what each smoother knows; raises EstimationError where that is no Gaussian."""
        try:
            root = np.linalg.inv(np.linalg.cholesky(np.array([prior.covariance for prior in priors])))
        except np.linalg.LinAlgError:
            raise EstimationError("the covariance of what is known of the object is not positive definite") from None
        self.given = (
            np.array([prior.pose for prior in priors]),
            np.array([prior.values for prior in priors]),
            root,
        )

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return term_now() if step.before is None else None
