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
) -> tuple[list[int], Hypotheses, bool]:
    """Return the rows that have a solution with measurements of the resting object, these, and True if it was found.

    It is found by measurements of its pose. They are combined with a belief that is inflated by what may have moved it.
    The object rests since the first of the times [s], and measurements may have any time from then to the second, now.
    Raises EstimationError if no hypothesis has a solution.
    """
    kept: list[int] = []
    solved: list[Hypotheses] = []
    is_found = False
    for row in range(len(rows.age)):
        one = rows.take([row])
        whole = one.whole_belief
        prior = whole.inflated(monitor.displacement_covariance(one))
        doubted = prior.inflated(monitor.contradiction_covariance(one))
        step = Step(whole.pose[0], None, measurements, times, at_rest=True)
        try:
            belief, is_of_pose = _solved(whole, doubted, step)
        except EstimationError:
            if row == len(rows.age) - 1 and not solved:
                raise
            continue
        measured = [each for each in measurements if isinstance(each, ObjectPose) and step.is_in_window(each)]
        one = monitor.test_object_poses(replace(one, belief=prior), [prior.pose] * len(measured), measured)
        if is_of_pose:  # the object may have been found elsewhere
            one, is_found = replace(one, displacement=np.zeros(1)), True
        kept.append(row)
        solved.append(replace(one, belief=belief, unobservable_yaw=np.zeros(1)))
    return kept, reduce(Hypotheses.joined, solved), is_found


def _solved(belief: Belief, doubted: Belief, step: Step) -> tuple[Belief, bool]:
    """Return the belief (one row) after the measurements of a step, and True if these depend on the object's pose."""
    poses, own, now = step.timed(ObjectPose), step.own(), step.times[-1]
    if not poses and not own:
        return belief, False
    is_of_pose = _linearised(poses, own, belief.pose[0], belief.values[0], now)[1][:, :3].any()
    prior = doubted if is_of_pose else belief
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
    if not (np.isfinite(pose).all() and np.isfinite(values).all() and np.isfinite(covariance).all()):
        raise EstimationError("measurements of the resting object leave it indeterminate")
    return Belief(pose[None], values[None], 0.5 * (covariance + covariance.T)[None]), bool(is_of_pose)


def _linearised(
    poses: Sequence[ObjectPose], own: list[OwnMeasurement | None], pose: Array, values: Array, now: float
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
