"""Knocks: a finger shoves the object now and then, unknown to the sensor."""

import numpy as np

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.types.sensor import SensorProfile
from palpate_lab.simulate.paths import TRIES, draw_place, kinds, unit_vector
from palpate_lab.simulate.world import Shove, World


class Knocks:
    """Draws the knocks of a sequence of pushes; without a generator there are none."""

    def __init__(self, shape: Shape, sensor: SensorProfile, rng: np.random.Generator | None) -> None:
        self._shape = shape
        self._sensor = sensor
        self._rng = rng
        self._kind = kinds(shape)[0]  # anywhere round it, or on its edges: a finger slips off a corner
        self._lever = 0.3 * np.sqrt(shape.area / np.pi)
        self._count = 0

    def draw_frame(self, frames: int, is_last: bool) -> int | None:
        """Draw the frame at which a push of `frames` is knocked, surely the last one if none was; None for no knock."""
        if self._rng is None:
            return None
        part = self._rng.uniform(0.3, 0.6)
        is_knocked = self._rng.uniform() < 0.6 or (is_last and not self._count)
        return round(part * frames) if is_knocked else None

    def in_push(self, world: World) -> None:
        """Begin a shove of an object in contact: sideways, away or against the gel."""
        self._begin(world, float(world.sensor_pose[2]), np.radians(110.0))

    def in_pause(self, world: World) -> bool:
        """Begin a shove of an object without contact, no nearer to the sensor, in some pauses; True if there is one."""
        if self._rng is None or self._rng.uniform() >= 0.3:
            return False
        x, y = se2.transform(world.object_pose, self._shape.centroid) - self._gel(world)
        self._begin(world, float(np.arctan2(y, x)), np.radians(90.0))
        return True

    def _begin(self, world: World, away: float, limit: float) -> None:
        """Begin a shove in a direction within a limit [rad] of the direction away from the sensor [rad]."""
        assert self._rng is not None
        self._count += 1
        length = self._rng.uniform(0.008, 0.050)
        seconds = self._rng.uniform(0.15, 0.4)
        for _ in range(TRIES):
            direction = away + self._rng.uniform(-limit, limit)
            point, normal = draw_place(self._shape, self._kind, self._rng)
            if self._can_push(world, point, normal, direction):
                world.shove(Shove(point, direction, length, seconds))
                return
        raise SettingError("no place was found where a finger can shove the object beside the sensor")

    def _can_push(self, world: World, point: Array, normal: float, direction: float) -> bool:
        """Check that a finger of radius 8 mm fits at a point of the outline, 15 mm off the gel, and turns it."""
        heading = direction - float(world.object_pose[2])
        forward = unit_vector(heading)
        arm = point - self._shape.centroid
        finger = point - 0.008 * forward
        gel = self._sensor.radius + 0.5 * self._sensor.width
        room = float(np.hypot(*(se2.transform(world.object_pose, finger) - self._gel(world)))) - gel
        return bool(
            abs(se2.wrap(heading - normal - np.pi)) < np.radians(50.0)
            and abs(arm[0] * forward[1] - arm[1] * forward[0]) > self._lever
            and self._shape.signed_distance(finger) > 0.0
            and room > 0.015
        )

    def _gel(self, world: World) -> Array:
        """Return the middle of the gel (2,) [m] in the world."""
        return se2.transform(world.sensor_pose, self._sensor.center)
