"""A camera of this computer: found by number, path or serial, settled, and opened again when it is lost."""

import os
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import SettingError
from palpate.live.sources import Clock, Sources, TouchImage, pose_source
from palpate.touch.calibration import Calibration, turned_as
from palpate.types.sensor import SensorProfile

BY_ID = Path("/dev/v4l/by-id")
"""Folder in which Linux lists cameras by serial."""


class Camera:
    """A camera read through V4L2 by OpenCV, that survives being unplugged and plugged in again."""

    def __init__(self, path: Path, sensor: SensorProfile, clock: Clock) -> None:
        """Open the camera and measure its rate. Raises SettingError if it cannot be opened or gives no images."""
        self._path, self._sensor, self._clock = path, sensor, clock
        self._capture: Any = None
        images = self._open()
        if not images:
            raise SettingError(f"camera {path} cannot be opened: another program may use it, or it gives no images")
        self.rate: float = (len(images) - 1) / (images[-1].time - images[0].time)
        """Measured rate [Hz]."""

    def images(self, stop: threading.Event) -> Iterator[TouchImage | str]:
        """Yield each image with the time of its arrival and, as text, notes for the user; ends at the event."""
        for _ in range(5):  # old ones, in the driver's buffer
            self._read()
        while not stop.is_set():
            if image := self._read():
                yield image
                continue
            lost = self._clock.now()
            yield "the camera is lost, and is opened again as soon as it is there"
            self.close()
            while not stop.wait(0.5):
                if self._open():
                    yield f"the camera is back after {self._clock.now() - lost:.1f} s"
                    break

    def close(self) -> None:
        """Release the camera."""
        if self._capture is not None:
            self._capture.release()
        self._capture = None

    def _open(self) -> list[TouchImage]:
        """Open the camera and return the images of one second, in which its exposure settles; none if that fails."""
        os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "2")  # [s] instead of 10
        import cv2

        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # errors are reported in one sentence
        capture = cv2.VideoCapture(str(self._path), cv2.CAP_V4L2)
        if not capture.isOpened():
            return []
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._sensor.image_height)
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._sensor.image_width)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self._capture = capture
        images, begin = [], self._clock.now()
        while self._clock.now() - begin < 1.0 and (image := self._read()):
            images.append(image)
        if len(images) < 2:
            self.close()
            return []
        return images

    def _read(self) -> TouchImage | None:
        """Return the next image with the time of its arrival; None if the camera gives none."""
        import cv2

        for _ in range(10):  # more damaged images than that are a fault of the camera
            # OpenCV goes on grabbing from an unplugged camera.
            if not self._path.exists() or not self._capture.grab():
                return None
            time = self._clock.now()
            is_whole, pixels = self._capture.retrieve()
            if is_whole and pixels is not None and pixels.ndim == 3:
                return TouchImage(time, np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), np.uint8))
        return None


@contextmanager
def camera_sources(name: str, poses: str, sensor: SensorProfile, calibration: Calibration | None) -> Iterator[Sources]:
    """Open a camera (number, path or serial) and a source of poses while the block runs.

    Raises SettingError if one of them is missing.
    """
    arriving, clock = turned_as(sensor, calibration), Clock()
    with closing(Camera(camera_path(name), arriving, clock)) as camera, pose_source(poses, clock) as source:
        yield Sources(camera.images, source, clock, replace(arriving, rate=camera.rate))


def camera_path(name: str) -> Path:
    """Return the device of a camera given by number, path, serial or part of a serial.

    Raises SettingError, listing the cameras there are, if the name fits none of them or several.
    """
    if name.isdecimal() and len(name) <= 2:
        name = f"/dev/video{name}"
    links = sorted(BY_ID.glob("*-video-index0"))  # further links of a camera are metadata
    found = [link for link in links if name in link.name]
    if name.startswith("/"):
        found = [Path(name)] if Path(name).exists() else []
    if len(found) != 1:
        names = ", ".join(f"{link.name} ({link.resolve()})" for link in links) or "none"
        raise SettingError(f"camera {name} fits {len(found)} of the cameras that are connected: {names}")
    return found[0]
