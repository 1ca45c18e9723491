"""The loop of a live session: threads read images and poses, and the newest image is tracked.

One thread reads images, one reads poses, and the caller's thread tracks. Images that arrive during a step replace one
another, so that the estimate never lags behind; all of them are recorded.
"""

import threading
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from palpate.errors import FrameError
from palpate.live.poses import PoseTrack, Refused, SensorPlace, TimedPose
from palpate.live.sources import Sources, TouchImage
from palpate.pipeline.track import Watch
from palpate.tracker import Tracker
from palpate.types.estimate import Estimate
from palpate.types.frame import Frame

POSE_STALL = 0.15
"""Time without a sensor pose after which the user is told [s]."""


class LiveEstimate(NamedTuple):
    """An estimate and the way it came about."""

    estimate: Estimate
    """Estimate at the image's time."""
    place: SensorPlace
    """Sensor pose at that time."""
    latency: float
    """Time from image to estimate [s]."""


@dataclass
class LiveState:
    """Counts of a session; each image is in the end tracked, dropped, without a pose or refused."""

    say: Callable[[str], None]
    """Receives notes for the user."""
    images: int = 0
    """Images that arrived."""
    tracked: int = 0
    """Images that became an estimate."""
    dropped: int = 0
    """Images replaced by a newer one during a step."""
    without_pose: int = 0
    """Images without a sensor pose at their time."""
    left_out: int = 0
    """Images that the tracker refused."""
    poses: int = 0
    """Sensor poses that arrived and were taken."""
    refused: int = 0
    """Things that arrived in place of sensor poses."""
    pose_age: float | None = None
    """Age of the last sensor pose [s]; None before the first."""
    last: LiveEstimate | None = None
    """The last estimate."""
    contact_frames: int = 0
    """Estimates in contact."""
    statuses: Counter[str] = field(default_factory=Counter)
    """Estimates by status."""
    notes: deque[str] = field(default_factory=lambda: deque(maxlen=3))
    """The last notes."""
    _latencies: "array[float]" = field(default_factory=lambda: array("d"))
    _arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=60))
    _next_note: dict[str, float] = field(default_factory=dict)

    def note(self, text: str) -> None:
        """Tell the user something."""
        self.notes.append(text)
        self.say(text)

    def note_count(self, fault: str, count: int, reason: str, now: float) -> None:
        """Tell the user about a repeated fault, once a second at most."""
        if now >= self._next_note.get(fault, -np.inf):
            self._next_note[fault] = now + 1.0
            self.note(f"{fault}, {count} so far: {reason}")

    def add(self, last: LiveEstimate) -> None:
        """Count an estimate."""
        self.tracked += 1
        self.contact_frames += last.estimate.contact
        self.statuses[last.estimate.status] += 1
        self._latencies.append(1e3 * last.latency)
        self.last = last

    @property
    def rate(self) -> float | None:
        """Measured rate of the last images [Hz]."""
        times = list(self._arrivals)
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else None

    def latency_ms(self, last: int = 0) -> dict[str, float | None]:
        """Return percentiles of the time from image to estimate [ms], of all estimates or the last ones."""
        values = np.array(self._latencies[-last:])
        if not len(values):
            return dict.fromkeys(("p50", "p95", "p99", "max"))
        return dict(zip(("p50", "p95", "p99", "max"), np.percentile(values, (50, 95, 99, 100)).tolist(), strict=True))

    def summary(self) -> dict[str, Any]:
        """Return all counts as plain data for JSON."""
        return {
            "images": self.images,
            "tracked": self.tracked,
            "dropped": self.dropped,
            "without_pose": self.without_pose,
            "left_out": self.left_out,
            "sensor_poses": self.poses,
            "refused_poses": self.refused,
            "rate_hz": self.rate,
            "latency_ms": self.latency_ms(),
            "contact_frames": self.contact_frames,
            "statuses": dict(self.statuses),
        }


class Listener(Protocol):
    """Receives everything that arrives and is estimated, from several threads."""

    def image(self, image: TouchImage) -> None:
        """Receive an image as it arrived."""
        ...

    def pose(self, pose: TimedPose) -> None:
        """Receive a sensor pose as it arrived."""
        ...

    def estimate(self, last: LiveEstimate) -> None:
        """Receive an estimate."""
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
    """Track until the images end, `stop` is set, or for some seconds [s].

    A frame that the tracker refuses is left out and counted. Raises what a source, the listener or the tracker raises,
    and the FrameError of the first frame.
    """
    clock, begin = sources.clock, sources.clock.now()
    stall = _PoseStall(state, begin)
    with _reading(sources, state, stop, listener) as (newest, track, failures):
        while not (stop.is_set() or failures or newest.is_over):
            image = newest.take(0.02)
            stall.check(track.last_time, clock.now())
            if seconds is not None and clock.now() - begin >= seconds:
                stop.set()
            if image is None:
                continue
            place = track.at(image.time)
            if place is None:
                state.without_pose += 1
                continue
            try:
                estimate = tracker.update(Frame(image.time, place.pose, image.pixels(sources.size)))
            except FrameError as error:
                if not state.tracked:  # the first frame shows a fault of the set-up
                    raise
                state.left_out += 1
                state.note_count("a frame is left out", state.left_out, str(error), clock.now())
                continue
            if not state.tracked:
                for note in _first_notes(tracker):
                    state.note(note)
            last = LiveEstimate(estimate, place, clock.now() - image.time)
            state.add(last)
            state.dropped = newest.dropped
            if listener:
                listener.estimate(last)
            if watch:
                watch(tracker.frame, estimate, tracker.background)
    state.dropped = newest.dropped + (newest.take(0.0) is not None)
    if failures:
        raise failures[0]


def _first_notes(tracker: Tracker) -> list[str]:
    """Return what the tracker found out from the first image."""
    chosen = f"tactile {tracker.tactile}: {tracker.tactile_reason}" if tracker.tactile_reason else ""
    return [note for note in (chosen, tracker.unusual_colours) if note]


class _Newest:
    """Hands images from one thread to another; a newer image replaces one that was not taken yet."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._waiting: TouchImage | None = None
        self._has_ended = False
        self.dropped = 0

    @property
    def is_over(self) -> bool:
        with self._changed:
            return self._has_ended and self._waiting is None

    def put(self, image: TouchImage) -> None:
        with self._changed:
            self.dropped += self._waiting is not None
            self._waiting = image
            self._changed.notify()

    def end(self) -> None:
        with self._changed:
            self._has_ended = True
            self._changed.notify()

    def take(self, patience: float) -> TouchImage | None:
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is not None or self._has_ended, patience)
            taken, self._waiting = self._waiting, None
            return taken


class _PoseStall:
    """Tells the user when sensor poses stop arriving, and when they are back."""

    def __init__(self, state: LiveState, begin: float) -> None:
        self._state, self._begin = state, begin
        self._since: float | None = None

    def check(self, last: float | None, now: float) -> None:
        self._state.pose_age = None if last is None else now - last
        reference = self._begin if last is None else last
        if now - reference > POSE_STALL and self._since is None:
            self._since = reference
            fault = "no sensor pose has come" if last is None else "the sensor's poses have stalled: none"
            self._state.note(f"{fault} for {now - reference:.2f} s")
        elif now - reference <= POSE_STALL and self._since is not None:
            self._state.note(f"sensor poses come, after {reference - self._since:.2f} s without")
            self._since = None


@contextmanager
def _reading(
    sources: Sources, state: LiveState, stop: threading.Event, listener: Listener | None
) -> Iterator[tuple[_Newest, PoseTrack, list[BaseException]]]:
    """Read the sources in threads; yield the newest image, the poses, and the exceptions of the threads."""
    newest, track, failures = _Newest(), PoseTrack(), list[BaseException]()

    def read_images() -> None:
        for image in sources.images(stop):
            if isinstance(image, str):
                state.note(image)
                continue
            state.images += 1
            state._arrivals.append(image.time)
            newest.put(image)
            if listener:
                listener.image(image)
        newest.end()

    def read_poses() -> None:
        for pose in sources.poses(stop):
            if isinstance(pose, str):
                state.note(pose)
            elif refused := pose if isinstance(pose, Refused) else track.add(pose):
                state.refused += 1
                state.note_count("a sensor pose is refused", state.refused, refused.reason, sources.clock.now())
            else:
                assert isinstance(pose, TimedPose)
                state.poses += 1
                if listener:
                    listener.pose(pose)

    def run(read: Callable[[], None]) -> None:
        try:
            read()
        except Exception as error:  # the loop raises it again
            failures.append(error)

    threads = [threading.Thread(target=run, args=(read,), daemon=True) for read in (read_images, read_poses)]
    for thread in threads:
        thread.start()
    try:
        yield newest, track, failures
    finally:
        stop.set()
        for thread in threads:
            thread.join(2.0)  # one that waits for something that never comes is left behind
