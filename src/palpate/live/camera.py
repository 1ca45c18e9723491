"""A camera of this computer, found by number, path or serial; or a video, or a folder of images, in its place."""

import os
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import SettingError
from palpate.live.sources import Clock, Image, ImageSource, Sources, TouchImage, in_time, udp_poses
from palpate.touch.calibration import Calibration, turned_as
from palpate.types.images import CameraView, camera_view, scaled
from palpate.types.sensor import SensorProfile
from palpate.types.space import GelPoses

BY_ID = Path("/dev/v4l/by-id")
"""Folder in which Linux lists cameras by serial."""


class Camera:
    """A camera read through V4L2 by OpenCV, that survives being unplugged and plugged in again."""

    def __init__(self, path: Path, sensor: SensorProfile, clock: Clock, orientation: str) -> None:
        """Open the camera and measure its rate. Raises SettingError if it cannot be opened or gives no images."""
        self._path, self._sensor, self._clock, self._orientation = path, sensor, clock, orientation
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
        # Cameras have landscape images, also those of a DIGIT.
        sides = self._sensor.image_height, self._sensor.image_width
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, min(sides))
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, max(sides))
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
        for _ in range(10):  # more damaged images than that are a fault of the camera
            # OpenCV goes on grabbing from an unplugged camera.
            if not self._path.exists() or not self._capture.grab():
                return None
            time = self._clock.now()
            is_whole, pixels = self._capture.retrieve()
            if is_whole and pixels is not None and pixels.ndim == 3:
                return TouchImage(time, upright(pixels, self._sensor, self._orientation))
        return None


def film(path: Path, sensor: SensorProfile, clock: Clock, orientation: str) -> tuple[float, ImageSource]:
    """Return rate [Hz] and images of a video, or of a folder in the order of their names, in place of a camera's.

    Raises SettingError if there are none.
    """
    import cv2

    if path.is_dir():
        files = sorted(str(file) for file in path.iterdir() if file.suffix.lower() in (".png", ".jpg", ".jpeg"))
        is_film, rate = bool(files), sensor.rate
        pixels = (cv2.imread(file, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION) for file in files)
    else:
        video = cv2.VideoCapture(str(path))
        is_film, rate = video.isOpened(), video.get(cv2.CAP_PROP_FPS) or sensor.rate
        pixels = (video.retrieve()[1] for _ in iter(video.grab, False))
    if not is_film:
        raise SettingError(f"camera {path}: is no video that OpenCV reads, nor a folder with PNG or JPEG images")

    def images(stop: threading.Event) -> Iterator[TouchImage | str]:
        begin = clock.now()
        due = in_time((begin + index / rate for index in count()), clock, stop)
        for time, image in zip(due, pixels, strict=False):
            yield "an image is damaged" if image is None else TouchImage(time, upright(image, sensor, orientation))

    return rate, images


def upright(pixels: Any, sensor: SensorProfile, orientation: str) -> Image:
    """Return an image of OpenCV as RGB in a sensor's size; other sizes than multiples of it stay.

    Without words on how they lie, landscape images are turned as digit-interface turns them.
    """
    import cv2

    size, view = (sensor.image_height, sensor.image_width), camera_view(orientation)
    if not orientation and (pixels.shape[0] < pixels.shape[1]) != (size[0] < size[1]):
        view = CameraView(1)
    return scaled(view.of(np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), np.uint8)), size)


@contextmanager
def camera_sources(
    name: str,
    poses: str,
    sensor: SensorProfile,
    calibration: Calibration | None,
    place: GelPoses,
    orientation: str = "",
    time_offset: float = 0.0,
) -> Iterator[Sources]:
    """Open a camera (number, path or serial), or a video or folder in its place, and a source of poses.

    `place` takes the poses, `orientation` says how images lie, and `time_offset` [s] is added to their times. Raises
    SettingError if camera or source are missing.
    """
    arriving, clock = turned_as(sensor, calibration), Clock()
    path = Path(name)
    with ExitStack() as stack:
        if path.is_dir() or path.is_file():
            rate, images = film(path, arriving, clock, orientation)
        else:
            camera = stack.enter_context(closing(Camera(camera_path(name), arriving, clock, orientation)))
            rate, images = camera.rate, camera.images
        source = stack.enter_context(udp_poses(poses, clock, place))
        yield Sources(images, source, clock, replace(arriving, rate=rate), time_offset)


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
