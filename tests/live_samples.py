"""Sources and trackers of live sessions that tests steer."""

import threading
from collections.abc import Callable, Iterator
from time import monotonic, sleep
from typing import Any

import numpy as np
from view_samples import CAMERA

from palpate.live.poses import Refused, TimedPose
from palpate.live.session import LiveState
from palpate.live.sources import Clock, Sources, TouchImage
from palpate.types.estimate import Estimate

SIZE = (CAMERA.image_height, CAMERA.image_width)
TURNED = (CAMERA.image_width, CAMERA.image_height)
GEL = np.full((*SIZE, 3), 90, np.uint8)


class FakeTracker:
    """Takes each frame as what `step` makes of it, and says nothing of the object."""

    background = None
    tactile, tactile_reason, unusual_colours = "none", "", ""

    def __init__(self, step: Callable[[Any], None] = lambda frame: None) -> None:
        self.frames: list[Any] = []
        self._step = step

    @property
    def frame(self) -> Any:
        return self.frames[-1]

    def update(self, frame: Any) -> Estimate:
        self.frames.append(frame)
        self._step(frame)
        return Estimate(frame.time, np.zeros(3), np.eye(3), False, "resting")


def state() -> tuple[LiveState, list[str]]:
    """A state, and the list of what it says."""
    said: list[str] = []
    return LiveState(said.append), said


def wait_for(what: Callable[[], bool]) -> None:
    """Wait until something is so, for a while."""
    last = monotonic() + 20.0
    while not what():
        assert monotonic() < last, "it never came to be"
        sleep(0.005)


def images_at(clock: Clock, times: Any) -> Any:
    """A source of images at times [s] of a clock."""

    def images(stop: threading.Event) -> Iterator[TouchImage]:
        for time in times:
            if stop.wait(max(0.0, time - clock.now())):
                return
            yield TouchImage(time, GEL)

    return images


def poses_at(clock: Clock, times: Any) -> Any:
    """A source of poses whose x is the time, at times [s] of a clock; a pose is refused where the time is NaN."""

    def poses(stop: threading.Event) -> Iterator[TimedPose | Refused]:
        for time in times:
            if np.isnan(time):
                yield Refused("nonsense")
            elif stop.wait(max(0.0, time - clock.now())):
                return
            else:
                yield TimedPose(time, np.array([time, 0.0, 0.0]))

    return poses


def sources(image_times: Any, pose_times: Any, clock: Clock | None = None) -> Sources:
    clock = clock or Clock(0.0)
    return Sources(images_at(clock, image_times), poses_at(clock, pose_times), clock, SIZE)
