"""Disturbances: alarms that something else may have moved the object, and the hypotheses of how far it slid."""

import numpy as np
from numpy.typing import NDArray

from palpate.graph.window import Window

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_ALARMS = (("turn", 5, 0.13), ("direction", 5, 1.0), ("direction", 30, 0.05), ("sticking", 5, 30.0))
"""Factor, steps, and the mean square error over them [variances] at which touch and pushing contradict each other.
The limit of turns matters for true ones; those of the touch models, stated far less exactly, do not reach it.
Undisturbed, directions reach 0.5 in a tenth of all recordings; over a second an error of a fifth of a standard
deviation is systematic, since independent ones would cancel in the estimate."""
_SUSPICION = "direction", 30, 0.025
"""The same for a suspicion: half of it, at which other hypotheses cost time but hardly change the estimate. From a
quarter on most of a good run would be ambiguous."""
_COSTLY = 5, 3.0
"""Steps, and the cost of their measurements, that are an alarm. Undisturbed the cost is at most 2.8 in 12 000 frames of
simulated and real pushes; a hand that moves the object along its face shows in no single factor."""
BACK, AHEAD = 10, 6
"""Steps before and after an alarm in which a hand may move the object."""
SPREAD = 0.012
"""Standard deviation of the object's slide over the sensor [m]."""
SLIDES = np.array([0.0, 0.018, -0.018, 0.036, -0.036])
"""Slides over the sensor that become hypotheses [m]."""
STILL_GOING_ON = np.array([0.0, SPREAD / np.sqrt(BACK)])
"""Slide in a step in which a hand still moves the object: mean and standard deviation [m]."""


def detects_disturbance(window: Window, steps: int) -> Flags:
    """Return True (B,) where touch and pushing contradict each other, `steps` after the contact began."""
    count, limit = _COSTLY
    found = np.zeros(window.rows, np.bool_)
    if steps >= count:
        found |= window.costs()[:, -count:, 0].sum(axis=1) > limit
    for alarm in _ALARMS:
        found |= _is_worse(window, steps, *alarm)
    return found


def suspects_disturbance(window: Window, steps: int) -> Flags:
    """Return True (B,) where they contradict each other, or fit so badly that other hypotheses may fit as well."""
    return _is_worse(window, steps, *_SUSPICION) | detects_disturbance(window, steps)


def _is_worse(window: Window, steps: int, name: str, count: int, limit: float) -> Flags:
    if steps < count:
        return np.zeros(window.rows, np.bool_)
    return window.mean_squares(name, count) > limit
