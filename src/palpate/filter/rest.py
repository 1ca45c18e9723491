"""Measurements of the object between contacts, while it rests.

The graph then has one pose, the object's, and the object's variables.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from palpate.errors import EstimationError
from palpate.filter.consistency import ConsistencyMonitor
from palpate.filter.hypotheses import Hypotheses
from palpate.geometry import se2
from palpate.graph.belief import Belief
from palpate.graph.factors import Step
from palpate.graph.own_measurements import evaluated
from palpate.graph.variables import CONTACT_SIZE, IN_STEP, OBJECT_SIZE, SENSOR, STEP_SIZE
from palpate.types.measurements import Measurement, ObjectPose, OwnMeasurement

Array = NDArray[np.float64]
_ITERATIONS, _CONVERGED = 10, 1e-6  # [m], [rad]


def measured_at_rest(
    rows: Hypotheses,
    measurements: Sequence[Measurement],
    times: tuple[float, float],
    monitor: ConsistencyMonitor,
) -> tuple[Hypotheses, bool]:
    """Return the hypotheses with measurements of the resting object, and True if these are of its pose.

    Then they are combined with a belief that is inflated by what may have moved it. The object rests since the first of
    the times [s], and measurements may have any time from then to the second, now. Raises EstimationError if there is
    no solution.
    """
    whole, now = rows.whole_belief, times[-1]
    step = Step(whole.pose[0], None, measurements, times, at_rest=True)
    poses, own = step.timed(ObjectPose), step.own()
    prior = whole.inflated(monitor.displacement_covariance(rows))
    tested = monitor.test_object_poses(replace(rows, belief=prior), [prior.pose] * len(poses), poses)
    tested = replace(tested, unobservable_yaw=np.zeros(len(rows.age)))
    if not poses and not own:
        return replace(tested, belief=whole), False
    is_of_pose = bool(_linearised(poses, own, whole.pose[0], whole.values[0], now)[1][:, :3].any())
    if is_of_pose:  # the object may have been found elsewhere
        whole = prior.inflated(monitor.contradiction_covariance(rows))
        tested = replace(tested, displacement=np.zeros(len(rows.age)))
    solved = [_solved(whole.take([row]), poses, own, now) for row in range(len(whole))]
    return replace(tested, belief=reduce(Belief.joined, solved)), is_of_pose


def _solved(prior: Belief, poses: list[ObjectPose], own: list[OwnMeasurement | None], now: float) -> Belief:
    """Return a belief (one row) after measurements."""
    before = np.linalg.inv(prior.covariance[0])
    pose, values, covariance = prior.pose[0], prior.values[0], prior.covariance[0]
    for _ in range(_ITERATIONS):
        off = np.concatenate([se2.log(se2.between(prior.pose[0], pose)), values - prior.values[0]])
        residual, jacobian = _linearised(poses, own, pose, values, now)
        information = before + jacobian.T @ jacobian
        gradient = -before @ off - jacobian.T @ residual
        try:
            change = np.linalg.solve(information, gradient)
            covariance = np.linalg.inv(information)
        except np.linalg.LinAlgError:
            raise EstimationError("measurements of the resting object leave it indeterminate") from None
        pose, values = se2.compose(pose, se2.exp(change[:3])), values + change[3:]
        if np.abs(change).max() < _CONVERGED:
            break
    if not all(np.isfinite(found).all() for found in (pose, values, covariance)):
        raise EstimationError("measurements of the resting object leave it indeterminate")
    return Belief(pose[None], values[None], 0.5 * (covariance + covariance.T)[None])


def _linearised(
    poses: list[ObjectPose], own: list[OwnMeasurement | None], pose: Array, values: Array, now: float
) -> tuple[Array, Array]:
    """Return whitened residuals (R,) at an object pose (3,) and variables, and their Jacobian by both."""
    residuals, jacobians = [], []
    for one in poses:
        root, off = np.linalg.inv(np.linalg.cholesky(one.covariance)), se2.log(se2.between(one.pose, pose))
        residuals.append(root @ off)
        jacobians.append(np.hstack([root @ se2.right_jacobian_inverse(off), np.zeros((3, OBJECT_SIZE))]))
    # With the object in place of the sensor, g = 0 and e = o, a perturbation of e is one of the object.
    shared = np.concatenate([np.zeros(CONTACT_SIZE), values])
    rows = evaluated(own, [0] * len(own), np.zeros((1, 1, 3)), pose[None, None], shared[None], now)[0]
    for row in rows:
        by_values = row[:, 1 + STEP_SIZE + CONTACT_SIZE :]
        residuals.append(row[:, 0])
        jacobians.append(np.hstack([row[:, 1:][:, IN_STEP[SENSOR]], by_values]))
    return np.concatenate(residuals), np.concatenate(jacobians)
