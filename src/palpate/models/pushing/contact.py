"""The sensor's surface lies on the outline, except for an indentation (paper Eq. 11, two-sided)."""

from typing import Any

from palpate.estimation.factor import Factor
from palpate.manifolds.functions import Scalar

SUNK_SHARE = 0.2
"""Error of how far the tip has sunk in from image to image, as a share of it."""


def residual(now: Any, support: Any, depth: Scalar, outline_scale: Scalar, sinking: Scalar) -> tuple[Scalar]:
    """Return `gap + depth + sinking sunk - scale extent` [m], positive if sensor and object are too far apart.

    The extent is the distance of the outline from its centroid along its normal: an object that is larger than its
    outline by a small relative scale extends farther by that share.
    """
    touch = now.touch
    extent = touch.normal.dot(touch.point - support.center) - touch.gap
    return (touch.gap + depth + sinking * now.sunk - outline_scale * extent,)


def variance(now: Any, noise: Any) -> tuple[Scalar]:
    """Return the variance of outline, gel and mounting together, and of the imprint as a measure of indentation."""
    return (noise.deviation**2 + (SUNK_SHARE * now.sunk) ** 2,)


def applies(now: Any) -> Any:
    """Return True while the sensor touches."""
    return now.is_resting < 0.5


CONTACT = Factor("contact", residual, variance, steps="every", kernel="each", applies=applies)
