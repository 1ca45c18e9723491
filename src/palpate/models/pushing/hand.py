"""The model of pushing with several fingers, each a sensor of its own: one object, and a contact for each finger.

The factors of a contact hold at each finger that touches, with the variables of that finger; those of the object hold
at the hand as a whole, whose contact geometry `hand_step` makes of those that touch. The first finger has the variables
of a single sensor, at their places; those of the others follow.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

from palpate.estimation.factor import Factor
from palpate.estimation.model import Model
from palpate.estimation.variable import Variable
from palpate.manifolds.functions import Scalar, larger
from palpate.models.pushing import variables
from palpate.models.pushing.balance import BALANCE
from palpate.models.pushing.contact import CONTACT
from palpate.models.pushing.corner import CORNER, nearest_corner_of
from palpate.models.pushing.direction import DIRECTION
from palpate.models.pushing.disturbance import DISTURBED_SLIDE
from palpate.models.pushing.model import MODEL
from palpate.models.pushing.place import PLACE
from palpate.models.pushing.sticking import STICKING
from palpate.models.pushing.sticking import variance as variance_inside
from palpate.models.pushing.turn import TURN

_VARIABLES = (
    variables.TURN_OFFSET,
    variables.CORNER_BIAS,
    variables.SINKING,
    variables.DIRECTION_BIAS,
    variables.DIRECTION_SCALE,
    variables.PLACE_BIAS,
    variables.DEPTH,
)
"""Variables that each finger has for itself."""
_FACTORS = (STICKING, DISTURBED_SLIDE, CONTACT, DIRECTION, PLACE, TURN, CORNER)
"""Factors that hold at each finger."""


LOAD_SHARE = 4.0
"""Error of the place of the load between fingers that touch, as a share of the distance between them. It is the same
over hundreds of steps, so that a smaller number would learn a centre of friction from it."""

PINCH_SHARE = 0.4
"""Slide at fingers that press the object between them, as a share of their way since they do. Their force is that of
the grip, not of the push, and tells nothing of the friction cones: they hold the object, or it stays behind for all of
the way, which is then 2.5 standard deviations."""


def _variance_of_balance(now: Any, noise: Any, support: Any) -> tuple[Scalar]:
    """Return the variance [m^4] of the limit surface's form, and of how the fingers that touch share the load."""
    form = noise.still**2 + (noise.share * now.moved * support.radius) ** 2
    load = (LOAD_SHARE * now.apart * now.moved) ** 2
    return (form + load,)


def _variance_of_sticking(now: Any, noise: Any) -> tuple[Scalar, Scalar]:
    """Return the variance of a slide [m^2]; see `sticking.variance`, and PINCH_SHARE.

    A grip that slides goes on to slide, so that the variance of a pinch is the growth of that of its whole way. One for
    each step alone would shrink with the rate of frames.
    """
    inside, _ = variance_inside(now, noise)
    growth = now.moved * (2.0 * now.way - now.moved)
    pinched = noise.still**2 + PINCH_SHARE**2 * now.pinched * now.touching * growth
    both = larger(inside, pinched)
    return both, both


@cache
def variable_of(variable: Variable, finger: int) -> Variable:
    """Return the variable that a finger of this number has in place of the first one's; shared ones are their own."""
    if finger == 0 or variable not in _VARIABLES:
        return variable
    return replace(variable, name=f"{variable.name}_{finger}", finger=finger, base=variable.name)


def is_of_finger(variable: Variable) -> bool:
    """Return True for a variable that each finger has for itself."""
    return bool(variable.base) or variable in _VARIABLES


@cache
def hand_model(fingers: int) -> Model:
    """Return the model of pushing with so many fingers, two or more."""
    first = tuple(_of_first(factor) for factor in MODEL.factors)
    hand = replace(
        MODEL,
        factors=first,
        step_numbers=tuple(
            name for name in (*MODEL.step_numbers, "touching", "apart", "pinched", "way") if name != "sunk"
        ),
        fingers=fingers,
        finger_numbers=("sunk",),
    )
    others = range(1, fingers)
    return hand.extended(
        variables=[variable_of(variable, finger) for finger in others for variable in _VARIABLES],
        factors=[_of_finger(factor, finger) for finger in others for factor in _FACTORS],
    )


def names_of(factors: Iterable[str], model: Model) -> list[str]:
    """Return the names of some factors of a single sensor as a model has them, those of each of its fingers."""
    suffixes = ["", *(f"_{finger}" for finger in range(1, model.fingers))]
    return [f"{name}{suffix}" for suffix in suffixes for name in factors]


def _of_first(factor: Factor) -> Factor:
    """Return a factor of a single sensor for the first finger, or for the hand."""
    if factor is BALANCE:
        return replace(factor, variance=_variance_of_balance)
    return replace(_of_finger(factor, 0), name=factor.name) if factor in _FACTORS else factor


def _of_finger(factor: Factor, finger: int) -> Factor:
    """Return a factor of a single sensor for a finger."""
    return replace(
        factor,
        variance=_variance_of_sticking if factor is STICKING else factor.variance,
        name=f"{factor.name}_{finger}",
        finger=finger,
        settings=factor.settings or factor.name,
        lookup=nearest_corner_of if factor is CORNER else factor.lookup,
    )
