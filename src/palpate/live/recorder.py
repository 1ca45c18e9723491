"""Recording a live session as it goes on; a kill loses no more than the message that is being written."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from palpate.geometry.shapes import Shape
from palpate.io.bags.live_mcap import ATTACHMENT, MEDIA_TYPE, live_attachment
from palpate.io.bags.mcap_writer import MessageWriter, growing_mcap, nanoseconds, scratch_mcap
from palpate.io.bags.messages import COMPRESSED_IMAGE, POSE, POSE_WITH_COVARIANCE
from palpate.io.bags.recording_mcap import IMAGES, OBJECT_POSES, SENSOR_POSES
from palpate.live.estimate_messages import add_estimate
from palpate.live.images import TouchImage, encoded_of
from palpate.live.poses import SensorPlace, TimedPose
from palpate.live.truth import TruePose
from palpate.types.estimate import Estimate
from palpate.types.plane import flat, out_of_plane
from palpate.types.sensor import SensorProfile

_PLANE = flat()


class Recorder:
    """Takes images, poses and estimates from any thread and writes each at once."""

    def __init__(self, path: Path, file: MessageWriter) -> None:
        """Take the file, whose path errors name."""
        self._path, self._file = path, file
        self._lock = threading.Lock()
        self._closed = False

    def image(self, image: TouchImage) -> None:
        """Record an image as it came."""
        data = np.frombuffer(encoded_of(image), np.uint8)
        stamp = self._stamp(image.time)
        with self._lock:
            if not self._closed:
                header = self._file.header(stamp, "sensor")
                self._file.add(IMAGES, COMPRESSED_IMAGE, stamp, header=header, format=image.codec, data=data)
                self._file.flush()

    def pose(self, pose: TimedPose) -> None:
        """Record a pose of the sensor as it came."""
        position, rotation = out_of_plane(_PLANE, pose.pose[None])
        stamp = self._stamp(pose.time)
        with self._lock:
            if not self._closed:
                header = self._file.header(stamp, _PLANE.frame)
                placed = self._file.pose(position[0], rotation[0])
                self._file.add(SENSOR_POSES, POSE, stamp, header=header, pose=placed)
                self._file.flush()

    def truth(self, true: TruePose) -> None:
        """Record where the object really was."""
        position, rotation = out_of_plane(_PLANE, true.pose[None])
        covariance = np.zeros((6, 6))
        covariance[[0, 1, 5], [0, 1, 5]] = true.sigma**2  # along x and y, and about z
        stamp = self._stamp(true.time)
        with self._lock:
            if not self._closed:
                header = self._file.header(stamp, _PLANE.frame)
                pose = self._file.make(
                    "geometry_msgs/msg/PoseWithCovariance",
                    pose=self._file.pose(position[0], rotation[0]),
                    covariance=covariance.reshape(36),
                )
                self._file.add(OBJECT_POSES, POSE_WITH_COVARIANCE, stamp, header=header, pose=pose)
                self._file.flush()

    def estimate(self, estimate: Estimate, place: SensorPlace, latency: float) -> None:
        """Record an estimate, with how the sensor's pose was known and how long it took [s]."""
        stamp = self._stamp(estimate.time)
        with self._lock:
            if not self._closed:
                add_estimate(self._file, _PLANE, stamp, estimate, place, latency)
                self._file.flush()

    def close(self) -> None:
        """Take nothing more, whoever still has something."""
        with self._lock:
            self._closed = True

    def _stamp(self, time: float) -> int:
        return nanoseconds(self._path, np.array([time]))[0]


@contextmanager
def recorder(path: Path, shape: Shape, sensor: SensorProfile, force: bool = False) -> Iterator[Recorder]:
    """Record into a new MCAP; `sensor` is as its images come. FileError if it exists, unless `force`."""
    _try_out(Recorder(path, scratch_mcap()))
    with growing_mcap(path, force) as file:
        file.attach(ATTACHMENT, MEDIA_TYPE, live_attachment(shape, sensor))
        file.flush()
        taking = Recorder(path, file)
        try:
            yield taking
        finally:
            taking.close()


def _try_out(scratch: Recorder) -> None:
    """Write one of everything, so that no first one keeps a robot waiting."""
    pose = TimedPose(0.0, np.zeros(3))
    scratch.image(TouchImage(0.0, b"none"))
    scratch.pose(pose)
    scratch.truth(TruePose(0.0, pose.pose, np.zeros(3)))
    scratch.estimate(Estimate(0.0, pose.pose, np.eye(3), False, "resting"), SensorPlace(pose.pose, "known", 0.0), 0.0)
