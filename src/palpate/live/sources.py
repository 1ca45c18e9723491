"""Sources of a live session: images and sensor poses as they arrive, with times on one clock.

A source is a generator that the session runs in a thread. It yields images or poses as they arrive and, as text, notes
for the user. It ends when the event is set.
"""

import json
import logging
import math
import socket
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from queue import SimpleQueue
from typing import Any, NamedTuple

import numpy as np

from palpate.arrays import Array, Image
from palpate.errors import FileError, FrameError, SettingError
from palpate.files import column_name
from palpate.geometry import se2
from palpate.io.pose_tables import names_time
from palpate.io.recording import Recording
from palpate.types.hand import Hand
from palpate.types.sensor import SensorProfile
from palpate.types.space import UPSIDE_DOWN, GelPoses

logger = logging.getLogger(__name__)

Clock = Callable[[], float]
"""Returns the time [s]."""


def clock_from(start: float) -> Clock:
    """Return a clock that shows `start` [s] when it is first read; it does not jump if the computer's clock is set."""
    begin = cache(time.monotonic)
    return lambda: start - begin() + time.monotonic()


class TouchImage(NamedTuple):
    """One touch image as it arrived."""

    time: float
    """Time on the session's clock [s]."""
    data: bytes | Image
    """Encoded bytes, or pixels (height, width, 3) RGB."""
    finger: str = ""
    """Name of the finger of a hand; empty for one sensor."""


class TimedPose(NamedTuple):
    """Sensor pose at one time."""

    time: float
    """Time on the session's clock [s]."""
    pose: Array
    """world_T_sensor, (3,) [m, m, rad]."""


ImageSource = Callable[[threading.Event], Iterator[TouchImage | str]]
PoseSource = Callable[[threading.Event], Iterator[TimedPose | FrameError | str]]


@dataclass(frozen=True, eq=False)
class Sources:
    """Images and poses of one session."""

    images: ImageSource
    poses: PoseSource
    """Poses of the sensor."""
    now: Clock
    """Their common clock."""
    sensor: SensorProfile | Hand
    """The sensor, with the rate of its images, and their size as they arrive, before a calibration turns them; or the
    hand, whose fingers each have their images."""
    time_offset: float = 0.0
    """Added to the times of images [s]: negative if they are stamped late."""
    is_view_known: bool = False
    """True if `orientation` said how images lay, so that they are upright for sure."""


def together(by_finger: Mapping[str, ImageSource]) -> ImageSource:
    """Return the images of a hand's fingers as one source, which ends when all of them have ended.

    What one of them raises comes with the finger's name before it.
    """

    def images(stop: threading.Event) -> Iterator[TouchImage | str]:
        arrived: SimpleQueue[TouchImage | str | Exception | None] = SimpleQueue()

        def read(finger: str, source: ImageSource) -> None:
            try:
                for item in source(stop):
                    arrived.put(f"finger {finger}: {item}" if isinstance(item, str) else item._replace(finger=finger))
            except Exception as error:
                arrived.put(error)
            arrived.put(None)

        for finger, source in by_finger.items():
            threading.Thread(target=read, args=(finger, source), daemon=True).start()
        left = len(by_finger)
        while left:
            item = arrived.get()
            if isinstance(item, Exception):
                raise item
            if item is None:
                left -= 1
            else:
                yield item

    return images


class PoseTrack:
    """The latest sensor poses, and the pose at the time of an image."""

    def __init__(self) -> None:
        self._poses: deque[TimedPose] = deque(maxlen=4096)

    def add(self, pose: TimedPose) -> FrameError | None:
        """Add a pose; return the error, and do not add it, if it is not later than the last."""
        if self._poses and pose.time <= self._poses[-1].time:
            return FrameError(f"its time {pose.time:.3f} s is not after the last one's, {self._poses[-1].time:.3f} s")
        self._poses.append(pose)
        return None

    def reaches(self, time: float) -> bool:
        """Return True if there is a pose at or after a time [s]."""
        return bool(self._poses) and self._poses[-1].time >= time

    def at(self, time: float) -> Array | FrameError:
        """Return the pose (3,) at a time [s].

        The motion of the last 50 ms is extrapolated if no later pose is known, but not over more than 150 ms.
        """
        count = bisect_right(self._poses, time, key=lambda pose: pose.time)
        if not count:
            return FrameError("none has come before it")
        last = self._poses[count - 1]
        age = time - last.time
        if age > 0.15:
            return FrameError(f"the last one before it is {age:.2f} s older, allowed are 0.15 s")
        if count < len(self._poses):
            start = last
            end = self._poses[count]
        else:
            start = next(pose for pose in self._poses if pose.time >= last.time - 0.05)
            end = last
        if start is end:
            return last.pose
        step = end.pose - start.pose
        step[2] = se2.wrap(step[2])  # the shorter way round
        pose = start.pose + (time - start.time) / (end.time - start.time) * step
        pose[2] = se2.wrap(pose[2])
        return pose


def replayed(recording: Recording) -> Sources:
    """Return sources that play a recording in real time, with its own times, from 0 s if it begins before that.

    Those of a hand come at the times of their frames. Raises SettingError if it has no images, or poses of fingers.
    """
    name = recording.file or "the recording"
    by_finger = {"": recording.image} if recording.hand is None else recording.images or {}
    images = {finger: each for finger, each in by_finger.items() if each is not None}
    if not images:
        raise SettingError(f"{name}: has no images, and live tracking needs them")
    if recording.finger_poses is not None:
        raise SettingError(f"{name}: has poses of fingers; live takes those of the hand, to which fingers are mounted")
    with suppress(FileError):
        recording[0]  # loads OpenCV before the session, not in its first step
    times = (recording.time - min(recording.time[0], 0.0)).tolist()
    now = clock_from(times[0] - 0.05)  # a moment for the threads to start

    def play(kind: Any, values: Iterable[Any], stop: threading.Event) -> Iterator[Any]:
        """Yield each value when the clock reaches its time; an image of no bytes is none."""
        for when, value in zip(times, values, strict=True):
            if stop.wait(max(0.0, when - now())):
                return
            if len(value):
                yield kind(when, value)

    played: dict[str, ImageSource] = {finger: partial(play, TouchImage, each) for finger, each in images.items()}
    play_images = together(played) if recording.hand else played[""]
    play_poses = partial(play, TimedPose, recording.sensor_pose)
    sensor = recording.hand or recording.sensor
    return Sources(play_images, play_poses, now, sensor, is_view_known=recording.is_view_known)


@contextmanager
def udp_poses(name: str, now: Clock, gel_poses: GelPoses) -> Iterator[PoseSource]:
    """Listen for poses at a port of this machine, udp:PORT, while the block runs. Raises SettingError.

    They are JSON, {"time": s since 1970, "pose": [x, y, theta]}; without a time, a pose has that of its arrival. A pose
    may also be x, y, z and a quaternion x, y, z, w, or a 4x4 matrix.
    """
    kind, _, port = name.partition(":")
    if kind != "udp" or not (port.isdecimal() and 0 < int(port) < 65536):
        raise SettingError(f"poses are to come from {name!r}; allowed is udp:PORT, with ports from 1 to 65535")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        try:
            listening.bind(("127.0.0.1", int(port)))
        except OSError as error:
            raise SettingError(f"sensor poses: cannot listen on port {port} of 127.0.0.1 ({error})") from error

        def receive(stop: threading.Event) -> Iterator[TimedPose | FrameError]:
            listening.setblocking(False)
            with suppress(BlockingIOError):
                while True:  # drop what arrived before the session
                    listening.recv(65536)
            listening.settimeout(0.1)
            while not stop.is_set():
                with suppress(TimeoutError):
                    yield _pose_in(listening.recv(65536), now(), gel_poses)

        yield receive


def _pose_in(packet: bytes, now: float, gel_poses: GelPoses) -> TimedPose | FrameError:
    """Return the pose in a packet, or the reason to refuse it."""
    try:
        content = json.loads(packet)
        times = [name for name, _ in content.items() if names_time(column_name(name))]
        if times and "time" not in times:
            return FrameError(f"its time is named {times[0][:60]!a}; allowed is 'time', in seconds since 1970")
        return checked_pose(content.get("time", now), content["pose"], now, gel_poses)
    except (ValueError, RecursionError, AttributeError, KeyError):
        return FrameError(f"{packet[:60]!a} is not JSON of the form {{'time': s, 'pose': [x, y, theta]}}")


def checked_pose(
    time: Any, numbers: Any, now: float, gel_poses: GelPoses, frame: str = "world"
) -> TimedPose | FrameError:
    """Return the gel's pose at a time [s] from the pose of the part that carries it, or the reason to refuse it."""
    try:
        when = float(time)
        is_first = gel_poses.plane is None
        pose = gel_poses(numbers, frame)
        if is_first and gel_poses.is_upside_down:
            logger.warning("sensor poses: %s", UPSIDE_DOWN)
    except FileError as error:
        return FrameError(str(error))
    except (TypeError, ValueError, OverflowError):
        return FrameError(f"time {time!r} and pose {numbers!r} are not numbers")
    if not np.isfinite(pose).all() or not math.isfinite(when):
        return FrameError(f"time {time!r}, pose {numbers!r}; allowed are finite numbers: time, and x, y, theta")
    if abs(when - now) > 1.0:  # its sender has another clock
        return FrameError(f"its time {when:.3f} s is {when - now:+.1f} s off this computer's clock")
    return TimedPose(when, pose)
