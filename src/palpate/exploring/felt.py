"""Contact as a sensor feels it: which part of its surface is touched, and from which direction.

A round tip is one part. A flat pad is a row of them, as in `models.pushing.contact_geometry`, and what touches it is
either a corner, along the pad's own normal, or a side. The more a side leans, the nearer to an end of the pad is the
middle of its load, so that a place tells a direction as well.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array
from palpate.config import NoiseSettings, TouchSettings
from palpate.models.pushing.contact_geometry import LOAD_LENGTH
from palpate.types.measurements import ContactDirection, ContactPlace, Measurement
from palpate.types.sensor import SensorProfile


@dataclass(frozen=True)
class _Settings:
    """Settings of what is felt."""

    unmeasured: float = 0.25
    """Deviation of a direction that was not measured: a contact is somewhere on the tip [rad]."""
    lean: float = 0.2
    """Deviation of the angle between a flat pad and a side that touches it, before any measurement [rad]."""
    corners: float = 0.5
    """Share of contacts of a flat pad that are with corners."""


_SETTINGS = _Settings()
_APART: Array = np.linspace(-3.0, 3.0, 100)  # an even number, as a load's middle is not defined without a lean
_LEANS: Array = _SETTINGS.lean * _APART
_SIDES: Array = np.exp(-0.5 * np.square(_APART))
_EXPECTED: Array = np.concatenate(
    (
        (1.0 - _SETTINGS.corners) * _SIDES / _SIDES.sum(),
        np.full(len(_APART), _SETTINGS.corners / len(_APART)),
    )
)
"""Weights of sides by their leans, and of corners by their places, before any measurement."""


class Felt(NamedTuple):
    """One contact as it is felt."""

    along: float
    """Place along y of the part that is touched, from the middle of the tip [m]."""
    along_deviation: float
    """Standard deviation of that [m]."""
    direction: float | None
    """Direction of the contact about the centre of that part, sensor frame [rad]; None if nothing tells it."""
    deviation: float
    """Standard deviation of the direction [rad]."""


def is_felt(measurements: Sequence[Measurement]) -> bool:
    """Return True if a direction, or the place on a pad, is among measurements."""
    return any(isinstance(one, ContactDirection | ContactPlace) for one in measurements)


def felt(sensor: SensorProfile, measurements: Sequence[Measurement], noise: NoiseSettings, frames: int) -> Felt:
    """Return the contact of a sensor that measured these, with their noise.

    They stand for a number of frames whose measurements are not used: variances are those of one frame of many.
    """
    directions = [one for one in measurements if isinstance(one, ContactDirection)]
    angle = directions[0].angle if directions else None
    deviation = _SETTINGS.unmeasured
    if directions:
        variance = directions[0].variance / max(frames, 1)
        deviation = _deviation(variance, noise.direction, noise.priors.direction_bias[1])
    if not sensor.flat_width:
        return Felt(0.0, 0.0, angle, deviation)
    places = [one for one in measurements if isinstance(one, ContactPlace)]
    place = (0.0, math.inf)
    if places:
        variance = places[0].variance / max(frames, 1)
        place = (places[0].place, _deviation(variance, noise.place, noise.priors.place_bias[1]))
    direction = (0.0, math.inf) if angle is None else (angle, deviation)
    return _on_pad(sensor, place, direction, noise.direction.floor)


def _deviation(variance: float, noise: TouchSettings, bias: float) -> float:
    """Return the standard deviation of a measurement with its variance, and with what all of them have in common."""
    return math.sqrt(max(noise.share * variance, noise.floor**2) + bias**2)


def _on_pad(sensor: SensorProfile, place: tuple[float, float], direction: tuple[float, float], floor: float) -> Felt:
    """Return the contact on a flat pad by a place [m] and a direction [rad], each with its standard deviation.

    The deviation of the result is the floor [rad] at least: that of the contact model itself.
    """
    half = 0.5 * sensor.flat_width
    spread = LOAD_LENGTH / np.tan(_LEANS)  # length on which most of a leaning side's load falls
    corners = np.linspace(-half, half, len(_LEANS))
    along = np.concatenate((half / np.tanh(half / spread) - spread, corners))
    angle = np.concatenate((_LEANS, np.zeros(len(corners))))
    off_place = (along + sensor.radius * np.sin(angle) - place[0]) / place[1]
    off = 0.5 * (np.square(off_place) + np.square((angle - direction[0]) / direction[1]))
    weight = _EXPECTED * np.exp(off.min() - off)
    weight /= weight.sum()
    mean_along = float(weight @ along)
    mean = float(weight @ angle)
    along_variance = float(weight @ np.square(along - mean_along))
    variance = float(weight @ np.square(angle - mean)) + floor**2
    return Felt(mean_along, math.sqrt(along_variance), mean, math.sqrt(variance))
