"""First pose: what is known of the object when a contact begins.

It is one Gaussian on the object's pose o = e g^-1 and on what belongs to the object: at the first contact as it was
given, at a later one as the last contact left it, plus the motion of resting. The residual is `Log(known^-1 e g^-1)`,
then the differences of what belongs to the object, whitened together. It is what remains of the paper's rest factor
once the past is marginalised.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.estimation.belief import Prior
from palpate.estimation.compiled import Array, compiled
from palpate.estimation.factors.factor import Factor, Rows, Step, Terms
from palpate.estimation.planar import adjoint, log, log_by_pose, position, rotation, wrap
from palpate.estimation.setting import Settings, Tunable, setting
from palpate.estimation.unknowns import CONTACT_SIZE, OBJECT_SIZE, OF_OBJECT, SENSOR, SENSOR_IN_OBJECT
from palpate.estimation.values import Values

Sigmas = tuple[float, float, float]
_NOTHING = np.dtype([])


@dataclass(frozen=True)
class FirstPoseSettings(Settings):
    """How well the first pose is known, and how still the object rests."""

    deviation: Sigmas = setting((5e-4, 5e-4, 5e-3))
    """The object's known first pose [m, m, rad], body frame. Ground truth gives it exactly, so it is not tuned."""
    rest: Sigmas = setting((1e-5, 1e-5, 1e-4), tune=Tunable(1e-8, 1e-2, usual=False, components=(0, 1, 2)))
    """The object's motion between two contacts [m, m, rad]."""


class FirstPose(Factor):
    """One term, on the first step of a contact; made anew for each contact."""

    name = "first_pose"
    steps = ((SENSOR_IN_OBJECT, SENSOR),)
    shared = OF_OBJECT
    rows = 3 + OBJECT_SIZE

    def __init__(self, priors: Sequence[Prior]) -> None:
        """Take what each smoother knows."""
        self._pose = np.array([prior.pose for prior in priors])
        self._values = np.array([prior.values for prior in priors])
        self._root = np.linalg.inv(np.linalg.cholesky(np.array([prior.covariance for prior in priors])))

    def terms(self, step: Step) -> Terms | None:
        """See Factor."""
        return Terms(np.zeros((1, 1), np.int64), np.zeros(1, _NOTHING)) if step.before is None else None

    def linearise(self, at: Values, terms: Terms) -> Rows:
        """See Factor."""
        g, e = at[SENSOR_IN_OBJECT], at[SENSOR]
        values = at.shared[CONTACT_SIZE:].T
        residual, jacobian = np.empty((len(g), self.rows)), np.zeros((len(g), self.rows, 6 + OBJECT_SIZE))
        _linearise(g, e, self._pose, residual, jacobian)
        residual[:, 3:] = values - self._values
        jacobian[:, 3:, 6:] = np.eye(OBJECT_SIZE)
        rows = Rows.empty(len(g), 1, self.rows, 6 + OBJECT_SIZE)
        np.matmul(self._root, residual[:, :, None], out=rows.residual.transpose(0, 2, 1))
        np.matmul(self._root, jacobian, out=rows.jacobian[:, 0])
        rows.information[:] = rows.weight[:] = 1.0
        return rows


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
def _linearise(g: Array, e: Array, known: Array, residual: Array, jacobian: Array) -> None:
    for b in range(len(g)):
        object_pose_error(g[b, 0], e[b, 0], known[b], residual[b], jacobian[b])
