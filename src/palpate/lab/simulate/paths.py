"""Paths of the sensor clear of the object: to a contact, away from it and round the object to the next one.

All start and end at rest and return poses (N, 3) [m, m, rad], one a frame, without the pose they start from.
"""

import numpy as np
from numpy.typing import NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.lab.simulate.places import Touch
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

_TRAVEL, _APPROACH, _RETREAT = 0.25, 0.08, 0.12  # [m/s] mean speeds round the object, towards it and away from it
_TURN = 2.0  # [rad/s] mean rate of turning on the way round
_WAYS_OUT = sorted(np.radians(np.arange(-90, 91, 10)), key=abs)
_BRIEFEST = 0.4  # [s]
_CLEARANCE = 0.03  # [m] between gel and object while going round
_STANDOFF = 0.003  # [m] between gel and object where the approach ends


class Surroundings:
    """The circle round an object on which the centre of a gel clears it."""

    def __init__(self, shape: Shape, sensor: SensorProfile) -> None:
        reach = np.hypot(*(shape.outline(200) - shape.centroid).T).max()
        self.radius = float(reach) + sensor.radius + 0.5 * sensor.width + _CLEARANCE
        """[m]"""
        self._shape = shape
        self._middle = np.append(shape.centroid, 0.0)
        self._center = np.append(sensor.center, 0.0)
        self._parts = sensor.round_centers
        self._rate = sensor.rate

    def start(self, touch: Touch, object_pose: Array) -> Array:
        """Return world_T_sensor (3,) from where a straight line leads to a touch."""
        pose = se2.compose(object_pose, touch.sensor_pose)
        back = object_pose[2] + touch.heading + np.pi
        return self._along(pose, back, object_pose)

    def approach(self, sensor_pose: Array, touch: Touch, object_pose: Array) -> Array:
        """Go straight to where the gel nearly touches."""
        goal = se2.compose(object_pose, touch.sensor_pose)
        heading = object_pose[2] + touch.heading
        goal[:2] -= _STANDOFF * np.array([np.cos(heading), np.sin(heading)])
        length = float(np.hypot(*(goal - sensor_pose)[:2]))
        return self._straight(sensor_pose, goal, self._frames(length / _APPROACH))

    def leave(self, sensor_pose: Array, object_pose: Array, frames: int = 0) -> Array:
        """Go straight away until clear, in a number of frames or more.

        Away is back, or as near to back as the object allows.
        """
        goals = [self._along(sensor_pose, sensor_pose[2] + np.pi + turn, object_pose) for turn in _WAYS_OUT]
        goal = next((goal for goal in goals if self._is_free(sensor_pose, goal, object_pose)), goals[0])
        length = float(np.hypot(*(goal - sensor_pose)[:2]))
        return self._straight(sensor_pose, goal, max(self._frames(length / _RETREAT), frames))

    def travel(self, sensor_pose: Array, goal: Array, object_pose: Array) -> Array:
        """Go round the object to a pose, the shorter way."""
        middle = se2.compose(object_pose, self._middle)[:2]
        a, b = (se2.compose(pose, self._center)[:2] - middle for pose in (sensor_pose, goal))
        far_a, far_b = np.hypot(*a), np.hypot(*b)
        angle = np.arctan2(a[1], a[0])
        turn = se2.wrap(float(np.arctan2(b[1], b[0]) - angle))
        yaw_turn = se2.wrap(float(goal[2] - sensor_pose[2]))
        length = abs(turn) * self.radius + abs(far_b - far_a)
        part = least_jerk(self._frames(max(length / _TRAVEL, abs(yaw_turn) / _TURN)))
        far, angle = far_a + part * (far_b - far_a), angle + part * turn
        yaw = sensor_pose[2] + part * yaw_turn
        center = np.column_stack((middle[0] + far * np.cos(angle), middle[1] + far * np.sin(angle), yaw))
        return se2.compose(center, -self._center)

    def _along(self, pose: Array, direction: float, object_pose: Array) -> Array:
        """Return the pose moved in a direction until the gel's centre is on the circle."""
        away = np.array([np.cos(direction), np.sin(direction)])
        offset = (se2.compose(pose, self._center) - se2.compose(object_pose, self._middle))[:2]
        half = float(offset @ away)
        rest = self.radius**2 - float(offset @ offset)
        length = max(-half + np.sqrt(max(half**2 + rest, 0.0)), 0.0)
        return np.append(pose[:2] + length * away, pose[2])

    def _is_free(self, start: Array, goal: Array, object_pose: Array) -> bool:
        """Say whether the gel comes no nearer to the object on a straight way than it is at the start."""
        way = start + np.linspace(0.0, 1.0, 50)[:, None] * (goal - start)
        parts = se2.transform(se2.between(object_pose, way)[:, None], self._parts)
        distance = self._shape.signed_distance(parts).min(axis=1)
        return bool((distance > distance[0] - 1e-4).all())

    def _straight(self, start: Array, goal: Array, frames: int) -> Array:
        way = goal - start
        way[2] = se2.wrap(float(way[2]))
        return start + least_jerk(frames)[:, None] * way

    def _frames(self, seconds: float) -> int:
        return int(np.ceil(max(seconds, _BRIEFEST) * self._rate))


def least_jerk(frames: int) -> Array:
    """Return the parts (N,) of a way done by each frame: least jerk, from rest to rest."""
    t = np.arange(1, frames + 1) / max(frames, 1)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
