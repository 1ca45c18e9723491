"""Measurements of the object between contacts, while it rests.

The graph then has one pose, the object's, and the object's variables.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.arrays import Array
from palpate.config import CONVERGED, ITERATIONS
from palpate.errors import EstimationError
from palpate.filter.consistency import ConsistencyMonitor
from palpate.filter.hypotheses import Hypotheses
from palpate.geometry import se2
from palpate.graph.belief import Belief
from palpate.graph.factors import timely
from palpate.graph.own_measurements import OwnMeasurements
from palpate.graph.variables import CONTACT_SIZE, OBJECT_SIZE, STEP_SIZE
from palpate.types.measurements import Measurement, ObjectPose, OwnMeasurement

_INDETERMINATE = "measurements of the resting object leave it indeterminate"


def measured_at_rest(
    rows: Hypotheses,
    measurements: Sequence[Measurement],
    times: tuple[float, float],
    monitor: ConsistencyMonitor,
    own: OwnMeasurements,
) -> tuple[Hypotheses, bool]:
    """Return the hypotheses with measurements of the resting object, and True if these are of its pose.

    Then they are combined with a belief that is inflated by what may have moved it. The object rests since the first of
    the times [s], and measurements may have any time from then to the second, now. Raises EstimationError if there is
    no solution.
    """
    whole, usable = rows.whole_belief, timely(measurements, times)
    poses = [one for one in usable if isinstance(one, ObjectPose)]
    own.given, own.time = [(0, one) for one in usable if isinstance(one, OwnMeasurement)], times[-1]
    prior = whole.inflated(monitor.displacement_covariance(rows))
    tested = replace(rows, belief=prior, unobservable_yaw=np.zeros_like(rows.unobservable_yaw))
    monitor.test_object_poses(tested, [prior.pose] * len(poses), poses)
    is_of_pose = bool(_linearised(poses, own, whole.pose, whole.values)[1][..., :3].any())
    if is_of_pose:  # the object may have been found elsewhere
        whole = prior.inflated(monitor.contradiction_covariance(rows))
        tested.displacement = np.zeros_like(rows.displacement)
    tested.belief = _solved(whole, poses, own) if poses or own.given else whole
    return tested, is_of_pose


def _solved(prior: Belief, poses: list[ObjectPose], own: OwnMeasurements) -> Belief:
    """Return the beliefs after measurements."""
    before, pose, values, covariance = np.linalg.inv(prior.covariance), prior.pose, prior.values, prior.covariance
    for _ in range(ITERATIONS):
        off = np.concatenate([se2.log(se2.between(prior.pose, pose)), values - prior.values], axis=1)
        residual, jacobian = _linearised(poses, own, pose, values)
        transposed = jacobian.transpose(0, 2, 1)
        gradient = -before @ off[..., None] - transposed @ residual[..., None]
        try:
            covariance = np.linalg.inv(before + transposed @ jacobian)
        except np.linalg.LinAlgError:
            raise EstimationError(_INDETERMINATE) from None
        change = (covariance @ gradient)[..., 0]
        pose, values = se2.compose(pose, se2.exp(change[:, :3])), values + change[:, 3:]
        if np.abs(change).max() < CONVERGED:
            break
    if not all(np.isfinite(found).all() for found in (pose, values, covariance)):
        raise EstimationError(_INDETERMINATE)
    return Belief(pose, values, 0.5 * (covariance + covariance.transpose(0, 2, 1)))


def _linearised(poses: list[ObjectPose], own: OwnMeasurements, pose: Array, values: Array) -> tuple[Array, Array]:
    """Return whitened residuals (B, R) at object poses (B, 3) and variables, and their Jacobians by both."""
    count = len(pose)
    residuals, jacobians = [np.empty((count, 0))], [np.empty((count, 0, 3 + OBJECT_SIZE))]
    for one in poses:
        root, off = np.linalg.inv(np.linalg.cholesky(one.covariance)), se2.log(se2.between(one.pose, pose))
        residuals.append(off @ root.T)
        jacobians.append(np.dstack([root @ se2.right_jacobian_inverse(off), np.zeros((count, 3, OBJECT_SIZE))]))
    # With the object in place of the sensor, g = 0 and e = o, a perturbation of e is one of the object.
    shared = np.concatenate([np.zeros((count, CONTACT_SIZE)), values], axis=1)
    rows = own.evaluated(0, np.zeros((count, 1, 3)), pose[:, None], shared, at_rest=True)
    for row in rows.swapaxes(0, 1):
        residuals.append(row[..., 0])
        jacobians.append(np.dstack([row[..., STEP_SIZE - 2 : STEP_SIZE + 1], row[..., 1 + STEP_SIZE + CONTACT_SIZE :]]))
    return np.concatenate(residuals, axis=1), np.concatenate(jacobians, axis=1)
