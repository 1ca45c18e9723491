"""Balance of force and torque on the ellipsoidal limit surface (paper Eq. 7, torque row; Lynch 1992, Zhou 2017).

On the limit surface the pushing force points along the motion of the centre of friction, and its torque is in balance
with the object's turn. It holds while sliding, too.
"""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar, exp, wrap
from palpate.manifolds.planar import Vector
from palpate.models.pushing.sticking import applies


def center_of_friction(support: Any, friction_center: Vector) -> Vector:
    """Return the centre of friction [m], object frame."""
    return support.center + support.radius * friction_center


def motion(before: Any, now: Any, center: Vector) -> Vector:
    """Return the motion of a point of the object in a step, `k - g1 e1^-1 e0 g0^-1 k` [m], object frame at its end."""
    in_world = before.e.act(before.g.act_back(center))
    return center - now.g.act(now.e.act_back(in_world))


def turn(before: Any, now: Any) -> Scalar:
    """Return the turn of the object in a step [rad]."""
    return wrap(now.e.angle - before.e.angle - now.g.angle + before.g.angle)


def residual(before: Any, now: Any, support: Any, friction_ratio: Scalar, friction_center: Vector) -> tuple[Scalar]:
    """Return `p x v - c^2 omega` [m^2].

    v is the motion of the centre of friction in the step, p the pushed point seen from there, and omega the object's
    turn; c^2 is that of the assumed pressure distribution times `exp(friction_ratio)`.
    """
    center = center_of_friction(support, friction_center)
    torque = (now.touch.point - center).cross(motion(before, now, center))
    c_squared = support.radius**2 * exp(friction_ratio)
    return (torque - c_squared * turn(before, now),)


def variance(now: Any, noise: Any, support: Any) -> tuple[Scalar]:
    """Return the variance [m^4] of the limit surface's form and, on several tips, of the load's place."""
    form = noise.still**2 + (noise.share * now.moved * support.radius) ** 2
    load = (noise.load * support.span * now.moved) ** 2
    return (form + load,)


BALANCE = Factor("balance", residual, variance, steps="pair", kernel="each", role="process", applies=applies)
