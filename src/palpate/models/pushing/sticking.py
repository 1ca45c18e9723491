"""Sticking: inside the friction cone the sensor's material point stays on the object (paper Eqs. 7 to 10, two rows).

The sensor's material point m that touches the outline point p at step 1 was at `g0 m` at step 0. Rolling by a small
angle keeps the point in place up to r angle^2 / 2. This is the paper's `V + omega x p - Vp` without linearising the
rotation, which would let the object drift by omega^2 p / 2 a step.

At the cone's edge it slides, and only to the side of the force.
"""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar, side
from palpate.manifolds.planar import Vector


def slide(before: Any, now: Any) -> Vector:
    """Return the slide of the object along the sensor in a step, `g0 m - p` [m], in the object frame."""
    return before.g.act(now.touch.material) - now.touch.point


def residual(before: Any, now: Any, noise: Any) -> tuple[Scalar, Scalar]:
    """Return the slide along x and y of the object, less the expected one along the outline [m]."""
    slid = slide(before, now)
    along = now.touch.normal.turned_left()
    expected = noise.expected_share * now.sliding * now.moved
    return slid.x - expected * along.x, slid.y - expected * along.y


def variance(now: Any, noise: Any) -> tuple[Scalar, Scalar]:
    """Return the variances of a slide [m^2], which depend on the angle of the pushing force by `now.sliding`.

    Inside the cone a step slides by a small share of the sensor's motion, at the cone's edge by any amount.
    """
    sticks = noise.still**2 + (noise.share * now.moved) ** 2
    slides = noise.still**2 + (noise.sliding_share * now.moved) ** 2
    both = sticks * (slides / sticks) ** (side(now.sliding) * now.sliding)
    return both, both


def applies(now: Any) -> Any:
    """Return True in steps in which nothing but the sensor moves the object."""
    return now.spread <= 0.0


STICKING = Factor("sticking", residual, variance, steps="pair", kernel="together", role="process", applies=applies)
