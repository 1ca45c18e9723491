"""Measurements of the object between contacts, while it rests.

The graph then has one pose, the object's, and the object's variables.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Array
from palpate.config import CONVERGED, ITERATIONS
from palpate.errors import EstimationError
from palpate.geometry import se2
from palpate.graph.belief import Belief
from palpate.graph.factors import timely
from palpate.graph.own_measurements import OwnMeasurements
from palpate.graph.variables import CONTACT_SIZE, OBJECT_SIZE, STEP_SIZE
from palpate.hypotheses.consistency import ConsistencyMonitor
from palpate.hypotheses.rows import Hypotheses
from palpate.types.measurements import Measurement, ObjectPose, OwnMeasurement

_INDETERMINATE = "measurements of the resting object leave it indeterminate"


@dataclass(frozen=True, eq=False)
class MeasuredAtRest:
    """Hypotheses with measurements of the resting object."""

    rows: Hypotheses
    measures_pose: bool
    """True if a measurement is of the object's pose, which may then have been found elsewhere."""


def measured_at_rest(
    rows: Hypotheses,
    measurements: Sequence[Measurement],
    times: tuple[float, float],
    monitor: ConsistencyMonitor,
    own: OwnMeasurements,
) -> MeasuredAtRest:
    """Return the hypotheses with measurements of the resting object.

    Those of its pose are combined with a belief that is inflated by the motion that something may have given it.
    Measurements may have any time between the first frame at rest and this one, `times` [s]. Raises EstimationError if
    there is no solution.
    """
    usable = timely(measurements, times)
    poses = [one for one in usable if isinstance(one, ObjectPose)]
    own.given = [(0, one) for one in usable if isinstance(one, OwnMeasurement)]
    own.time = times[-1]
    whole = rows.whole_belief
    displaced = whole.inflated(monitor.displacement_covariance(rows))
    tested = replace(rows, belief=displaced, unobservable_yaw=np.zeros(len(rows)))
    tested = monitor.test_object_poses(tested, [displaced.pose] * len(poses), poses)
    _, jacobian = _linearised(poses, own, whole.pose, whole.values)
    measures_pose = bool(jacobian[..., :3].any())
    prior = whole
    if measures_pose:  # the object may have been found elsewhere
        prior = displaced.inflated(monitor.contradiction_covariance(rows))
        tested = replace(tested, displacement=np.zeros(len(rows)))
    posterior = _solved(prior, poses, own) if poses or own.given else prior
    return MeasuredAtRest(replace(tested, belief=posterior), measures_pose)


def _solved(prior: Belief, poses: list[ObjectPose], own: OwnMeasurements) -> Belief:
    """Return the beliefs after measurements."""
    information = np.linalg.inv(prior.covariance)
    pose = prior.pose
    values = prior.values
    covariance = prior.covariance
    for _ in range(ITERATIONS):
        pose_off = se2.log(se2.between(prior.pose, pose))
        off = np.concatenate([pose_off, values - prior.values], axis=1)
        residual, jacobian = _linearised(poses, own, pose, values)
        transposed = jacobian.transpose(0, 2, 1)
        gradient = -information @ off[..., None] - transposed @ residual[..., None]
        try:
            covariance = np.linalg.inv(information + transposed @ jacobian)
        except np.linalg.LinAlgError:
            raise EstimationError(_INDETERMINATE) from None
        change = (covariance @ gradient)[..., 0]
        pose = se2.compose(pose, se2.exp(change[:, :3]))
        values = values + change[:, 3:]
        if np.abs(change).max() < CONVERGED:
            break
    if not all(np.isfinite(found).all() for found in (pose, values, covariance)):
        raise EstimationError(_INDETERMINATE)
    return Belief(pose, values, 0.5 * (covariance + covariance.transpose(0, 2, 1)))


def _linearised(poses: list[ObjectPose], own: OwnMeasurements, pose: Array, values: Array) -> tuple[Array, Array]:
    """Return whitened residuals (B, R) at object poses (B, 3) and variables, and their Jacobians by both."""
    count = len(pose)
    residuals = [np.empty((count, 0))]
    jacobians = [np.empty((count, 0, 3 + OBJECT_SIZE))]
    for measured in poses:
        whitening = np.linalg.inv(np.linalg.cholesky(measured.covariance))
        off = se2.log(se2.between(measured.pose, pose))
        by_pose = whitening @ se2.right_jacobian_inverse(off)
        residuals.append(off @ whitening.T)
        jacobians.append(np.dstack([by_pose, np.zeros((count, 3, OBJECT_SIZE))]))
    # With the object in place of the sensor, g = 0 and e = o, a perturbation of e is one of the object.
    object_as_sensor = np.zeros((count, 1, 3))
    shared = np.concatenate([np.zeros((count, CONTACT_SIZE)), values], axis=1)
    linear = own.evaluated(0, object_as_sensor, pose[:, None], shared, at_rest=True)
    for residual_and_jacobian in linear.swapaxes(0, 1):  # of each measurement
        by_pose = residual_and_jacobian[..., STEP_SIZE - 2 : STEP_SIZE + 1]
        by_values = residual_and_jacobian[..., 1 + STEP_SIZE + CONTACT_SIZE :]
        residuals.append(residual_and_jacobian[..., 0])
        jacobians.append(np.dstack([by_pose, by_values]))
    return np.concatenate(residuals, axis=1), np.concatenate(jacobians, axis=1)
