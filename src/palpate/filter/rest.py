"""Measurements of the object between contacts, while it rests.

The graph then has one pose, the object's, and the object's variables.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.filter.consistency import ConsistencyMonitor
from palpate.filter.hypotheses import Hypotheses
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.measurements import Step, timely
from palpate.models.pushing.own_measurements import OwnMeasurements
from palpate.models.pushing.rest_window import RestWindow, own_measure_pose
from palpate.types.measurements import Measurement, ObjectPose, OwnMeasurement


def measured_at_rest(
    rows: Hypotheses,
    measurements: Sequence[Measurement],
    times: tuple[float, float],
    monitor: ConsistencyMonitor,
    own: OwnMeasurements,
    settings: NDArray[np.void],
    model: ContactModel,
) -> tuple[Hypotheses, bool]:
    """Return the hypotheses with measurements of the resting object, and True if these are of its pose.

    Then they are combined with a belief that is inflated by what may have moved it. The object rests since the first of
    the times [s], and measurements may have any time from then to the second, now. Raises EstimationError if there is
    no solution.
    """
    whole = rows.whole_belief
    usable = [one for one in timely(measurements, times) if isinstance(one, ObjectPose | OwnMeasurement)]
    poses = [measurement for measurement in usable if isinstance(measurement, ObjectPose)]
    step = Step(np.zeros(3), usable, times=times[-1:])
    prior = whole.inflated(monitor.displacement_covariance(rows))
    tested = replace(rows, belief=prior, unobservable_yaw=np.zeros_like(rows.unobservable_yaw))
    monitor.test_object_poses(tested, [prior.pose] * len(poses), poses)
    is_of_pose = bool(poses) or own_measure_pose(whole, step, own)
    if is_of_pose:  # the object may have been found elsewhere
        whole = prior.inflated(monitor.contradiction_covariance(rows))
        tested.displacement = np.zeros_like(rows.displacement)
    tested.belief = RestWindow(settings, model, whole, step, own).belief() if usable else whole
    return tested, is_of_pose
