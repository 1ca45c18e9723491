"""Choice of the next push: the place of a learnt outline at which a contact is expected to say most."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array, Flags
from palpate.checks import checked_number
from palpate.errors import EstimationError, SettingError
from palpate.geometry import se2
from palpate.types.estimate import Estimate
from palpate.types.outline import Outline


@dataclass(frozen=True)
class _Touch:
    """A contact as it is expected."""

    deviation: float = 1e-3
    """[m] Standard deviation of what a contact measures across the outline, that of `NoiseSettings.contact`."""
    patch: float = 0.01
    """[m] Length of the outline that a contact tells of."""
    middle: float = 0.02
    """Share of what is not known all around, by which the middle of a wide part is preferred to its ends."""
    overlap: float = 1e-3
    """[m] Overlap of a tip with another part of the outline from which it does not reach a place."""


_TOUCH = _Touch()


@dataclass(frozen=True, eq=False)
class NextPush:
    """A place to push next."""

    point: Array
    """Place on the outline (2,) [m]: of an estimate in the world, of an outline in the object frame."""
    direction: Array
    """Direction of the push, into the object across its outline, a unit vector (2,) in the same frame."""
    information: float
    """Information on the outline that a contact there is expected to give [nats]."""


def next_push(known: Estimate | Outline, tip_radius: float = 0.0) -> NextPush:
    """Return the place where a contact is expected to say most of the outline, by an estimate or its outline alone.

    That is where the band is widest, of all places that a round tip of this radius [m] reaches without touching the
    outline elsewhere. What else is in the way, and how to get there, is left to the robot. Raises EstimationError for
    an estimate of a known outline, or if no place is reached, SettingError for another radius.
    """
    outline = known if isinstance(known, Outline) else getattr(known, "outline", None)
    if outline is None:
        raise EstimationError("next_push needs an estimate with an outline: one of palpate.Unknown or palpate.Sketch")
    radius = checked_number(tip_radius, 0.0, 1.0)
    if radius is None:
        raise SettingError(f"tip_radius is {tip_radius!r}; allowed is a length from 0 to 1 m")
    is_reached = _reached(outline, radius)
    if not is_reached.any():
        allowed = "allowed is a smaller one"
        raise EstimationError(f"no place of the outline is reached by a tip of radius {radius:g} m; {allowed}")
    information = _information(outline)
    best = int(np.argmax(np.where(is_reached, information + _TOUCH.middle * _around(information), -1.0)))
    pose = known.pose if isinstance(known, Estimate) else np.zeros(3)
    point = se2.transform(pose, outline.points[best])
    direction = -se2.rotation(pose[2]) @ outline.normals[best]
    return NextPush(point, direction, float(information[best]))


def _information(outline: Outline) -> Array:
    """Return the information that a contact at each point gives (N,) [nats]: half the log of variance over its own."""
    apart = np.hypot(*(np.roll(outline.points, -1, axis=0) - outline.points).T)
    count = min(max(round(_TOUCH.patch / float(apart.mean())), 1) | 1, len(outline.points))
    around = np.arange(count) - count // 2
    places = (np.arange(len(outline.points))[:, None] + around) % len(outline.points)
    variance = np.square(outline.deviation)[places].mean(axis=1)
    return 0.5 * np.log1p(variance / _TOUCH.deviation**2)


def _around(values: Array) -> Array:
    """Return means of values (N,) around an outline, which count most at each point and not opposite of it."""
    weight = (0.5 + 0.5 * np.cos(np.arange(len(values)) * (2.0 * np.pi / len(values)))) ** 4
    spectrum = np.fft.rfft(values) * np.fft.rfft(weight / weight.sum())
    return np.fft.irfft(spectrum, len(values))


def _reached(outline: Outline, radius: float) -> Flags:
    """Return flags (N,) of the points that a round tip reaches from outside."""
    centers = outline.points + radius * outline.normals
    return outline.signed_distance(centers) >= radius - _TOUCH.overlap
