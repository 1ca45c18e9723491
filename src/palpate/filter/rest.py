"""The object between contacts: it rests, and what is measured of it meanwhile is taken in.

At rest the graph has one pose, the object's, and what belongs to the object. Factors that hold at rest are linearised
as in contact, with the object standing for the sensor: with g = 0 and e = o, a perturbation of e is one of the object.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError
from palpate.filter.belief import Prior
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.factor import Factor, Rows, Step, Terms
from palpate.graph.values import Values
from palpate.graph.variables import CONTACT_SIZE, IN_STEP, SENSOR, SENSOR_IN_OBJECT, SHARED_SIZE, STEP_SIZE
from palpate.types.measurements import Measurement

Array = NDArray[np.float64]
_ITERATIONS, _CONVERGED = 10, 1e-6  # [m], [rad]


def measured_at_rest(
    known: Prior,
    doubted: Prior,
    measurements: Sequence[Measurement],
    factors: Sequence[Factor],
    model: ContactModel,
    since: float,
    now: float,
) -> tuple[Prior, bool]:
    """Return what is known of a resting object after measurements of it, and whether they tell of its pose.

    Those that do are weighed against what is `doubted`: the same pose where something may have moved the object. The
    object has rested since a time [s], and a measurement may be of any time from then to now [s]. Raises
    EstimationError where they leave no solution.
    """
    step = Step(known.pose, None, measurements, [since, now], at_rest=True)
    terms = [(factor, factor.terms(step)) for factor in factors if factor.holds_at_rest]
    given = [(factor, arrived._replace(places=0 * arrived.places)) for factor, arrived in terms if arrived is not None]
    if not given:
        return known, False
    said = _linearised(given, model, known.pose, known.values)
    tells_pose = any(by_object[..., :3].any() for _, by_object in said)
    prior = doubted if tells_pose else known
    before = np.linalg.inv(prior.covariance)
    pose, values = prior.pose, prior.values
    covariance = prior.covariance
    for _ in range(_ITERATIONS):
        off = np.concatenate([se2.log(se2.between(prior.pose, pose)), values - prior.values])
        information, gradient = before.copy(), -before @ off
        for rows, by_object in _linearised(given, model, pose, values):
            pulled = by_object.transpose(0, 2, 1) * rows.weight[0][:, None]
            information += (pulled @ by_object).sum(axis=0)
            gradient -= (pulled @ rows.residual[0][..., None]).sum(axis=0)[:, 0]
        try:
            change = np.linalg.solve(information, gradient)
            covariance = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            raise EstimationError("what is measured of the resting object leaves it indeterminate") from None
        pose, values = se2.compose(pose, se2.exp(change[:3])), values + change[3:]
        if np.abs(change).max() < _CONVERGED:
            break
    if not (np.isfinite(pose).all() and np.isfinite(values).all() and np.isfinite(covariance).all()):
        raise EstimationError("what is measured of the resting object leaves it indeterminate")
    return Prior(pose, values, 0.5 * (covariance + covariance.T)), tells_pose


def _linearised(
    given: Sequence[tuple[Factor, Terms]], model: ContactModel, pose: Array, values: Array
) -> list[tuple[Rows, Array]]:
    """Terms of factors at an object pose (3,) and values (OBJECT_SIZE,), each with its Jacobian; see `_by_object`."""
    shared = np.zeros((SHARED_SIZE, 1))
    shared[CONTACT_SIZE:, 0] = values
    at = Values(model, {SENSOR_IN_OBJECT: np.zeros((1, 1, 3)), SENSOR: pose[None, None].copy()}, shared)
    rows = [(factor, factor.linearise(at, arrived)) for factor, arrived in given]
    return [(each, _by_object(factor, each.jacobian[0])) for factor, each in rows]


def _by_object(factor: Factor, jacobian: Array) -> Array:
    """The columns (T, R, 3 + OBJECT_SIZE) of the object's pose and of what belongs to it, of a Jacobian (T, R, C)."""
    (in_step, in_shared), (of_step, of_shared) = factor.columns
    every = np.zeros((*jacobian.shape[:2], STEP_SIZE + SHARED_SIZE))
    every[..., in_step : in_step + of_step] = jacobian[..., :of_step]
    every[..., STEP_SIZE + in_shared : STEP_SIZE + in_shared + of_shared] = jacobian[..., of_step:]
    return np.concatenate([every[..., IN_STEP[SENSOR]], every[..., STEP_SIZE + CONTACT_SIZE :]], axis=-1)
