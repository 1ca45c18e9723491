"""Places on an outline where a sensor begins to push, by kind; a kind is a class of contacts for scoring."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.geometry.polygon import sharp_corners
from palpate.geometry.shapes import Disc, Ellipse, Shape
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

_NEAR, _CLEAR = 0.008, 0.015  # [m] from a corner: up to where a patch has it in sight, and from where not
_PAD_ANGLE, _OFF_NORMAL = np.radians(12.0), np.radians(45.0)
_FLAT_ANGLE, _FLAT_OFF_NORMAL = np.radians(5.0), np.radians(25.0)  # of a flat pad or a hand
_FLAT_PLACE = 0.3  # part of its width that a contact begins from its middle
_REACH = 0.06  # [m] before the contact in which the gel must come in freely
_TRIES = 1000


@dataclass(frozen=True, eq=False)
class Touch:
    """How a sensor comes to an object, in the object frame."""

    sensor_pose: Array
    """object_T_sensor at the first touch, (3,) [m, m, rad]."""
    heading: float
    """Direction in which the sensor moves [rad]."""


def kinds(shape: Shape) -> tuple[str, ...]:
    """Return the kinds of contact that a shape has: "disc", "ellipse", "rectangle-corners" and so on."""
    name = type(shape).__name__.lower()
    if isinstance(shape, Disc | Ellipse):
        return (name,)
    corners = ("near-corners", "corners") if len(sharp_corners(shape.corners)) else ()
    return tuple(f"{name}-{place}" for place in ("edges", *corners))


def draw_touch(shape: Shape, kind: str, sensor: SensorProfile, rng: np.random.Generator) -> Touch:
    """Draw a touch of one kind that the gel can reach; raises SettingError if none is found."""
    for _ in range(_TRIES):
        point, normal = draw_place(shape, kind, rng)
        inward = normal + np.pi
        leaning = _FLAT_ANGLE if sensor.width else _PAD_ANGLE
        yaw = inward - rng.uniform(-leaning, leaning)
        aside = _FLAT_OFF_NORMAL if sensor.width else _OFF_NORMAL
        heading = inward + rng.uniform(-aside, aside)
        center = point + sensor.radius * _unit(normal)
        if sensor.width:
            center -= rng.uniform(-_FLAT_PLACE, _FLAT_PLACE) * sensor.width * _unit(yaw + 0.5 * np.pi)
            # A pad that leans against a side touches it with its edge, a hand with one finger.
            overlap = sensor.radius - shape.signed_distance(_parts(center, yaw, sensor)).min()
            center += max(overlap, 0.0) * _unit(normal)
        path = _parts(center, yaw, sensor) - np.linspace(0.0, _REACH, 25)[:, None, None] * _unit(heading)
        if (shape.signed_distance(path) > sensor.radius - 1e-4).all():
            return Touch(np.append(center - _turned(sensor.center, yaw), yaw), heading)
    raise SettingError(f"no place was found where the gel of {sensor.name!r} reaches the object at its {kind}")


def draw_place(shape: Shape, kind: str, rng: np.random.Generator) -> tuple[Array, float]:
    """Draw a point (2,) [m] of the outline and its outward normal [rad]."""
    if isinstance(shape, Disc | Ellipse):
        outline = shape.outline(720)
        i = int(rng.integers(len(outline)))
        along = outline[(i + 1) % len(outline)] - outline[i - 1]
        return outline[i], _angle(along) - 0.5 * np.pi
    corners = shape.corners
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    normals = np.arctan2(edges[:, 1], edges[:, 0]) - 0.5 * np.pi
    if kind.endswith("-edges"):
        i = int(rng.choice(len(edges), p=lengths / lengths.sum()))
        margin = min(_CLEAR, 0.4 * lengths[i])
        at = rng.uniform(margin, lengths[i] - margin)
        return corners[i] + at / lengths[i] * edges[i], float(normals[i])
    i = int(rng.choice(sharp_corners(corners)))
    before = i - 1
    if kind.endswith("-near-corners"):
        away = rng.uniform(0.25, 1.0) * _NEAR
        if rng.uniform() < 0.5:
            at = min(away, 0.5 * lengths[i])
            return corners[i] + at / lengths[i] * edges[i], float(normals[i])
        at = min(away, 0.5 * lengths[before])
        return corners[i] - at / lengths[before] * edges[before], float(normals[before])
    turn = float((normals[i] - normals[before]) % (2.0 * np.pi))
    return corners[i], float(normals[before] + rng.uniform(0.2, 0.8) * turn)


def _parts(center: Array, yaw: float, sensor: SensorProfile) -> Array:
    """Return where the round parts of a sensor with its centre here are, (n, 2) [m]."""
    ahead, aside = (sensor.round_centers - sensor.center).T[:, :, None]
    return center + ahead * _unit(yaw) + aside * _unit(yaw + 0.5 * np.pi)


def _unit(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


def _turned(vector: Array, angle: float) -> Array:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])


def _angle(vector: Array) -> float:
    return float(np.arctan2(vector[1], vector[0]))
