"""The sensor's surface lies on the outline, except for an indentation (paper Eq. 11, two-sided)."""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar


def residual(now: Any, support: Any, depth: Scalar, outline_scale: Scalar) -> tuple[Scalar]:
    """Return `gap + depth - scale extent` [m], positive if sensor and object are too far apart.

    The extent is the distance of the outline from its centroid along its normal: an object that is larger than its
    outline by a small relative scale extends farther by that share.
    """
    touch = now.touch
    extent = touch.normal.dot(touch.point - support.center) - touch.gap
    return (touch.gap + depth - outline_scale * extent,)


def variance(noise: Any) -> tuple[Scalar]:
    """Return the variance of outline, gel and mounting together."""
    return (noise.deviation**2,)


def applies(now: Any) -> Any:
    """Return True while the sensor touches."""
    return now.is_resting < 0.5


CONTACT = Factor("contact", residual, variance, steps="every", kernel="each", applies=applies)
