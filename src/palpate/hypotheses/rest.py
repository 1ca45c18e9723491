"""Measurements of the object between contacts, while it rests."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.hypotheses.bank import Hypotheses
from palpate.hypotheses.consistency import ConsistencyMonitor
from palpate.models.pushing.graph import Graph
from palpate.models.pushing.measurements import Step, timely
from palpate.models.pushing.rest_window import RestWindow, own_measure_pose
from palpate.types.measurements import Measurement, ObjectPose, OwnMeasurement


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
    graph: Graph,
) -> MeasuredAtRest:
    """Return the hypotheses with measurements of the resting object.

    Those of its pose are combined with a belief that is inflated by the motion that something may have given it.
    Measurements may have any time between the first frame at rest and this one, `times` [s]. Raises EstimationError if
    there is no solution.
    """
    usable = [one for one in timely(measurements, times) if isinstance(one, ObjectPose | OwnMeasurement)]
    poses = [measurement for measurement in usable if isinstance(measurement, ObjectPose)]
    step = Step(np.zeros(3), usable, times=times[-1:])
    whole = rows.whole_belief
    displaced = whole.inflated(monitor.displacement_covariance(rows))
    tested = replace(rows, belief=displaced, unobservable_yaw=np.zeros(len(rows)))
    tested = monitor.test_object_poses(tested, [displaced.pose] * len(poses), poses)
    measures_pose = bool(poses) or own_measure_pose(whole, step, graph.own, graph.compiled)
    prior = whole
    if measures_pose:  # the object may have been found elsewhere
        prior = displaced.inflated(monitor.contradiction_covariance(rows))
        tested = replace(tested, displacement=np.zeros(len(rows)))
    posterior = prior
    if usable:
        posterior = RestWindow(graph, prior, step).belief()
    return MeasuredAtRest(replace(tested, belief=posterior), measures_pose)
