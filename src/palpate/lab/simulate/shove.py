"""A finger that shoves an object: a spring that only pushes, and no harder than a finger does."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.lab.simulate.paths import least_jerk

Array = NDArray[np.float64]

STRONGEST = 15.0
"""Most force of the finger [N]."""
_STIFFNESS, _DAMPING = 2000.0, 40.0  # [N/m], [N s/m]: the object lags the finger by 1 to 2 mm


@dataclass(frozen=True, eq=False)
class Shove:
    """Where and how a finger shoves an object; raises SettingError on a length or duration that is not allowed."""

    point: Array
    """Point of the object that the finger pushes, (2,) [m] in the object frame."""
    direction: float
    """Direction in the world in which the finger goes [rad]."""
    length: float
    """How far the finger goes [m]."""
    seconds: float
    """How long it takes [s]."""

    def __post_init__(self) -> None:
        for name, high in (("length", 0.1), ("seconds", 2.0)):
            if not 0.0 < getattr(self, name) <= high:
                raise SettingError(f"shove {name} is {getattr(self, name)!r}; allowed is more than 0, up to {high}")


class Finger:
    """A finger that carries out a shove, time step after time step; least jerk, from rest to rest."""

    def __init__(self, shove: Shove, start: Array, time_step: float) -> None:
        """Place the finger at the pushed point (2,) [m] in the world; a time step is in [s]."""
        self.point = shove.point
        """Point of the object that is pushed, (2,) [m] in the object frame."""
        self._away = np.array([np.cos(shove.direction), np.sin(shove.direction)])
        way = shove.length * least_jerk(max(round(shove.seconds / time_step), 2))
        self._speed = np.gradient(way, time_step).tolist()
        self._place = (float(start @ self._away) + way).tolist()
        self._step = 0

    @property
    def is_done(self) -> bool:
        """Whether the finger has arrived and pushes no more."""
        return self._step == len(self._place)

    def force(self, point: Array, velocity: Array) -> Array:
        """Return the force (2,) [N] at the pushed point, (2,) [m] and [m/s] in the world, in the next time step."""
        ahead = self._place[self._step] - float(point @ self._away)
        faster = self._speed[self._step] - float(velocity @ self._away)
        self._step += 1
        return min(max(_STIFFNESS * ahead + _DAMPING * faster, 0.0), STRONGEST) * self._away
