"""Sources of a live session: images and sensor poses as they arrive, with times on one clock."""

import json
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.live.poses import PoseSource, Refused, TimedPose, checked_pose, on_clock
from palpate.types.images import Codec, decode_image, encode_image
from palpate.types.recording import Recording

Image = NDArray[np.uint8]
OWN_POSES = "palpate.poses"
"""Group of entry points: functions without arguments that yield time [s since 1970], x [m], y [m], theta [rad]."""


class Clock:
    """A clock that starts at a given time and runs evenly, even if the computer's clock is set."""

    def __init__(self, start: float) -> None:
        """Start at a time [s], now."""
        self._offset = start - time.monotonic()

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic() + self._offset


class TouchImage(NamedTuple):
    """One touch image as it arrived."""

    time: float
    """Time on the session's clock [s]."""
    data: bytes | Image
    """Encoded bytes, or pixels (height, width, 3) RGB."""
    codec: Codec = "jpeg"
    """Encoding of the bytes, or the one to record pixels with."""

    def pixels(self, size: tuple[int, int] | None = None) -> Image:
        """Return the pixels; FileError if the bytes are damaged or hold an image of another size (rows, columns)."""
        if isinstance(self.data, bytes):
            assert size is not None
            return decode_image(self.data, self.codec, size)
        return self.data

    def encoded(self) -> bytes:
        """Return the bytes to record."""
        return self.data if isinstance(self.data, bytes) else encode_image(self.data, self.codec)


ImageSource = Callable[[threading.Event], Iterator[TouchImage | str]]
"""Yields images as they arrive and, as text, notes for the user; ends when the event is set."""


@dataclass(frozen=True, eq=False)
class Sources:
    """Images and poses of one session, and their common clock."""

    images: ImageSource
    """Touch images."""
    poses: PoseSource
    """Sensor poses."""
    clock: Clock
    """Clock of all times."""
    size: tuple[int, int]
    """Rows and columns of the images as they arrive."""


def replayed(recording: Recording) -> Sources:
    """Return sources that play a recording with images in real time, from shortly after now, with its own times."""
    images = recording.image
    assert images is not None
    clock = Clock(float(recording.time[0]) - 0.05)

    def due(stop: threading.Event) -> Iterator[tuple[int, float]]:
        for index, when in enumerate(recording.time.tolist()):
            if stop.wait(max(0.0, when - clock.now())):
                return
            yield index, when

    def play_images(stop: threading.Event) -> Iterator[TouchImage]:
        return (TouchImage(time, images[index], recording.codec) for index, time in due(stop))

    def play_poses(stop: threading.Event) -> Iterator[TimedPose]:
        return (TimedPose(time, recording.sensor_pose[index]) for index, time in due(stop))

    sensor = recording.sensor
    return Sources(play_images, play_poses, clock, (sensor.image_height, sensor.image_width))


class UdpPoses:
    """Sensor poses as JSON by UDP from this machine: {"time": s since 1970, "pose": [x, y, theta]}.

    A pose without a time gets that of its arrival.
    """

    def __init__(self, port: int, clock: Clock) -> None:
        """Listen on a port of 127.0.0.1, 0 for any that is free; SettingError if it is in use."""
        self._clock = clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise SettingError(f"sensor poses: cannot listen on port {port} of 127.0.0.1 ({error})") from error
        self.port: int = self._socket.getsockname()[1]
        """Port that it listens on."""

    def poses(self, stop: threading.Event) -> Iterator[TimedPose | Refused]:
        """See PoseSource."""
        with self._socket:
            self._socket.setblocking(False)
            with suppress(BlockingIOError):
                while True:  # drop what arrived before the session
                    self._socket.recv(65536)
            self._socket.settimeout(0.1)
            while not stop.is_set():
                try:
                    data = self._socket.recv(65536)
                except TimeoutError:
                    continue
                yield pose_in_packet(data, self._clock.now())

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()


def pose_in_packet(data: bytes, now: float) -> TimedPose | Refused:
    """Return the pose in a packet that arrived at a time [s], or the reason why it is refused."""
    shown = ascii(data[:60].decode("utf-8", errors="replace")) + ("..." if len(data) > 60 else "")
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return Refused(f"{shown} is no JSON")
    if not isinstance(content, dict) or "pose" not in content:
        return Refused(f"{shown} is not of the form {{'time': s, 'pose': [x, y, theta]}}")
    return on_clock(checked_pose(content.get("time", now), content["pose"]), now)


def own_poses(name: str, clock: Clock) -> PoseSource:
    """Return the pose source of an entry point of OWN_POSES; SettingError if there is none or it cannot be loaded."""
    found = {one.name: one for one in entry_points(group=OWN_POSES)}
    if name not in found:
        known = f"known are {', '.join(sorted(found))}" if found else "none is installed"
        allowed = f"udp:PORT, ros2:TOPIC or an entry point of {OWN_POSES}, {known}"
        raise SettingError(f"poses are to come from {name!r}; allowed are {allowed}")
    entry = f"entry point {name} of {OWN_POSES}, {found[name].value},"
    try:
        function: Callable[[], Iterable[Any]] = found[name].load()
    except Exception as error:
        raise SettingError(f"{entry} cannot be loaded: {type(error).__name__}: {error}") from error

    def poses(stop: threading.Event) -> Iterator[TimedPose | Refused]:
        try:
            for item in function():
                if stop.is_set():
                    return
                yield on_clock(_pose_of_item(item), clock.now())
        except Exception as error:
            raise SettingError(f"{entry} ended with {type(error).__name__}: {error}") from error

    return poses


def _pose_of_item(item: Any) -> TimedPose | Refused:
    try:
        time, *numbers = item
    except TypeError:
        return Refused(f"{item!r} is not time, x, y, theta")
    return checked_pose(time, numbers)


def pose_source(name: str, clock: Clock) -> tuple[PoseSource, Callable[[], None]]:
    """Return the pose source udp:PORT, ros2:TOPIC or an entry point of OWN_POSES, and a function that closes it."""
    if name.startswith("ros2:"):
        from palpate.live.ros2_topics import ros2_poses

        return ros2_poses(name.removeprefix("ros2:"), clock)
    if not name.startswith("udp:"):
        return own_poses(name, clock), lambda: None
    port = name.removeprefix("udp:")
    if not (port.isdecimal() and 0 < int(port) < 65536):
        raise SettingError(f"poses are to come from {name!r}; allowed are ports from 1 to 65535")
    listening = UdpPoses(int(port), clock)
    return listening.poses, listening.close
