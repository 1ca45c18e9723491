"""While the contact slides, the pushing force stays at the edge of the friction cone (Coulomb; Lynch 1992)."""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar, arctan, beyond, exp, side
from palpate.manifolds.planar import Vector
from palpate.models.pushing.balance import center_of_friction, motion

UNLIMITED = 1e300
"""Share from which the factor is off."""


def residual(before: Any, now: Any, support: Any, grip: Scalar, friction_center: Vector) -> tuple[Scalar]:
    """Return the distance of the motion v outside the cone [m], on the side on which the contact slides.

    That is the part of v along the outline, counter-clockwise or clockwise, less friction times its part into it.
    """
    moved = motion(before, now, center_of_friction(support, friction_center))
    inward = -now.touch.normal
    return (side(now.force_angle) * inward.cross(moved) - exp(grip) * inward.dot(moved),)


def variance(now: Any, noise: Any) -> tuple[Scalar]:
    """Return the variance [m^2] of the motion outside the cone."""
    return (noise.still**2 + (noise.share * now.moved) ** 2,)


def weight(now: Any, noise: Any, grip: Scalar) -> Scalar:
    """Return 1 while the force is beyond the edge, 0 inside."""
    return beyond(now.force_angle, arctan(exp(grip)), noise.width)


def applies(now: Any, noise: Any) -> Any:
    """Return True in undisturbed steps, unless the settings turn the factor off."""
    return (now.spread <= 0.0) & (noise.share < UNLIMITED)


FRICTION_CONE = Factor(
    "friction_cone",
    residual,
    variance,
    steps="pair",
    kernel="each",
    role="process",
    weight=weight,
    applies=applies,
    is_compared=False,
)
