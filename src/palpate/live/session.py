"""The loop of a live session: images and poses come by threads of their own, and the newest image is tracked."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from palpate.errors import FrameError
from palpate.estimate import Estimate
from palpate.live.clock import Clock
from palpate.live.images import ImageSource, TouchImage, pixels_of
from palpate.live.newest import Newest
from palpate.live.poses import PoseSource, PoseTrack, Refused, SensorPlace, TimedPose
from palpate.live.state import LiveEstimate, LiveState
from palpate.recording.frame import Frame
from palpate.tracker import Tracker
from palpate.tracking.run import Watch

STALL = 0.15
"""[s] without a sensor pose after which that is said."""

_LOOK = 0.02  # [s] after which the loop looks around while no image comes
_ENDING = 2.0  # [s] for sources to end; one that waits for something that never comes is left behind


@dataclass(frozen=True, eq=False)
class Sources:
    """Where images and poses come from, and the clock by which they have their times."""

    images: ImageSource
    """Touch images."""
    poses: PoseSource
    """Poses of the sensor."""
    clock: Clock
    """What all times are measured by."""
    size: tuple[int, int]
    """Rows and columns of an image as it comes."""


class Listener(Protocol):
    """Is told of everything that comes and is estimated, as it happens and from several threads."""

    def image(self, image: TouchImage) -> None:
        """Take an image as it came."""
        ...

    def pose(self, pose: TimedPose) -> None:
        """Take a pose of the sensor as it came."""
        ...

    def estimate(self, estimate: Estimate, place: SensorPlace, latency: float) -> None:
        """Take an estimate, with how the sensor's pose was known and how long it took [s]."""
        ...


def track_live(
    tracker: Tracker,
    sources: Sources,
    state: LiveState,
    stop: threading.Event,
    listener: Listener | None = None,
    watch: Watch | None = None,
    seconds: float | None = None,
) -> None:
    """Track until the images end, the event is set, or for some seconds.

    Images that come while a step is running replace one another, and the tracker goes on with the newest; all of them
    are recorded. Each is tracked with the sensor's pose at its time, see `PoseTrack.at`. `state` tells how it goes.
    A frame that the tracker refuses is left out, counted and said. Raises what a source, the listener or the tracker
    raises, and a FrameError of the first frame.
    """
    clock, begin = sources.clock, sources.clock.now()
    stalls = _Stalls(state, begin)
    with _reading(sources, state, stop, listener) as (newest, track, failures):
        while not (stop.is_set() or failures or newest.over):
            image = newest.take(_LOOK)
            stalls.look(track.last, clock.now())
            if seconds is not None and clock.now() - begin >= seconds:
                stop.set()
            if image is None:
                continue
            place = track.at(image.time)
            if place is None:
                state.unplaced += 1
                continue
            try:
                estimate = tracker.update(Frame(image.time, place.pose, pixels_of(image, sources.size)))
            except FrameError as error:
                if not state.tracked:  # nothing was right so far, so nothing will be
                    raise
                state.leave_out(str(error), clock.now())
                continue
            if not state.tracked and tracker.tactile_reason:
                state.note(f"tactile {tracker.tactile}: {tracker.tactile_reason}")
            last = LiveEstimate(estimate, place, clock.now() - image.time)
            state.estimated(last)
            state.dropped = newest.dropped
            if listener:
                listener.estimate(*last)
            if watch:
                watch(tracker.frame, estimate, tracker.background)
    state.dropped = newest.dropped + (newest.take(0.0) is not None)
    if failures:
        raise failures[0]


class _Stalls:
    """Says when the sensor's poses stay away, and when they are back."""

    def __init__(self, state: LiveState, begin: float) -> None:
        self._state, self._begin = state, begin
        self._since: float | None = None

    def look(self, last: float | None, now: float) -> None:
        """Take the time of the last pose, None before the first, and the time [s]."""
        self._state.pose_age = None if last is None else now - last
        reference = self._begin if last is None else last
        if now - reference > STALL and self._since is None:
            self._since = reference
            what = "no sensor pose has come" if last is None else "the sensor's poses have stalled: none"
            self._state.note(f"{what} for {now - reference:.2f} s")
        elif now - reference <= STALL and self._since is not None:
            self._state.note(f"sensor poses come, after {reference - self._since:.2f} s without")
            self._since = None


@contextmanager
def _reading(
    sources: Sources, state: LiveState, stop: threading.Event, listener: Listener | None
) -> Iterator[tuple[Newest[TouchImage], PoseTrack, list[BaseException]]]:
    """Read both sources by threads; yields the newest image, the poses, and what the threads raised."""
    newest, track, failures = Newest[TouchImage](), PoseTrack(), list[BaseException]()

    def read_images() -> None:
        for image in sources.images(stop):
            if isinstance(image, str):
                state.note(image)
                continue
            state.arrived(image.time)
            newest.put(image)
            if listener:
                listener.image(image)
        newest.end()

    def read_poses() -> None:
        for pose in sources.poses(stop):
            if isinstance(pose, str):
                state.note(pose)
                continue
            refused = pose if isinstance(pose, Refused) else track.add(pose)
            if refused:
                state.refuse(refused.reason, sources.clock.now())
                continue
            assert not isinstance(pose, Refused)
            state.poses += 1
            if listener:
                listener.pose(pose)

    threads = [_started(read, failures) for read in (read_images, read_poses)]
    try:
        yield newest, track, failures
    finally:
        stop.set()
        for thread in threads:
            thread.join(_ENDING)


def _started(read: Callable[[], None], failures: list[BaseException]) -> threading.Thread:
    def run() -> None:
        try:
            read()
        except Exception as error:  # raised again by the loop
            failures.append(error)

    thread = threading.Thread(target=run, name=f"palpate-{read.__name__}", daemon=True)
    thread.start()
    return thread
