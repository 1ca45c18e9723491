"""The loop of a live session: a thread for images and one for poses fill a queue, and the caller's thread empties it.

Images that arrive during a step replace one another, so that the estimate never lags behind; the recorder receives all.
The images of a hand's fingers are tracked together where they arrive within a few milliseconds, each at its own time.
"""

import math
import signal
import threading
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from palpate.arrays import Array, Image
from palpate.errors import FileError, FrameError, PalpateError
from palpate.geometry.shapes import Disc, Shape
from palpate.io import ros_messages as ros
from palpate.io.estimates import estimate_messages
from palpate.io.recording_mcap import IMAGES, SENSOR_POSES, about_hand, describe, image_topic
from palpate.live.sources import ImageSource, PoseSource, PoseTrack, Sources, TimedPose, TouchImage
from palpate.pipeline.metrics import PERCENTILES, percentiles
from palpate.tracker import Tracker
from palpate.types.estimate import Estimate
from palpate.types.hand import Hand
from palpate.types.images import decode_image, encode_image
from palpate.types.measurements import Frame
from palpate.types.outline import Sketch, Unknown
from palpate.types.sensor import SensorProfile
from palpate.types.space import flat

Listen = Callable[[TouchImage | TimedPose | Estimate], Any]
"""Function that receives every image, pose and estimate."""
TOGETHER = 2e-3
"""[s] Longest wait for the images of other fingers of a hand."""


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
        self._newest: dict[str, TouchImage] = {}  # by finger; "" is one sensor
        self._time = -math.inf  # of the last frame of a hand [s]
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
                if self._newest:
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
        """Return counts, rate of a camera's last images, percentiles of the latency and the last estimate, for JSON."""
        times = list(self._times)
        sensor = self._sources.sensor
        cameras = len(sensor.fingers) if isinstance(sensor, Hand) else 1
        rate = (len(times) - 1) / (times[-1] - times[0]) / cameras if len(times) > 1 else None
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
            self.counts["dropped"] += item.finger in self._newest
            self._times.append(item.time)
            self._newest[item.finger] = item
            self._listen(item)

    def _step(self) -> None:
        """Track the newest images, which wait a moment for those of other fingers, and up to 10 ms for a later pose."""
        self._wait(TOGETHER, self._are_all_there)
        images = self._newest
        self._newest = {}
        time = self._time_of(images)
        self._wait(0.01, lambda: self._poses.reaches(time))
        pose = self._poses.at(time)
        if isinstance(pose, FrameError):
            self._count_fault("without_pose", "an image is without a sensor pose", pose, len(images))
            return
        try:
            estimate = self._tracker.update(self._frame(time, pose, images))
        except (FileError, FrameError) as error:
            if self.last is None and isinstance(error, FrameError):  # the first frame shows a fault of the set-up
                raise
            self._count_fault("left_out", "a frame is left out", error, len(images))
            return
        self._take_estimate(estimate, min(image.time for image in images.values()), len(images))

    def _time_of(self, images: Mapping[str, TouchImage]) -> float:
        """Return the time of the frame of these images [s]: the latest, and after the last frame of a hand."""
        time = max(image.time for image in images.values())
        if isinstance(self._sources.sensor, Hand):  # whose slower camera may come after the faster one
            time = max(time, self._time + TOGETHER)
            self._time = time
        return time

    def _are_all_there(self) -> bool:
        """Return True if there is a new image of the sensor, or of every finger of a hand."""
        sensor = self._sources.sensor
        return not isinstance(sensor, Hand) or self._newest.keys() == sensor.fingers.keys()

    def _wait(self, longest: float, is_enough: Callable[[], bool]) -> None:
        """Take what arrives until it is enough, or for some time [s]."""
        end = self._now() + longest
        while not is_enough():
            left = end - self._now()
            if left <= 0.0:
                break
            self._receive(left)

    def _frame(self, time: float, pose: Array, images: Mapping[str, TouchImage]) -> Frame:
        """Return the frame of the sensor's image, or of a hand's. Raises FileError on an image that does not decode."""
        sensor = self._sources.sensor
        if not isinstance(sensor, Hand):
            return Frame(time, pose, _pixels(images[""], sensor))
        return Frame(
            time,
            pose,
            images={name: _pixels(image, sensor.fingers[name]) for name, image in images.items()},
            image_times={name: image.time for name, image in images.items()},
        )

    def _take_estimate(self, estimate: Estimate, begun: float, images: int) -> None:
        """Count an estimate of so many images, the first of which is of the time `begun` [s], and pass it on."""
        reason = self._tracker.tactile_reason
        if reason != self._tactile_reason:
            self._tactile_reason = reason
            self.say(f"tactile {self._tracker.tactile}: {reason}")
        self.counts["tracked"] += images
        self.statuses[estimate.status] += 1
        self._latencies.append(1e3 * (self._now() - begun))
        self.last = estimate
        self._listen(estimate)

    def _count_dropped(self) -> None:
        """Count the newest images as dropped, if any are waiting."""
        self.counts["dropped"] += len(self._newest)

    def _count_fault(self, name: str, fault: str, reason: PalpateError, items: int = 1) -> None:
        """Count a fault of some items under a name, and tell the user of the first."""
        is_first = not self.counts[name]
        self.counts[name] += items
        if is_first:
            self.say(f"{fault}: {reason}; further ones are counted")


def _pixels(image: TouchImage, sensor: SensorProfile) -> Image:
    """Return the pixels of an image of a sensor. Raises FileError if it does not decode."""
    if isinstance(image.data, bytes):
        return decode_image(image.data, (sensor.image_height, sensor.image_width))
    return image.data


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
def recorder(path: Path, shape: Shape | Unknown | Sketch, sources: Sources, force: bool = False) -> Iterator[Listen]:
    """Yield a function that records images, poses and estimates of a session into a new MCAP.

    Where the outline is not known, the recording says so, and has one that takes its place. Raises FileError if the
    file exists, unless `force`.
    """
    ros.ros_types("cdr")  # loading them takes a quarter of a second, which the first step should not wait for
    plane = flat()
    with ros.new_mcap(path, force, growing=True) as file:
        sensor = sources.sensor
        about = {"is_view_known": str(sources.is_view_known).lower()}
        if isinstance(shape, Unknown | Sketch):
            about |= {"is_shape_known": "false"}
            shape = Disc(0.5 * shape.mean_width) if isinstance(shape, Unknown) else shape.shape
        if isinstance(sensor, Hand):
            describe(file, shape, sensor.whole, about | about_hand(sensor))
        else:
            describe(file, shape, sensor, about)

        def record(item: TouchImage | TimedPose | Estimate) -> None:
            (stamp,) = ros.nanoseconds(path, np.array([item.time]))
            if isinstance(item, Estimate):
                file.add(stamp, estimate_messages(plane, stamp, item))
            elif isinstance(item, TimedPose):
                file.add(stamp, {SENSOR_POSES: ros.stamped_pose(stamp, plane, item.pose)})
            else:
                data = item.data if isinstance(item.data, bytes) else encode_image(item.data)
                topic = image_topic(item.finger) if item.finger else IMAGES
                file.add(stamp, {topic: ros.stamped_image(stamp, data)})

        yield record
