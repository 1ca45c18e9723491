"""Paths of the sensor: the drawn contact on an outline, and the way to it, away from it and round the object.

All paths start and end at rest and are poses (N, 3) [m, m, rad], one per frame, without the pose they start from.
"""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Ellipse, Shape, sharp_corners
from palpate.types.sensor import SensorProfile
from palpate_lab.simulate.push_settings import ROBOT, PushSettings

TRIES = 1000
"""Draws of a place before giving up."""


@dataclass(frozen=True, eq=False)
class Touch:
    """The first contact of a push, in the object frame."""

    sensor_pose: Array
    """object_T_sensor at the first contact, (3,) [m, m, rad]."""
    heading: float
    """Direction in which the sensor moves [rad]."""


def kinds(shape: Shape) -> tuple[str, ...]:
    """Return the kinds of contact of a shape: "disc", "ellipse", "rectangle-corners" and so on."""
    name = type(shape).__name__.lower()
    if isinstance(shape, Disc | Ellipse):
        return (name,)
    corners = ("near-corners", "corners") if len(sharp_corners(shape.corners)) else ()
    return tuple(f"{name}-{place}" for place in ("edges", *corners))


def draw_touch(
    shape: Shape,
    kind: str,
    sensor: SensorProfile,
    rng: np.random.Generator,
    settings: PushSettings = ROBOT,
) -> Touch:
    """Draw a contact of one kind that the gel can reach; raises SettingError if none is found.

    A round gel's begins near its apex and heads near the normal, as in the settings; within 5 and 25 degrees for a flat
    pad or a hand, whose middle is up to 30 % of its width off.
    """
    yaw_limit, heading_limit = np.radians((5.0, 25.0) if sensor.width else (settings.begins, settings.heading))
    for _ in range(TRIES):
        point, normal = draw_place(shape, kind, rng)
        inward = normal + np.pi
        yaw = inward - rng.uniform(-yaw_limit, yaw_limit)
        heading = inward + rng.uniform(-heading_limit, heading_limit)
        arm = point - shape.centroid
        if abs(np.sin(heading - np.arctan2(arm[1], arm[0]))) < settings.beside:
            continue
        center = point + sensor.radius * unit_vector(normal)
        if sensor.width:
            center -= rng.uniform(-0.3, 0.3) * sensor.width * unit_vector(yaw + 0.5 * np.pi)
            # A pad that leans against a side touches it with its edge, a hand with one finger.
            overlap = sensor.radius - shape.signed_distance(_parts(center, yaw, sensor)).min()
            center += max(overlap, 0.0) * unit_vector(normal)
        # The gel must come in freely over the last 6 cm.
        path = _parts(center, yaw, sensor) - np.linspace(0.0, 0.06, 25)[:, None, None] * unit_vector(heading)
        if (shape.signed_distance(path) > sensor.radius - 1e-4).all():
            return Touch(np.append(center - se2.rotation(yaw) @ sensor.center, yaw), heading)
    raise SettingError(f"no place was found where the gel of {sensor.name!r} reaches the object at its {kind}")


def draw_place(shape: Shape, kind: str, rng: np.random.Generator) -> tuple[Array, float]:
    """Draw a point (2,) [m] of the outline and its outward normal [rad].

    Near corners are within 8 mm of one, edges at least 15 mm from any (or 40 % of a short edge).
    """
    if isinstance(shape, Disc | Ellipse):
        outline = shape.outline(720)
        i = int(rng.integers(len(outline)))
        x, y = outline[(i + 1) % len(outline)] - outline[i - 1]
        return outline[i], float(np.arctan2(y, x)) - 0.5 * np.pi
    corners = shape.corners
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    normals = np.arctan2(edges[:, 1], edges[:, 0]) - 0.5 * np.pi
    if kind.endswith("-edges"):
        i = int(rng.choice(len(edges), p=lengths / lengths.sum()))
        margin = min(0.015, 0.4 * lengths[i])
        at = rng.uniform(margin, lengths[i] - margin)
        return corners[i] + at / lengths[i] * edges[i], float(normals[i])
    i = int(rng.choice(sharp_corners(corners)[:, 0]))
    before = i - 1
    if kind.endswith("-near-corners"):
        away = rng.uniform(0.25, 1.0) * 0.008
        edge, side = (i, 1.0) if rng.uniform() < 0.5 else (before, -1.0)
        at = side * min(away, 0.5 * lengths[edge])
        return corners[i] + at / lengths[edge] * edges[edge], float(normals[edge])
    turn = float((normals[i] - normals[before]) % (2.0 * np.pi))
    return corners[i], float(normals[before] + rng.uniform(0.2, 0.8) * turn)


class Surroundings:
    """The circle around an object on which the gel's centre clears it by 3 cm."""

    def __init__(self, shape: Shape, sensor: SensorProfile) -> None:
        reach = np.hypot(*(shape.outline(200) - shape.centroid).T).max()
        self.radius = float(reach) + sensor.radius + 0.5 * sensor.width + 0.03
        """[m]"""
        self._shape = shape
        self._rate = sensor.rate
        self._parts = sensor.round_centers
        self._middle = np.append(shape.centroid, 0.0)
        self._center = np.append(sensor.center, 0.0)

    def start(self, touch: Touch, object_pose: Array) -> Array:
        """Return world_T_sensor (3,) on the circle, from which a straight line leads to a contact."""
        pose = se2.compose(object_pose, touch.sensor_pose)
        return self._along(pose, object_pose[2] + touch.heading + np.pi, object_pose)

    def approach(self, sensor_pose: Array, touch: Touch, object_pose: Array) -> Array:
        """Return the straight path to 3 mm before a contact, at 0.08 m/s."""
        goal = se2.compose(object_pose, touch.sensor_pose)
        goal[:2] -= 0.003 * unit_vector(object_pose[2] + touch.heading)
        return self._straight(sensor_pose, goal, 0.08)

    def leave(self, sensor_pose: Array, object_pose: Array, frames: int = 0) -> Array:
        """Return the straight path to the circle at 0.12 m/s, in a number of frames or more.

        It leads backwards, or as near to backwards as the object allows.
        """
        turns = sorted(np.radians(np.arange(-90, 91, 10)), key=abs)
        goals = [self._along(sensor_pose, sensor_pose[2] + np.pi + turn, object_pose) for turn in turns]
        goal = next((goal for goal in goals if self._is_free(sensor_pose, goal, object_pose)), goals[0])
        return self._straight(sensor_pose, goal, 0.12, frames)

    def travel(self, sensor_pose: Array, goal: Array, object_pose: Array) -> Array:
        """Return the shorter path round the object to a pose, at 0.25 m/s and 2 rad/s."""
        middle = se2.compose(object_pose, self._middle)[:2]
        start_arm = se2.compose(sensor_pose, self._center)[:2] - middle
        goal_arm = se2.compose(goal, self._center)[:2] - middle
        start_radius = np.hypot(*start_arm)
        goal_radius = np.hypot(*goal_arm)
        start_angle = np.arctan2(start_arm[1], start_arm[0])
        turn = se2.wrap(float(np.arctan2(goal_arm[1], goal_arm[0]) - start_angle))
        yaw_turn = se2.wrap(float(goal[2] - sensor_pose[2]))
        length = abs(turn) * self.radius + abs(goal_radius - start_radius)
        share = minimum_jerk(self._frames(max(length / 0.25, abs(yaw_turn) / 2.0)))
        radius = start_radius + share * (goal_radius - start_radius)
        angle = start_angle + share * turn
        yaw = sensor_pose[2] + share * yaw_turn
        center = np.column_stack((middle[0] + radius * np.cos(angle), middle[1] + radius * np.sin(angle), yaw))
        return se2.compose(center, -self._center)

    def _along(self, pose: Array, direction: float, object_pose: Array) -> Array:
        """Return the pose moved in a direction until the gel's centre is on the circle."""
        away = unit_vector(direction)
        offset = (se2.compose(pose, self._center) - se2.compose(object_pose, self._middle))[:2]
        half = float(offset @ away)
        rest = self.radius**2 - float(offset @ offset)
        length = max(-half + np.sqrt(max(half**2 + rest, 0.0)), 0.0)
        return np.append(pose[:2] + length * away, pose[2])

    def _is_free(self, start: Array, goal: Array, object_pose: Array) -> bool:
        """Check that the gel comes no nearer to the object on a straight path than it is at the start."""
        path = start + np.linspace(0.0, 1.0, 50)[:, None] * (goal - start)
        parts = se2.transform(se2.between(object_pose, path)[:, None], self._parts)
        distance = self._shape.signed_distance(parts).min(axis=1)
        return bool((distance > distance[0] - 1e-4).all())

    def _straight(self, start: Array, goal: Array, speed: float, frames: int = 0) -> Array:
        """Return the straight path at a mean speed [m/s], in a number of frames or more."""
        way = goal - start
        frames = max(self._frames(float(np.hypot(*way[:2])) / speed), frames)
        way[2] = se2.wrap(float(way[2]))
        return start + minimum_jerk(frames)[:, None] * way

    def _frames(self, seconds: float) -> int:
        """Return the number of frames of a path, which takes 0.4 s or more."""
        return int(np.ceil(max(seconds, 0.4) * self._rate))


def minimum_jerk(frames: int) -> Array:
    """Return the share (N,) of a path covered by each frame, with minimum jerk from rest to rest."""
    t = np.arange(1, frames + 1) / max(frames, 1)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def unit_vector(angle: float) -> Array:
    """Return the unit vector (2,) in a direction [rad]."""
    return np.array([np.cos(angle), np.sin(angle)])


def _parts(center: Array, yaw: float, sensor: SensorProfile) -> Array:
    """Return positions of a sensor's round parts, (n, 2) [m], for its centre and yaw."""
    ahead, aside = (sensor.round_centers - sensor.center).T[:, :, None]
    return center + ahead * unit_vector(yaw) + aside * unit_vector(yaw + 0.5 * np.pi)
