"""The loop of a live session: images and poses come by threads of their own, and the newest image is tracked."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FrameError
from palpate.live.clock import Clock
from palpate.live.images import ImageSource, TouchImage, pixels_of
from palpate.live.newest import Newest
from palpate.live.poses import PoseSource, PoseTrack, Refused, SensorPlace, TimedPose
from palpate.live.state import LiveEstimate, LiveState
from palpate.live.truth import LiveTruth, Picture, TruePose
from palpate.pipeline.run import Watch
from palpate.tracker import Tracker
from palpate.types.estimate import Estimate
from palpate.types.frame import Frame

Compared = Callable[[TruePose, NDArray[np.float64] | None], None]
"""Takes a true pose of the object and what was estimated for its time, (3,), or None."""

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
    truth: LiveTruth | None = None
    """What tells where the object really is."""


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
    compared: Compared | None = None,
) -> None:
    """Track until the images end, the event is set, or for some seconds.

    Images that come while a step is running replace one another, and the tracker goes on with the newest; all of them
    are recorded. Each is tracked with the sensor's pose at its time, see `PoseTrack.at`. `state` tells how it goes.
    A frame that the tracker refuses is left out, counted and said. Raises what a source, the listener or the tracker
    raises, and a FrameError of the first frame.
    """
    clock, begin = sources.clock, sources.clock.now()
    stalls = _Stalls(state, begin)
    with _reading(sources, state, stop, listener, compared) as (newest, track, failures):
        while not (stop.is_set() or failures or newest.over):
            image = newest.take(_LOOK)
            stalls.look(track.last, clock.now())
            state.truth_age = None if state.true is None else clock.now() - state.true.time
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
            if not state.tracked and tracker.unusual_colours:
                state.note(tracker.unusual_colours)
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
    sources: Sources,
    state: LiveState,
    stop: threading.Event,
    listener: Listener | None,
    compared: Compared | None,
) -> Iterator[tuple[Newest[TouchImage], PoseTrack, list[BaseException]]]:
    """Read the sources by threads; yields the newest image, the poses, and what the threads raised."""
    newest, track, failures = Newest[TouchImage](), PoseTrack(), list[BaseException]()
    pictures, truth = Newest[Picture](), sources.truth

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
            if truth:
                truth.sensor(pose)
            if listener:
                listener.pose(pose)

    def read_pictures(truth: LiveTruth) -> None:
        for picture in truth.pictures(stop):
            if isinstance(picture, str):
                state.note(picture)
            else:
                pictures.put(picture)
        pictures.end()

    def look_at_pictures(truth: LiveTruth) -> None:
        while not (stop.is_set() or pictures.over):
            picture = pictures.take(_LOOK)
            for found in truth.look(picture) if picture else ():
                if isinstance(found, str):
                    state.note(found)
                    continue
                estimated = state.compare(found)
                if compared:
                    compared(found, estimated)

    reading = [read_images, read_poses]
    if truth:
        state.true_poses = 0
        reading += [partial(read_pictures, truth), partial(look_at_pictures, truth)]
    threads = [_started(read, failures) for read in reading]
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

    thread = threading.Thread(target=run, name="palpate-reading", daemon=True)
    thread.start()
    return thread
