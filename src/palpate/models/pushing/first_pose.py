"""Belief about the object at the beginning of a contact: a joint Gaussian on its pose and its variables.

It takes the place of the paper's rest factor once the past is marginalised.
"""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar


def residual(now: Any, belief: Any) -> tuple[Scalar, ...]:
    """Return `Log(believed^-1 e g^-1)` [m, m, rad], and the differences of the object's variables."""
    world_T_object = now.e.compose(now.g.inverse())
    return *belief.pose.between(world_T_object).log(), *belief.differences


FIRST_POSE = Factor("first_pose", residual, steps="first", role="belief")
