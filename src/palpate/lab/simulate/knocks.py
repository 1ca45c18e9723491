"""Knocks: someone's finger shoves the object, which the sensor does not know.

What is drawn, and why:

- When: in 60 % of pushes, between 30 and 60 % of their frames, so that there is contact before and time to find out
  after; in 30 % of the pauses between contacts, when the sensor has left. What may be the last push is knocked in any
  case where nothing has been.
- Direction: in contact up to 110 degrees off the way the sensor looks, so that the object is moved sideways, taken away
  or pressed a little harder against the gel; in a pause never nearer to the sensor.
- Place: where a finger can come down, outside the object and beside the sensor; no more than 50 degrees off the normal,
  at which a finger still does not slip off; and off the middle, so that the object turns.
- Length and time: 8 to 50 mm in 0.15 to 0.4 s. Nine in ten move the object by 5 to 40 mm and turn it by 3 to 25
  degrees.
"""

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.lab.simulate.places import draw_place, kinds
from palpate.lab.simulate.shove import Shove
from palpate.lab.simulate.world import World
from palpate.types.sensor import SensorProfile

Array = NDArray[np.float64]

PAUSE = 1.0
"""How long the sensor stands still where the object is shoved between contacts [s]."""
_PUSHES, _PAUSES = 0.6, 0.3  # parts of them that are knocked
_WHEN = (0.3, 0.6)  # of the frames of a push
_IN_PUSH, _IN_PAUSE = np.radians(110.0), np.radians(90.0)
_OFF_NORMAL = np.radians(50.0)
_LENGTH = (0.008, 0.050)  # [m] at the finger; the middle of the object moves less, by 5 to 40 mm
_SECONDS = (0.15, 0.4)  # [s]
_FINGER = 0.008  # [m] radius of a finger
_BESIDE = 0.015  # [m] from the gel to the middle of the finger
_LEVER = 0.3  # of the object's size: how far beside its middle the finger pushes at least
_TRIES = 1000


class Knocks:
    """Draws which pushes and pauses of a sequence are knocked, and how; without a generator none is."""

    def __init__(self, shape: Shape, sensor: SensorProfile, rng: np.random.Generator | None) -> None:
        self._shape = shape
        self._kind = kinds(shape)[0]  # anywhere round it, or on its edges: a finger slips off a corner
        self._lever = _LEVER * np.sqrt(shape.area / np.pi)
        self._sensor = sensor
        self._rng = rng
        self._count = 0

    def frame(self, frames: int, is_last: bool) -> int | None:
        """Draw the frame at which a push of so many frames is knocked, None if it is not.

        One that may be the last is, where there has been no knock.
        """
        if self._rng is None:
            return None
        part = self._rng.uniform(*_WHEN)
        is_knocked = self._rng.uniform() < _PUSHES or (is_last and not self._count)
        return round(part * frames) if is_knocked else None

    def in_push(self, world: World) -> None:
        """Begin a shove of an object that the gel touches."""
        self._begin(world, float(world.sensor_pose[2]), _IN_PUSH)

    def in_pause(self, world: World) -> bool:
        """Draw whether the object is shoved while the sensor stands clear of it; if so, begin and say so."""
        if self._rng is None or self._rng.uniform() >= _PAUSES:
            return False
        x, y = se2.transform(world.object_pose, self._shape.centroid) - self._gel(world)
        self._begin(world, float(np.arctan2(y, x)), _IN_PAUSE)
        return True

    def _begin(self, world: World, away: float, within: float) -> None:
        """Begin a shove in a direction within an angle [rad] of that away from the sensor [rad]."""
        assert self._rng is not None
        self._count += 1
        length = self._rng.uniform(*_LENGTH)
        seconds = self._rng.uniform(*_SECONDS)
        for _ in range(_TRIES):
            direction = away + self._rng.uniform(-within, within)
            point, normal = draw_place(self._shape, self._kind, self._rng)
            if self._can_push(world, point, normal, direction):
                world.shove(Shove(point, direction, length, seconds))
                return
        raise SettingError("no place was found where a finger can shove the object beside the sensor")

    def _can_push(self, world: World, point: Array, normal: float, direction: float) -> bool:
        """Say whether a finger can stand at a point of the outline, push from there and turn the object."""
        heading = direction - float(world.object_pose[2])
        way = np.array([np.cos(heading), np.sin(heading)])
        arm, finger = point - self._shape.centroid, point - _FINGER * way
        gel = self._sensor.radius + 0.5 * self._sensor.width
        room = float(np.hypot(*(se2.transform(world.object_pose, finger) - self._gel(world)))) - gel
        return bool(
            abs(se2.wrap(heading - normal - np.pi)) < _OFF_NORMAL
            and abs(arm[0] * way[1] - arm[1] * way[0]) > self._lever
            and self._shape.signed_distance(finger) > 0.0
            and room > _BESIDE
        )

    def _gel(self, world: World) -> Array:
        """Return where the middle of the gel is (2,) [m] in the world."""
        return se2.transform(world.sensor_pose, self._sensor.center)
