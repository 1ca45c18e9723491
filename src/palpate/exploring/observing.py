"""Observation of a contact: the curve passes through the tip's centre, along the direction of touch."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array, Complex, Integers
from palpate.exploring.curve import Course, Waves, waves
from palpate.exploring.rows import CENTER, CENTER_IN_OBJECT, CURVE, Place, Rows


@dataclass(frozen=True)
class _Settings:
    """Settings of an observation."""

    distance: float = 2e-3
    """Deviation of a tip's centre from the curve [m]: indentation, and forms that harmonics cannot draw."""
    farthest: float = 4.0
    """Square of the standardised innovation from which an observation counts less, as it does at inner corners."""
    nearest: float = 1e-3
    """Least distance of a tip's centre from the pole [m]: at the pole itself, inside of the object, it has no angle."""
    straight: float = 0.3
    """Deviation of the bend of a side that is expected to be straight; that of a circle is 1."""
    bent: float = 1.0
    """Square of the standardised bend from which a place is a corner, or bent, and not straight."""


_SETTINGS = _Settings()


def observe(rows: Rows, tip: complex, direction: float, deviation: float) -> None:
    """Take a contact: centre of the tip in the world [m], inward normal's angle there [rad] and its deviation."""
    seen = _seen(rows, tip)
    logarithm, slope, bend = seen.course
    steepness = 1.0 / (1.0 + slope**2)
    outward = direction + np.pi - rows.mean[:, Place.YAW]  # angle of the outward normal in the object frame
    off = np.log(seen.radius) - logarithm
    off_angle = np.angle(np.exp(1j * (seen.angle - outward - np.arctan(slope))))
    innovation = np.column_stack((off, off_angle))
    by = np.zeros((len(off), 2, CURVE.stop))
    for axes, place_change in seen.changes:
        change = place_change / seen.radius * np.exp(-1j * seen.angle)
        by[:, 0, axes] = change.real - slope * change.imag
        by[:, 1, axes] = (1.0 - bend * steepness) * change.imag
    by[:, 1, Place.YAW] += 1.0
    by[:, 0, CURVE] = -seen.rows.value
    by[:, 1, CURVE] = -steepness[:, None] * seen.rows.slope
    of_radius = np.square(_SETTINGS.distance / seen.radius) / steepness  # the distance is across the curve
    noise = np.column_stack((of_radius, np.full(len(off), deviation**2)))
    every = np.arange(len(off))
    rows.weigh(_correct(rows, every, innovation, by, noise))
    straight = np.flatnonzero(rows.is_straight)
    if len(straight):
        _straighten(rows, straight, tip)


def _straighten(rows: Rows, straight: Integers, tip: complex) -> None:
    """Expect no bend at the place of a contact in the rows that say so, unless it is clearly bent or known already."""
    seen = _seen(rows, tip)
    bend_by = np.zeros((len(straight), 1, CURVE.stop))
    slope = seen.course.slope[straight]
    bend = 1.0 + slope**2 - seen.course.bend[straight]  # 0 for a straight line, 1 for a circle about the pole
    bend_by[:, 0, CURVE] = 2.0 * slope[:, None] * seen.rows.slope[straight] - seen.rows.bend[straight]
    covariance = rows.covariance[straight]
    known = (bend_by @ covariance @ bend_by.transpose(0, 2, 1))[:, 0, 0]
    noise = _SETTINGS.straight**2
    is_open = (known > noise) & (bend**2 < _SETTINGS.bent * (known + noise))
    chosen = straight[is_open]
    if len(chosen):
        _correct(rows, chosen, bend[is_open, None], bend_by[is_open], np.full((len(chosen), 1), noise))


@dataclass(frozen=True, eq=False)
class _Seen:
    """The tip's centre as the pole of each row sees it."""

    radius: Array
    """Distance from the pole (B,) [m]."""
    angle: Array
    """Angle in the object frame (B,) [rad]."""
    rows: Waves
    """Rows of the curve at these angles."""
    course: Course
    """Course of the curve there, (B,) each."""
    changes: tuple[tuple[int, Complex], ...]
    """Change of the centre in the object frame with each variable of the pose: its place in a row and (B,), complex."""


def _seen(rows: Rows, tip: complex) -> _Seen:
    """Return the tip's centre, whose place in the world is given [m], as each row sees it."""
    back = rows.rotation.conjugate()
    from_center = back * (tip - rows.center)
    place = from_center + rows.center_in_object - rows.pole
    angle = np.angle(place)
    waves_there = waves(angle)
    coefficients = rows.mean[:, CURVE]
    drawn = rows.base.at(angle)
    course = Course(*(base + _along(each, coefficients) for base, each in zip(drawn, waves_there, strict=True)))
    changes = (
        (CENTER.start, -back),
        (CENTER.start + 1, -1j * back),
        (Place.YAW, -1j * from_center),
        (CENTER_IN_OBJECT.start, np.ones_like(back)),
        (CENTER_IN_OBJECT.start + 1, np.full_like(back, 1j)),
    )
    radius = np.maximum(np.abs(place), _SETTINGS.nearest)
    return _Seen(radius, angle, waves_there, course, changes)


def _along(rows: Array, coefficients: Array) -> Array:
    """Return the products of rows and coefficients, (B,)."""
    return (rows * coefficients).sum(axis=1)


def _correct(rows: Rows, chosen: Integers, innovation: Array, by: Array, noise: Array) -> Array:
    """Correct chosen rows by innovations (B, K), their derivatives (B, K, V) and variances (B, K).

    An innovation that is too large has its variance raised until it is at the limit. Returns logarithms of
    likelihoods (B,).
    """
    covariance = rows.covariance[chosen]
    gained = covariance @ by.transpose(0, 2, 1)
    predicted = by @ gained
    count = innovation.shape[1]
    every = np.arange(count)
    least = np.square(innovation) / _SETTINGS.farthest
    predicted[:, every, every] = np.maximum(predicted[:, every, every] + noise, least)
    inverse = np.linalg.inv(predicted)
    gain = gained @ inverse
    rows.mean[chosen] -= (gain @ innovation[:, :, None])[:, :, 0]
    corrected = covariance - gain @ gained.transpose(0, 2, 1)
    # What rounding leaves of asymmetry would grow with every observation, and undo the covariance within minutes.
    rows.covariance[chosen] = 0.5 * (corrected + corrected.transpose(0, 2, 1))
    distance = (innovation[:, None, :] @ inverse @ innovation[:, :, None])[:, 0, 0]
    return -0.5 * (distance + np.log(np.linalg.det(predicted)))
