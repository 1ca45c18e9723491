"""Compiling everything before a robot's loop begins: a short push through every compiled function."""

import logging
from functools import cache

import numpy as np

from palpate.config import NoiseSettings
from palpate.filter.belief import Prior
from palpate.filter.contact_poses import starts
from palpate.geometry.shapes import Disc
from palpate.graph.compiled import all_is_compiled, is_cached
from palpate.graph.contact_geometry import contact_model
from palpate.graph.factor_list import make_factors
from palpate.graph.smoother import IN_A_WINDOW, SmootherName, make_smoother
from palpate.graph.window import Window
from palpate.types.measurements import ContactDirection, ContactPlace, ObjectPose, RelativePoses, Turn
from palpate.types.sensor import POINT

logger = logging.getLogger(__name__)


@cache
def warm_up(smoother: SmootherName = "fixed-lag") -> None:
    """Compile the estimator, or load what was compiled before; once in a process."""
    if not is_cached():
        logger.warning("compiling the estimator: once for this version, some 20 s")
    settings = NoiseSettings()
    model = contact_model(Disc(0.05), POINT)
    factors = make_factors(settings, model)
    deviation = np.concatenate([settings.first_pose.deviation, settings.priors.deviation])
    prior = Prior(np.zeros(3), settings.priors.mean, np.diag(np.square(deviation)))
    pair = RelativePoses(np.array([2]), np.zeros((1, 3)), np.eye(3)[None])
    said = [ContactDirection(0.0, 1e-4), ContactPlace(0.0, 1.0), Turn(0.0, 1e-4), ObjectPose(np.zeros(3), np.eye(3))]
    for with_pairs in (False, True):
        window = Window(factors, model, [prior], np.array([-0.05, 0.0, 0.0]), said, lag=3)
        window.costs()  # of one step, which is compiled apart
        for step in range(1, 5):
            pairs = [pair] if with_pairs and step == 2 else []
            window.add(np.array([1e-4 * step - 0.05, 0.0, 0.0]), [*said, *pairs], 0.1 * step)
        window.last_errors()
        window.mean_square("sticking", 3)
        window.knocked(2, (1e-3, 0.01), ((0.4, 0.1), (0.15, 0.05))).costs()
        window.pushing_angle()
    starts(prior.loosened(0.01 * np.eye(3)), model, np.array([-0.05, 0.0, 0.0]), said)
    if smoother not in IN_A_WINDOW:
        other = make_smoother(smoother, settings, model)(prior, np.array([-0.05, 0.0, 0.0]), said, 0.0)
        for step in range(1, 4):
            other.add(np.array([1e-4 * step - 0.05, 0.0, 0.0]), said, 0.1 * step)
        other.last_errors()
    all_is_compiled()
