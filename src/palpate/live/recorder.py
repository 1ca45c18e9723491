"""The recording of a live session, written as it goes on; a kill loses at most the last second."""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from palpate.geometry.shapes import Shape
from palpate.io.estimates_mcap import NOTHING, add_estimates
from palpate.io.mcap_file import MessageWriter, growing_mcap, nanoseconds, scratch_mcap
from palpate.io.recording_mcap import IMAGES, SENSOR_POSES, describe
from palpate.io.ros_messages import COMPRESSED_IMAGE, POSE, MessageSink
from palpate.live.poses import SensorPlace, TimedPose
from palpate.live.session import LiveEstimate
from palpate.live.sources import TouchImage
from palpate.types.estimate import Estimate
from palpate.types.plane import Plane, flat, out_of_plane
from palpate.types.sensor import SensorProfile
from palpate.types.trajectory import Trajectory


class Recorder:
    """Writes images, sensor poses and estimates of a session, from any thread; see Listener."""

    def __init__(self, path: Path, file: MessageWriter) -> None:
        """Record into an open file, whose path errors name."""
        self._path, self._file, self._plane = path, file, flat()
        self._lock = threading.Lock()
        self._is_closed = False

    def image(self, image: TouchImage) -> None:
        """Record an image as it arrived."""
        data, stamp = np.frombuffer(image.encoded(), np.uint8), self._stamp(image.time)
        with self._lock:
            if not self._is_closed:
                header = self._file.header(stamp, "sensor")
                self._file.add(IMAGES, COMPRESSED_IMAGE, stamp, header=header, format=image.codec, data=data)

    def pose(self, pose: TimedPose) -> None:
        """Record a sensor pose as it arrived."""
        (position,), (rotation,) = out_of_plane(self._plane, pose.pose[None])
        stamp = self._stamp(pose.time)
        with self._lock:
            if not self._is_closed:
                header, placed = self._file.header(stamp, self._plane.frame), self._file.pose(position, rotation)
                self._file.add(SENSOR_POSES, POSE, stamp, header=header, pose=placed)

    def estimate(self, last: LiveEstimate) -> None:
        """Record an estimate."""
        stamp = self._stamp(last.estimate.time)
        with self._lock:
            if not self._is_closed:
                add_live_estimate(self._file, self._plane, stamp, last)

    def close(self) -> None:
        """Ignore everything that still arrives."""
        with self._lock:
            self._is_closed = True

    def _stamp(self, time: float) -> int:
        return nanoseconds(self._path, np.array([time]))[0]


def add_live_estimate(
    sink: MessageSink, plane: Plane, stamp: int, last: LiveEstimate, more: Mapping[str, str] = NOTHING
) -> None:
    """Add the messages of an estimate with its stamp [ns], the same in a file and on topics.

    Its diagnostics tell how the sensor's pose was known, the latency, and `more`.
    """
    one, place, latency = last
    trajectory = Trajectory(
        np.array([one.time]), one.pose[None], one.covariance[None], np.array([one.contact]), (one.status,)
    )
    values = {
        "reason": one.reason,
        "sensor pose": place.how,
        "sensor pose age [ms]": f"{1e3 * place.age:.1f}",
        "latency [ms]": f"{1e3 * latency:.1f}",
    }
    answers = one.answers if len(one.answers) > 1 else ()
    add_estimates(sink, trajectory, [stamp], plane, (answers,), {**values, **more})


@contextmanager
def recorder(path: Path, shape: Shape, sensor: SensorProfile, force: bool = False) -> Iterator[Recorder]:
    """Record into a new MCAP; `sensor` has the size of arriving images. FileError if it exists, unless `force`."""
    _write_one_of_each(Recorder(path, scratch_mcap()))
    with growing_mcap(path, force) as file:
        describe(file, shape, sensor)
        file.flush()
        taking = Recorder(path, file)
        try:
            yield taking
        finally:
            taking.close()


def _write_one_of_each(scratch: Recorder) -> None:
    """Write one message of each type to memory, so that loading their types does not delay the first step."""
    zero = np.zeros(3)
    scratch.image(TouchImage(0.0, b"none"))
    scratch.pose(TimedPose(0.0, zero))
    estimate = Estimate(0.0, zero, np.eye(3), False, "resting")
    scratch.estimate(LiveEstimate(estimate, SensorPlace(zero, "known", 0.0), 0.0))
