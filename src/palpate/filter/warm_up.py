"""Compile or load all kernels before a robot's loop begins, by a short simulated push."""

import logging
from functools import cache

import numpy as np

from palpate.config import NoiseSettings
from palpate.filter.contact_hypotheses import FirstContact, poses_in_contact
from palpate.geometry.shapes import Disc
from palpate.graph import block_tridiagonal
from palpate.graph.belief import Belief
from palpate.graph.compiled import is_cached
from palpate.graph.contact_geometry import contact_model
from palpate.graph.factor_list import make_factors
from palpate.graph.window import Window
from palpate.types.measurements import ContactDirection, ContactPlace, ObjectPose, Turn
from palpate.types.sensor import POINT

logger = logging.getLogger(__name__)


@cache
def warm_up() -> None:
    """Compile the estimator, or load what was compiled before; once in a process."""
    if not is_cached(block_tridiagonal._solve):
        logger.warning("compiling the estimator: once for this version, some 20 s")
    settings, model = NoiseSettings(), contact_model(Disc(0.05), POINT)
    deviation = np.concatenate([settings.first_pose.deviation, settings.priors.deviation])
    belief = Belief(np.zeros((1, 3)), settings.priors.mean[None], np.diag(np.square(deviation))[None])
    touch = [ContactDirection(0.0, 1e-4), ContactPlace(0.0, 1.0), Turn(0.0, 1e-4), ObjectPose(np.zeros(3), np.eye(3))]
    sensor_pose = np.array([-0.05, 0.0, 0.0])
    window = Window(make_factors(settings, model), model, belief, sensor_pose, touch, lag=3)
    window.costs()
    for step in range(1, 5):
        window.add(sensor_pose + 1e-4 * step, touch, 0.1 * step)
    window.take([0, 0])
    window.disturb([1], 2, np.array([1e-3]), 0.01)
    window.mean_squares("sticking", 3)
    window.costs()
    window.last_errors()
    window.force_angle(0)
    poses_in_contact(belief.inflated(0.01 * np.eye(3)), model, FirstContact(sensor_pose, touch), 1.0)
