"""Measurements of the object between contacts, while it rests.

The graph then has one pose, the object's, and the object's variables. Factors that hold at rest are linearised as in
contact with the object in place of the sensor: with g = 0 and e = o, a perturbation of e is one of the object.
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
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.factor import Factor, Linear, Step, Terms
from palpate.graph.values import Values
from palpate.graph.variables import CONTACT_SIZE, IN_STEP, SENSOR, SHARED_SIZE, STEP_SIZE
from palpate.types.measurements import Measurement, ObjectPose

Array = NDArray[np.float64]
_ITERATIONS, _CONVERGED = 10, 1e-6  # [m], [rad]


def measured_at_rest(
    rows: Hypotheses,
    measurements: Sequence[Measurement],
    times: tuple[float, float],
    factors: Sequence[Factor],
    model: ContactModel,
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
            belief, is_of_pose = _solved(whole, doubted, step, factors, model)
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


def _solved(
    belief: Belief, doubted: Belief, step: Step, factors: Sequence[Factor], model: ContactModel
) -> tuple[Belief, bool]:
    """Return the belief (one row) after the measurements of a step, and True if these depend on the object's pose."""
    terms = [(factor, factor.terms(step)) for factor in factors if factor.holds_at_rest]
    given = [(factor, Terms(0 * new.step, new.data)) for factor, new in terms if new is not None]
    if not given:
        return belief, False
    linear = _linearised(given, model, belief.pose[0], belief.values[0])
    is_of_pose = any(by_object[..., :3].any() for _, by_object in linear)
    prior = doubted if is_of_pose else belief
    before = np.linalg.inv(prior.covariance[0])
    pose, values, covariance = prior.pose[0], prior.values[0], prior.covariance[0]
    for _ in range(_ITERATIONS):
        off = np.concatenate([se2.log(se2.between(prior.pose[0], pose)), values - prior.values[0]])
        information, gradient = before.copy(), -before @ off
        for rows, by_object in _linearised(given, model, pose, values):
            pulled = by_object.transpose(0, 2, 1) * rows.weight[0][:, None]
            information += (pulled @ by_object).sum(axis=0)
            gradient -= (pulled @ rows.residual[0][..., None]).sum(axis=0)[:, 0]
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
    return Belief(pose[None], values[None], 0.5 * (covariance + covariance.T)[None]), is_of_pose


def _linearised(
    given: Sequence[tuple[Factor, Terms]], model: ContactModel, pose: Array, values: Array
) -> list[tuple[Linear, Array]]:
    """Return terms linearised at an object pose (3,) and variables (OBJECT_SIZE,), each with its Jacobian by both.

    The Jacobians are (T, R, 3 + OBJECT_SIZE).
    """
    shared = np.zeros((1, SHARED_SIZE))
    shared[0, CONTACT_SIZE:] = values
    at = Values(model, np.zeros((1, 1, 3)), pose[None, None].copy(), shared, np.zeros((1, 1, 2)), np.ones(1))
    found: list[tuple[Linear, Array]] = []
    for factor, terms in given:
        linear = factor.linearise(at, terms)
        jacobian, ((in_step, in_shared), (of_step, of_shared)) = linear.jacobian[0], factor.columns
        every = np.zeros((*jacobian.shape[:2], STEP_SIZE + SHARED_SIZE))
        every[..., in_step : in_step + of_step] = jacobian[..., :of_step]
        every[..., STEP_SIZE + in_shared : STEP_SIZE + in_shared + of_shared] = jacobian[..., of_step:]
        found.append(
            (linear, np.concatenate([every[..., IN_STEP[SENSOR]], every[..., STEP_SIZE + CONTACT_SIZE :]], axis=-1))
        )
    return found
