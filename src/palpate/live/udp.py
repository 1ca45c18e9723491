"""Sensor poses as JSON by UDP, from programs on this machine: {"time": 1700000000.25, "pose": [x, y, theta]}.

The time is that of the computer's clock [s since 1970] when the sensor was there; without one, a pose is of the time at
which it came. The pose is world_T_sensor [m, m, rad].
"""

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import suppress

from palpate.errors import SettingError
from palpate.live.clock import Clock
from palpate.live.poses import Refused, TimedPose, checked_pose

LONGEST_OFF = 1.0
"""[s] that a pose's time may be off the clock."""

_LARGEST = 65536  # bytes of a packet
_LOOK = 0.1  # [s] between looks at the event
_SHOWN = 60  # characters of what was refused


class UdpPoses:
    """Listens on a port of the loopback address."""

    def __init__(self, port: int, clock: Clock) -> None:
        """Begin to listen; port 0 is any that is free. Raises SettingError where the port is in use."""
        self._clock = clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise SettingError(f"sensor poses: cannot listen on port {port} of 127.0.0.1 ({error})") from error
        self._socket.settimeout(_LOOK)
        self.port: int = self._socket.getsockname()[1]
        """Where it listens."""

    def poses(self, stop: threading.Event) -> Iterator[TimedPose | Refused]:
        """Yield each pose that comes, and what is wrong with anything else; ends at the event."""
        with self._socket:
            self._forget_old()
            while not stop.is_set():
                try:
                    data = self._socket.recv(_LARGEST)
                except TimeoutError:
                    continue
                yield pose_in(data, self._clock.now())

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()

    def _forget_old(self) -> None:
        """Pass over what came while nobody listened."""
        self._socket.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                self._socket.recv(_LARGEST)
        self._socket.settimeout(_LOOK)


def pose_in(data: bytes, now: float) -> TimedPose | Refused:
    """The pose in a packet that came at a time [s]."""
    try:
        said = json.loads(data)
    except (ValueError, RecursionError):
        return Refused(f"{_shown(data)} is no JSON")
    if not isinstance(said, dict) or "pose" not in said:
        return Refused(f"{_shown(data)} is not of the form {{'time': s, 'pose': [x, y, theta]}}")
    return timely(checked_pose(said.get("time", now), said["pose"]), now)


def timely(pose: TimedPose | Refused, now: float) -> TimedPose | Refused:
    """The pose, or that its time is too far off the clock [s]."""
    if isinstance(pose, TimedPose) and abs(pose.time - now) > LONGEST_OFF:
        return Refused(f"its time {pose.time:.3f} s is {pose.time - now:+.1f} s off this computer's clock")
    return pose


def _shown(data: bytes) -> str:
    return ascii(data[:_SHOWN].decode("utf-8", errors="replace")) + ("..." if len(data) > _SHOWN else "")
