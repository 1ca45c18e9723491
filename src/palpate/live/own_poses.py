"""Sensor poses from a user's own Python, by an entry point of the group `palpate.poses`.

The entry point is a function without arguments that gives, one after the other, a time [s since 1970] and
world_T_sensor: x [m], y [m], theta [rad]; it may wait for each as long as it likes. `examples/own_package` has one.
"""

import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from palpate.errors import SettingError
from palpate.live.clock import Clock
from palpate.live.poses import PoseSource, Refused, TimedPose, checked_pose
from palpate.live.udp import timely
from palpate.own_code import called, loaded, own_code, words_of

GROUP = "palpate.poses"


def own_poses(name: str, clock: Clock) -> PoseSource:
    """Return the source of poses with this name. Raises SettingError where there is none, or it cannot be loaded."""
    found = own_code(GROUP)
    if name not in found:
        known = f"known are {', '.join(sorted(found))}" if found else "none is installed"
        raise SettingError(
            f"poses are to come from {name!r}; allowed are udp:PORT, ros2:TOPIC or an entry point of {GROUP}, {known}"
        )
    function: Callable[[], Iterable[Any]] = loaded(found[name])

    def poses(stop: threading.Event) -> Iterator[TimedPose | Refused]:
        try:
            for item in function():
                if stop.is_set():
                    return
                yield timely(_checked(item), clock.now())
        except Exception as error:
            raise SettingError(f"{called(found[name])} ended with {words_of(error)}") from error

    return poses


def _checked(item: Any) -> TimedPose | Refused:
    try:
        time, *numbers = item
    except TypeError:
        return Refused(f"{item!r} is not time, x, y, theta")
    return checked_pose(time, numbers)
