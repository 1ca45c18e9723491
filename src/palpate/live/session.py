"""The loop of a live session: a thread for images and one for poses fill a queue, and the caller's thread empties it.

Images that arrive during a step replace one another, so that the estimate never lags behind; the recorder receives all.
"""

import signal
import threading
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from palpate.errors import FileError, FrameError, PalpateError
from palpate.geometry.shapes import Shape
from palpate.io import ros_messages as ros
from palpate.io.estimates import estimate_messages
from palpate.io.recording_mcap import IMAGES, SENSOR_POSES, describe
from palpate.live.sources import ImageSource, PoseSource, PoseTrack, Sources, TimedPose, TouchImage
from palpate.pipeline.metrics import PERCENTILES, percentiles
from palpate.tracker import Tracker
from palpate.types.estimate import Estimate
from palpate.types.images import decode_image, encode_image
from palpate.types.measurements import Frame
from palpate.types.space import flat

Listen = Callable[[TouchImage | TimedPose | Estimate], Any]
"""Function that receives every image, pose and estimate."""


class LiveSession:
    """Tracking of the newest image as it arrives. Another thread may read counts and the last estimate."""

    def __init__(self, tracker: Tracker, sources: Sources, say: Callable[[str], Any]) -> None:
        """Take the tracker, its sources, and a function that receives notes for the user."""
        self.say = say
        self.counts: Counter[str] = Counter(
            images=0, tracked=0, dropped=0, without_pose=0, left_out=0, sensor_poses=0, refused_poses=0
        )
        """Number of images, each of which is in the end tracked, dropped for a newer one, without a sensor pose, or
        left out by the tracker; and number of sensor poses that were taken and refused."""
        self.statuses: Counter[str] = Counter()
        """Estimates by status."""
        self.last: Estimate | None = None
        """The last estimate."""
        self._tracker = tracker
        self._sources = sources
        self._now = sources.now
        self._listen: Listen = lambda item: None
        self._arrived: SimpleQueue[TouchImage | TimedPose | str | Exception] = SimpleQueue()
        self._poses = PoseTrack()
        self._newest: TouchImage | None = None
        self._times: deque[float] = deque(maxlen=60)  # of the last images
        self._latencies: array[float] = array("d")
        self._tactile_reason = ""

    def run(self, stop: threading.Event, listen: Listen | None = None, seconds: float = np.inf) -> None:
        """Track until the images end, `stop` is set, or for some seconds [s].

        A damaged image, or a frame that the tracker refuses, is left out and counted. Raises what a source, `listen`
        or the tracker raises, and the FrameError of the first frame.
        """
        self._listen = listen or self._listen
        threads = [
            threading.Thread(target=self._read, args=(source, stop), daemon=True)
            for source in (self._sources.images, self._sources.poses)
        ]
        for thread in threads:
            thread.start()
        end = self._now() + seconds
        try:
            while not stop.is_set() and self._now() < end:
                is_over = not threads[0].is_alive()  # asked before reading the queue, into which nothing comes later
                self._receive(0.02)
                if self._newest is not None:
                    self._step()
                elif is_over:
                    break
        finally:
            stop.set()
            for thread in threads:
                thread.join(3.0)  # longer than a camera waits; one whose poses never come is left behind
        self._receive(0.0)
        self._count_dropped()

    def summary(self) -> dict[str, Any]:
        """Return counts, the rate of the last images, percentiles of the latency and the last estimate, for JSON."""
        times = list(self._times)
        rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else None
        latency = percentiles(self._latencies) if self._latencies else dict.fromkeys(PERCENTILES)
        summary = {**self.counts, "rate_hz": rate, "latency_ms": latency, "statuses": dict(self.statuses)}
        last = self.last
        if last:
            summary |= {"final_pose": last.pose.tolist(), "status": last.status, "reason": last.reason}
        return summary

    def _read(self, source: ImageSource | PoseSource, stop: threading.Event) -> None:
        """Put what a source yields into the queue, and the exception that ends it."""
        try:
            for item in source(stop):
                self._arrived.put(item)
        except Exception as error:
            self._arrived.put(error)

    def _receive(self, wait: float) -> None:
        """Take all that has arrived, or the first that arrives within `wait` [s] and all that came with it."""
        with suppress(Empty):
            self._take(self._arrived.get(timeout=wait))
            while True:
                self._take(self._arrived.get_nowait())

    def _take(self, item: TouchImage | TimedPose | str | Exception) -> None:
        """Count an item that has arrived and pass it on; raise it if it is an exception that ended a source."""
        if isinstance(item, TimedPose):
            item = self._poses.add(item) or item
        if isinstance(item, str):
            self.say(item)
        elif isinstance(item, FrameError):
            self._count_fault("refused_poses", "a sensor pose is refused", item)
        elif isinstance(item, Exception):
            raise item
        elif isinstance(item, TimedPose):
            self.counts["sensor_poses"] += 1
            self._listen(item)
        else:
            item = item._replace(time=item.time + self._sources.time_offset)
            self.counts["images"] += 1
            self._count_dropped()
            self._times.append(item.time)
            self._newest = item
            self._listen(item)

    def _step(self) -> None:
        """Track the newest image, which waits up to 10 ms for a pose that follows it."""
        assert self._newest is not None
        image = self._newest
        self._newest = None
        end = self._now() + 0.01
        while not self._poses.reaches(image.time):
            left = end - self._now()
            if left <= 0.0:
                break
            self._receive(left)
        pose = self._poses.at(image.time)
        if isinstance(pose, FrameError):
            self._count_fault("without_pose", "an image is without a sensor pose", pose)
            return
        size = (self._sources.sensor.image_height, self._sources.sensor.image_width)
        try:
            pixels = decode_image(image.data, size) if isinstance(image.data, bytes) else image.data
            estimate = self._tracker.update(Frame(image.time, pose, pixels))
        except (FileError, FrameError) as error:
            if self.last is None and isinstance(error, FrameError):  # the first frame shows a fault of the set-up
                raise
            self._count_fault("left_out", "a frame is left out", error)
            return
        reason = self._tracker.tactile_reason
        if reason != self._tactile_reason:
            self._tactile_reason = reason
            self.say(f"tactile {self._tracker.tactile}: {reason}")
        self.counts["tracked"] += 1
        self.statuses[estimate.status] += 1
        self._latencies.append(1e3 * (self._now() - image.time))
        self.last = estimate
        self._listen(estimate)

    def _count_dropped(self) -> None:
        """Count the newest image as dropped, if one is waiting."""
        if self._newest is not None:
            self.counts["dropped"] += 1

    def _count_fault(self, name: str, fault: str, reason: PalpateError) -> None:
        """Count a fault under a name, and tell the user of the first."""
        self.counts[name] += 1
        if self.counts[name] == 1:
            self.say(f"{fault}: {reason}; further ones are counted")


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


@contextmanager
def recorder(path: Path, shape: Shape, sources: Sources, force: bool = False) -> Iterator[Listen]:
    """Yield a function that records images, poses and estimates of a session into a new MCAP.

    Raises FileError if the file exists, unless `force`.
    """
    ros.ros_types("cdr")  # loading them takes a quarter of a second, which the first step should not wait for
    plane = flat()
    with ros.new_mcap(path, force, growing=True) as file:
        describe(file, shape, sources.sensor, {"is_view_known": str(sources.is_view_known).lower()})

        def record(item: TouchImage | TimedPose | Estimate) -> None:
            (stamp,) = ros.nanoseconds(path, np.array([item.time]))
            if isinstance(item, Estimate):
                file.add(stamp, estimate_messages(plane, stamp, item))
            elif isinstance(item, TimedPose):
                file.add(stamp, {SENSOR_POSES: ros.stamped_pose(stamp, plane, item.pose)})
            else:
                data = item.data if isinstance(item.data, bytes) else encode_image(item.data)
                file.add(stamp, {IMAGES: ros.stamped_image(stamp, data)})

        yield record
