"""The yaw of a round object, which no touch tells: put aside before a contact, so that no graph learns it.

A graph would learn it all the same, a little and from nothing, by what was linearised at several yaws.
"""

import math
from dataclasses import replace

import numpy as np

from palpate.filter.belief import Prior
from palpate.filter.contact_poses import is_round
from palpate.graph.contact_geometry import ContactModel

_ENOUGH = 0.05  # [rad] standard deviation that a graph may know of


def put_aside(known: Prior, model: ContactModel) -> tuple[Prior, float]:
    """Return what a contact may begin with, and the variance of yaw [rad^2] that was put aside, if round."""
    variance = float(known.covariance[2, 2])
    if variance <= _ENOUGH**2 or not is_round(model):
        return known, 0.0
    less = np.ones(len(known.covariance))
    less[2] = _ENOUGH / math.sqrt(variance)
    return replace(known, covariance=known.covariance * np.outer(less, less)), variance - _ENOUGH**2


def put_back(known: Prior, variance: float) -> Prior:
    """Return what is known with a variance of yaw [rad^2] that was put aside."""
    return known.loosened(np.diag([0.0, 0.0, variance])) if variance else known
