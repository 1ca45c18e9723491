"""The loop of a live session: two threads read images and poses, and the caller's thread tracks the newest image.

Images that arrive during a step replace one another, so that the estimate never lags behind; `listen`, which records,
receives all of them.
"""

import signal
import threading
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

import numpy as np

from palpate.errors import FrameError
from palpate.live.sources import STALLED, PoseTrack, Refused, SensorPlace, Sources, TimedPose, TouchImage
from palpate.pipeline.metrics import PERCENTILES, percentiles
from palpate.touch.background import Background
from palpate.tracker import Tracker
from palpate.types.estimate import Estimate
from palpate.types.measurements import Frame


class LiveEstimate(NamedTuple):
    """An estimate and the way it came about."""

    estimate: Estimate
    """Estimate at the image's time."""
    place: SensorPlace
    """Sensor pose at that time."""
    latency: float
    """Time from image to estimate [s]."""


Listen = Callable[[TouchImage | TimedPose | LiveEstimate], None]
"""Receives everything that arrives and is estimated, from several threads."""
Watch = Callable[[Frame, Estimate, Background | None], None]
"""Receives each tracked frame, its estimate and the untouched gel as known then."""


@dataclass
class LiveState:
    """Counts and latest values of a session; tests and tables read it while the session runs."""

    say: Callable[[str], None]
    """Receives notes for the user."""
    counts: Counter[str] = field(
        default_factory=lambda: Counter(
            images=0, tracked=0, dropped=0, without_pose=0, left_out=0, sensor_poses=0, refused_poses=0
        )
    )
    """Images, each in the end tracked, dropped for a newer one, without a sensor pose, or left out by the tracker;
    sensor poses taken and refused."""
    last: LiveEstimate | None = None
    """The last estimate."""
    contact_frames: int = 0
    """Estimates in contact."""
    statuses: Counter[str] = field(default_factory=Counter)
    """Estimates by status."""
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=60))
    """Times of the last images [s]."""
    _latencies: "array[float]" = field(default_factory=lambda: array("d"))
    _next_note: dict[str, float] = field(default_factory=dict)
    _stalled_since: float | None = None

    def count_fault(self, name: str, fault: str, reason: str, now: float) -> None:
        """Count a fault under a name and tell the user, once a second at most."""
        self.counts[name] += 1
        if now >= self._next_note.get(name, -np.inf):
            self._next_note[name] = now + 1.0
            self.say(f"{fault}, {self.counts[name]} so far: {reason}")

    def add(self, last: LiveEstimate) -> None:
        """Count an estimate."""
        self.counts["tracked"] += 1
        self.contact_frames += last.estimate.contact
        self.statuses[last.estimate.status] += 1
        self._latencies.append(1e3 * last.latency)
        self.last = last  # after its latency, which the table reads beside it

    def check_poses(self, last: float | None, begin: float, now: float) -> None:
        """Tell the user when poses stop and when they are back, by the times of the last one, the start and now [s]."""
        reference = begin if last is None else last
        is_stalled = now - reference > STALLED
        if is_stalled and self._stalled_since is None:
            self._stalled_since = reference
            fault = "no sensor pose has come" if last is None else "the sensor's poses have stalled: none"
            self.say(f"{fault} for {now - reference:.2f} s")
        elif not is_stalled and self._stalled_since is not None:
            self.say(f"sensor poses come, after {reference - self._stalled_since:.2f} s without")
            self._stalled_since = None

    @property
    def rate(self) -> float | None:
        """Measured rate of the last images [Hz]."""
        times = list(self.arrivals)
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else None

    def latency_ms(self, last: int = 0) -> dict[str, float | None]:
        """Return percentiles of the time from image to estimate [ms], of all estimates or the last ones."""
        values = self._latencies[-last:]
        return {**percentiles(values)} if values else dict.fromkeys(PERCENTILES)

    def summary(self) -> dict[str, Any]:
        """Return all counts as plain data for JSON."""
        return {
            **self.counts,
            "rate_hz": self.rate,
            "latency_ms": self.latency_ms(),
            "contact_frames": self.contact_frames,
            "statuses": dict(self.statuses),
        }


def track_live(
    tracker: Tracker,
    sources: Sources,
    state: LiveState,
    stop: threading.Event,
    listen: Listen = lambda item: None,
    watch: Watch | None = None,
    seconds: float | None = None,
) -> None:
    """Track until the images end, `stop` is set, or for some seconds [s].

    A frame that the tracker refuses is left out and counted. Raises what a source, `listen` or the tracker raises, and
    the FrameError of the first frame.
    """
    clock, begin = sources.clock, sources.clock.now()
    arrived: SimpleQueue[TouchImage] = SimpleQueue()
    track = PoseTrack()
    with _threads(sources, state, stop, listen, arrived, track) as is_reading:
        while is_reading() and not stop.is_set():
            image = _newest(arrived, state)
            state.check_poses(track.last_time, begin, clock.now())
            if seconds is not None and clock.now() - begin >= seconds:
                stop.set()
            if image is None:
                continue
            if (place := track.at(image.time)) is None:
                state.counts["without_pose"] += 1
                continue
            try:
                estimate = tracker.update(Frame(image.time, place.pose, image.pixels(sources.size)))
            except FrameError as error:
                if state.last is None:  # the first frame shows a fault of the set-up
                    raise
                state.count_fault("left_out", "a frame is left out", str(error), clock.now())
                continue
            if state.last is None and tracker.tactile_reason:
                state.say(f"tactile {tracker.tactile}: {tracker.tactile_reason}")
            if state.last is None and tracker.unusual_colours:
                state.say(tracker.unusual_colours)
            last = LiveEstimate(estimate, place, clock.now() - image.time)
            state.add(last)
            listen(last)
            if watch:
                watch(tracker.frame, estimate, tracker.background)
    state.counts["dropped"] += arrived.qsize()


def _newest(arrived: SimpleQueue[TouchImage], state: LiveState) -> TouchImage | None:
    """Return the newest image that waits or comes within 20 ms; the others are counted as dropped."""
    images: list[TouchImage] = []
    with suppress(Empty):
        images.append(arrived.get(timeout=0.02))
        while True:
            images.append(arrived.get_nowait())
    state.counts["dropped"] += max(0, len(images) - 1)
    return images[-1] if images else None


@contextmanager
def _threads(
    sources: Sources,
    state: LiveState,
    stop: threading.Event,
    listen: Listen,
    arrived: SimpleQueue[TouchImage],
    track: PoseTrack,
) -> Iterator[Callable[[], bool]]:
    """Read images into a queue and poses into the track, in threads.

    Yields a function that returns False when all images are read, and raises the exception of a thread.
    """
    failures: list[Exception] = []

    def read_images() -> None:
        for image in sources.images(stop):
            if isinstance(image, str):
                state.say(image)
                continue
            state.counts["images"] += 1
            state.arrivals.append(image.time)
            arrived.put(image)
            listen(image)

    def read_poses() -> None:
        for pose in sources.poses(stop):
            if isinstance(pose, str):
                state.say(pose)
            elif refused := pose if isinstance(pose, Refused) else track.add(pose):
                state.count_fault("refused_poses", "a sensor pose is refused", refused.reason, sources.clock.now())
            elif isinstance(pose, TimedPose):
                state.counts["sensor_poses"] += 1
                listen(pose)

    def run(read: Callable[[], None]) -> None:
        try:
            read()
        except Exception as error:
            failures.append(error)

    threads = [threading.Thread(target=run, args=(read,), daemon=True) for read in (read_images, read_poses)]

    def is_reading() -> bool:
        is_alive = threads[0].is_alive()  # asked before the queue, which nothing is put into afterwards
        if failures:
            raise failures[0]
        return is_alive or not arrived.empty()

    for thread in threads:
        thread.start()
    try:
        yield is_reading
    finally:
        stop.set()
        for thread in threads:
            thread.join(3.0)  # longer than a camera waits; one whose poses never come is left behind


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C and SIGTERM set, so that a session ends in order and its files are complete."""
    stop = threading.Event()
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
