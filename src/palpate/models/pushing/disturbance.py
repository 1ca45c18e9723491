"""A step in which something else, such as a hand, moves the object: it takes the place of the pushing model.

The object slides along the outline by a guessed length, stays in touch, and turns only so far: a hand turns an object
by some tenths of a radian while sliding it by a centimetre.
"""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar
from palpate.models.pushing.balance import turn
from palpate.models.pushing.sticking import slide

ACROSS = 2e-3
"""[m] Standard deviation of the object's motion across the outline in a step: the sensor stays in touch."""
TURN_TO_SLIDE = 3.0
"""Ratio of c times the turn of a disturbed object to its slide: a hand turns more than it slides."""


def slide_residual(before: Any, now: Any) -> tuple[Scalar, Scalar]:
    """Return the slide along the outline, counter-clockwise, less the guessed one, and that across it [m]."""
    slid = slide(before, now)
    along = now.touch.normal.turned_left()
    return along.dot(slid) - now.slide, along.cross(slid)


def slide_variance(now: Any) -> tuple[Scalar, Scalar]:
    """Return the variances [m^2]."""
    return now.spread**2, ACROSS**2


def turn_residual(before: Any, now: Any, support: Any) -> tuple[Scalar]:
    """Return `-c^2 omega` [m^2], with the nominal c."""
    return (-(support.radius**2) * turn(before, now),)


def turn_variance(now: Any, support: Any) -> tuple[Scalar]:
    """Return the variance [m^4] of a turn that goes with the slide."""
    return ((TURN_TO_SLIDE * support.radius * now.spread) ** 2,)


def applies(now: Any) -> Any:
    """Return True in disturbed steps."""
    return now.spread > 0.0


DISTURBED_SLIDE = Factor(
    "disturbed_slide", slide_residual, slide_variance, steps="pair", role="process", applies=applies, is_compared=False
)
DISTURBED_TURN = Factor(
    "disturbed_turn",
    turn_residual,
    turn_variance,
    steps="pair",
    settings="balance",
    kernel="each",
    role="process",
    applies=applies,
    is_compared=False,
)
