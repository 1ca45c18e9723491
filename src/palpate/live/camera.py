"""A camera of this computer, found by number, path or serial; or a video, or a folder of images, in its place."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import SettingError
from palpate.live.sources import Clock, Image, ImageSource, Sources, TouchImage, in_time, udp_poses
from palpate.types.images import CameraView, camera_view, scaled
from palpate.types.sensor import SensorProfile
from palpate.types.space import GelPoses

BY_ID = Path("/dev/v4l/by-id")
"""Folder in which Linux lists cameras by serial."""


@contextmanager
def camera(path: Path, sensor: SensorProfile, clock: Clock, orientation: str) -> Iterator[tuple[float, ImageSource]]:
    """Open a camera by OpenCV while the block runs; yield its measured rate [Hz] and its images, until it is lost.

    Its exposure settles for a second. Raises SettingError if it cannot be opened or gives no images.
    """
    os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "2")  # [s] instead of 10
    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # errors are reported in one sentence
    capture = cv2.VideoCapture(str(path), cv2.CAP_V4L2)
    # Cameras have landscape images, also those of a DIGIT.
    sides = sensor.image_height, sensor.image_width
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, min(sides))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, max(sides))
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def read() -> TouchImage | None:
        """Return the next image with the time of its arrival; None if the camera gives none."""
        for _ in range(10):  # more damaged images than that are a fault of the camera
            # OpenCV goes on grabbing from an unplugged camera.
            if not path.exists() or not capture.grab():
                return None
            time = clock.now()
            is_whole, pixels = capture.retrieve()
            if is_whole and pixels is not None and pixels.ndim == 3:
                return TouchImage(time, upright(pixels, sensor, orientation))
        return None

    def images(stop: threading.Event) -> Iterator[TouchImage | str]:
        for _ in range(5):  # old ones, in the driver's buffer
            read()
        while not stop.is_set():
            image = read()
            yield image or "the camera is lost, which ends the session"
            if image is None:
                return

    try:
        times, begin = list[float](), clock.now()
        while clock.now() - begin < 1.0 and (image := read()):
            times.append(image.time)
        if len(times) < 2:
            raise SettingError(f"camera {path} cannot be opened: another program may use it, or it gives no images")
        yield (len(times) - 1) / (times[-1] - times[0]), images
    finally:
        capture.release()


@contextmanager
def film(path: Path, sensor: SensorProfile, clock: Clock, orientation: str) -> Iterator[tuple[float, ImageSource]]:
    """Yield rate [Hz] and images of a video, or of a folder in the order of their names, in place of a camera's.

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

    yield rate, images


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
    name: str, poses: str, sensor: SensorProfile, place: GelPoses, orientation: str, time_offset: float
) -> Iterator[Sources]:
    """Open a camera (number, path or serial), or a video or folder in its place, and a source of poses.

    `place` takes the poses, `orientation` says how images lie, and `time_offset` [s] is added to their times. Raises
    SettingError if camera or source are missing.
    """
    clock = Clock()
    is_film = Path(name).is_dir() or Path(name).is_file()
    opened = (film if is_film else camera)(Path(name) if is_film else camera_path(name), sensor, clock, orientation)
    with opened as (rate, images), udp_poses(poses, clock, place) as source:
        yield Sources(images, source, clock.now, replace(sensor, rate=rate), time_offset)


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
