"""Sources, cameras and trackers of live sessions that tests steer."""

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

SIZE = (320, 240)
"""Rows and columns of the camera's images."""


class FakeCapture:
    """Stands for OpenCV's camera: brightens up when opened, is touched after a while, and can be unplugged."""

    def __init__(self, size: tuple[int, int] = SIZE, rate: float = 100.0) -> None:
        self.size, self.rate = size, rate
        self.is_plugged, self.opened, self.released, self.count = True, 0, 0, 0
        self.asked: dict[int, float] = {}
        self.touched_from = np.inf

    def __call__(self, path: str, api: int) -> "FakeCapture":
        self.opened += self.is_plugged
        self.count = 0
        return self

    def isOpened(self) -> bool:
        return self.is_plugged

    def set(self, name: int, value: float) -> None:
        self.asked[name] = value

    def grab(self) -> bool:
        time.sleep(1.0 / self.rate)
        self.count += 1
        return self.is_plugged

    def retrieve(self) -> tuple[bool, Any]:
        if self.count % 7 == 0:
            return False, None  # damaged
        image = np.full((*self.size, 3), (10, 30, min(6 * self.count, 60)), np.uint8)  # blue first
        if self.count > self.touched_from:
            image[100:200, 80:160] += 60
        return True, image

    def release(self) -> None:
        self.released += 1


def free_port() -> int:
    """A UDP port that nobody listens on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@contextmanager
def sending(packets: Callable[[int], bytes], port: int, every: float = 0.01) -> Iterator[None]:
    """Send the packets of numbers 0, 1, ... to a port while the block runs."""
    done = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            number = 0
            while not done.wait(every):
                sender.sendto(packets(number), ("127.0.0.1", port))
                number += 1

    robot = threading.Thread(target=send)
    robot.start()
    try:
        yield
    finally:
        done.set()
        robot.join()


def pose_packet(pose: Any = (0.1, 0.05, 0.0)) -> bytes:
    """The pose of a sensor, now."""
    return json.dumps({"time": time.time(), "pose": list(pose)}).encode()


def wait_for(is_so: Callable[[], bool]) -> None:
    """Wait until something is so, for a while."""
    last = time.monotonic() + 20.0
    while not is_so():
        assert time.monotonic() < last, "it never came to be"
        time.sleep(0.005)
