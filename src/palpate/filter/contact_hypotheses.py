"""What several answers become where a contact begins: another place on the outline in each that is known roughly only.

Once the object was found, a pose that is known roughly is a guess of how far something moved it. What was known then
only says which places are likely, and what touch says of an answer does not count until the contact goes on. A first
pose that is known roughly is no such guess: it holds until the object is found, so that contacts from several sides
add up. What is measured in one of them cannot tell apart the faces of an outline.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.filter.belief import Prior
from palpate.filter.consistency import is_uncertain
from palpate.filter.contact_poses import expected_starts, is_rough, starts
from palpate.filter.estimator import Estimator
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.types.measurements import Measurement

Array = NDArray[np.float64]

LOG_UNLIKELY = 1.0  # log of how many times less likely it is that something happened than that nothing did
_IMPOSSIBLE = 12.0  # the same, at most, of a touch where the object is not
MOST_YOUNG = 20  # ways to begin, at most: all faces of an outline, each at several places
_SAME = np.array([2e-3, 2e-3, 0.02])  # [m, m, rad]


@dataclass(eq=False)
class Beginning:
    """One way in which a contact may begin."""

    of: int
    """Index of the answer that begins it so."""
    log_prior: float
    """Log of how likely it is."""
    prior: Prior | None = None
    """What is known then; None where the answer goes on as it was."""
    is_place: bool = False
    """Whether it is one of several places, so that pushing tells nothing for some steps."""


def ways_to_begin(
    answers: Sequence[tuple[Estimator, float]],
    model: ContactModel,
    sensor_pose: Array,
    measurements: Sequence[Measurement],
) -> list[Beginning]:
    """Return the ways in which a contact begins with an object that was found, likely ones first.

    Answers are estimators and the log of how likely each is; sensor_pose (3,) is the measured world_T_sensor.
    """
    ways: list[Beginning] = []
    for index, (estimator, log_prior) in enumerate(answers):
        prior = estimator.see_first_touch(sensor_pose, measurements)
        places = starts(prior, model, sensor_pose, measurements) if is_rough(prior, model) else []
        ways.append(Beginning(index, log_prior, estimator.unmoved if places else None))
        ways += [Beginning(index, log_prior + likely - LOG_UNLIKELY, at, True) for at, likely in places]
    return sorted(ways, key=lambda one: -one.log_prior)[:MOST_YOUNG]


def ways_to_begin_unfound(
    answers: Sequence[tuple[Estimator, float]],
    model: ContactModel,
    sensor_pose: Array,
    measurements: Sequence[Measurement],
) -> list[Beginning]:
    """Return the same of an object that was not found since its first pose, which was known roughly.

    Each is as likely as it was, times how likely the object is touched as it is. Those at the same pose become one.
    """
    ways: list[Beginning] = []
    for index, (estimator, log_prior) in enumerate(answers):
        prior, unmoved = estimator.see_first_touch(sensor_pose, measurements), estimator.unmoved
        places = expected_starts(prior, model, sensor_pose, measurements)
        as_left = places if not estimator.is_displaced else expected_starts(unmoved, model, sensor_pose, measurements)
        as_expected = log_prior + max(log_sum([likely for _, likely in as_left]), -_IMPOSSIBLE)
        if not is_rough(prior, model):
            ways.append(Beginning(index, as_expected, prior))
            continue
        is_guess = is_uncertain(prior.pose_covariance)  # then one graph does not find it
        if estimator.is_displaced or not places or not is_guess:
            ways.append(Beginning(index, as_expected, unmoved))
        ways += [Beginning(index, log_prior + likely - LOG_UNLIKELY, at, True) for at, likely in places]
    kept: list[tuple[Prior, Beginning]] = []
    for one in sorted(ways, key=lambda one: -one.log_prior):
        assert one.prior is not None
        same = next((other for prior, other in kept if are_near(prior.pose, one.prior.pose)), None)
        if same is not None:
            same.log_prior = log_sum([same.log_prior, one.log_prior])
        elif len(kept) < MOST_YOUNG:
            kept.append((one.prior, one))
    return [one for _, one in kept]


def log_sum(logs: Sequence[float]) -> float:
    """Return the log of the sum of what these are logs of."""
    return float(np.logaddexp.reduce(logs))


def are_near(pose: Array, others: Array) -> NDArray[np.bool_]:
    """Return whether a pose (3,) and each of others (..., 3) are much the same."""
    return np.all(np.abs(se2.log(se2.between(pose, others))) < _SAME, axis=-1)
