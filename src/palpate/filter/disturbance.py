"""When pushing is in doubt, for something else may have moved the object, and what may have happened then.

In each hypothesis nothing of pushing holds for some steps, and the object slid over the sensor by another length, on a
contact that holds as well as thought or is more slippery.
"""

import numpy as np

from palpate.config import Priors
from palpate.errors import EstimationError
from palpate.filter.contact_hypotheses import LOG_UNLIKELY
from palpate.filter.estimator import Estimator
from palpate.filter.weighing import SLIPPERY, Hypothesis
from palpate.graph.values import Knock

_ALARMS = (("relative_pose", 5, 0.13), ("direction", 5, 1.0), ("direction", 30, 0.05), ("sticking", 5, 30.0))
"""Factor, steps, and its mean square error [variances] over them from which touch and pushing contradict each other.
Undisturbed, pairs reach 0.16 in a thousandth of all frames and directions 0.5 in a tenth of all recordings; over a
second an error of a fifth of a standard deviation is systematic, for independent ones would cancel in the estimate."""
_DOUBT = "direction", 30, 0.025
"""The same from which other answers are looked at: half of it. Looked at in vain they cost time and hardly the
estimate, but from a quarter on most of a good run is ambiguous."""
_COSTLY = 5, 3.0
"""Steps, and what all that is measured costs in them from which pushing is in doubt. Undisturbed it is 2.8 at most in
12,000 frames of simulated and real pushes, and a hand that moves the object along its face shows in no factor alone."""
BACK, AHEAD = 10, 6
"""Steps before an alarm and after it in which a hand may move the object."""
ALARM_DEAD_STEPS = BACK + AHEAD
"""Steps after an alarm in which another is of the same hand."""
SPREAD = 0.012
"""[m] by which it slides over the sensor more or less."""
_SLIDES = 0.0, 0.018, -0.018, 0.036, -0.036  # [m] by which it slides

STILL_GOING_ON = Knock(0.0, SPREAD / np.sqrt(BACK))
"""What may happen in a step in which a hand moves the object on."""


def is_contradicted(estimator: Estimator, steps: int) -> bool:
    """Return whether touch and pushing contradict each other, so many steps after a contact began."""
    count, limit = _COSTLY
    if steps >= count and estimator.costs()[-count:, 0].sum() > limit:
        return True
    return any(_is_worse(estimator, steps, alarm) for alarm in _ALARMS)


def is_doubtful(estimator: Estimator, steps: int) -> bool:
    """Return whether they do, or fit one another so badly that other answers may be as good."""
    return _is_worse(estimator, steps, _DOUBT) or is_contradicted(estimator, steps)


def _is_worse(estimator: Estimator, steps: int, alarm: tuple[str, int, float]) -> bool:
    name, count, limit = alarm
    return steps >= count and estimator.mean_square(name, count) > limit


def knock_hypotheses(one: Hypothesis, steps: int, priors: Priors) -> list[Hypothesis]:
    """Return the hypotheses that something else moved the object in the last steps, of so many in this contact."""
    found: list[Hypothesis] = []
    first = max(steps - BACK, 1)
    grips = (None,) if one.slippery or priors.grip[1] <= SLIPPERY[1] else (None, SLIPPERY)
    for grip in grips:
        for slid in _SLIDES:
            try:
                estimator = one.estimator.knocked(steps - first, (slid, SPREAD), grip)
            except EstimationError:
                continue
            log_prior = one.log_prior - LOG_UNLIKELY - np.log(len(grips))
            knocked = Hypothesis(
                estimator,
                log_prior,
                without_pushing=[*one.without_pushing, (first, steps)],
                knock_steps_left=AHEAD,
                next_alarm_from=steps + ALARM_DEAD_STEPS,
                slippery=one.slippery or grip is not None,
            )
            found.append(knocked)
    return found
