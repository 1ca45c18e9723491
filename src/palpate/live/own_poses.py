"""Sensor poses from a user's own Python, by an entry point of the group `palpate.poses`.

The entry point is a function without arguments that gives, one after the other, a time [s since 1970] and
world_T_sensor: x [m], y [m], theta [rad]; it may wait for each as long as it likes. `examples/own_poses.py` is one.
"""

import threading
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import entry_points
from typing import Any

from palpate.errors import SettingError
from palpate.live.clock import Clock
from palpate.live.poses import PoseSource, Refused, TimedPose, checked_pose
from palpate.live.udp import timely

GROUP = "palpate.poses"


def own_poses(name: str, clock: Clock) -> PoseSource:
    """Return the source of poses with this name. Raises SettingError where there is none, or it cannot be loaded."""
    found = {each.name: each for each in entry_points(group=GROUP)}
    if name not in found:
        known = f"known are {', '.join(sorted(found))}" if found else "none is installed"
        raise SettingError(
            f"poses are to come from {name!r}; allowed are udp:PORT, ros2:TOPIC or an entry point of {GROUP}, {known}"
        )
    try:
        function: Callable[[], Iterable[Any]] = found[name].load()
    except Exception as error:  # whatever a user's module raises
        raise SettingError(f"poses {name!r} ({found[name].value}) cannot be loaded: {_words(error)}") from error

    def poses(stop: threading.Event) -> Iterator[TimedPose | Refused]:
        try:
            for item in function():
                if stop.is_set():
                    return
                yield timely(_checked(item), clock.now())
        except Exception as error:
            raise SettingError(f"poses {name!r} ({found[name].value}) ended with {_words(error)}") from error

    return poses


def _checked(item: Any) -> TimedPose | Refused:
    try:
        time, *numbers = item
    except TypeError:
        return Refused(f"{item!r} is not time, x, y, theta")
    return checked_pose(time, numbers)


def _words(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
