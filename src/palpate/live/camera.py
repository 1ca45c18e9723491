"""Images from a camera of this computer, by number or path; or from a video or a folder of images in its place."""

import os
import threading
from collections.abc import Generator, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from itertools import chain, islice, takewhile
from pathlib import Path
from time import sleep, time
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from palpate.errors import FileError, SettingError
from palpate.files import counting_order
from palpate.hints import library
from palpate.live.sources import Clock, Image, ImageSource, Sources, TouchImage, clock_from, together, udp_poses
from palpate.types.choices import Placement
from palpate.types.hand import Hand, check_names
from palpate.types.images import CameraView, camera_view, read_image, scaled
from palpate.types.sensor import SensorProfile
from palpate.types.space import GelPoses

Pictures: TypeAlias = Generator[tuple[float, Any]]
"""Times on the session's clock [s], and pixels in the order of OpenCV, None for a damaged image."""


@contextmanager
def camera_sources(name: str, poses: str, sensor: SensorProfile, placement: Placement) -> Iterator[Sources]:
    """Open a camera (number or path), or a video or folder in its place, and a source of poses.

    Raises SettingError if the camera or the source cannot be opened.
    """
    now = _clock()
    opened = _opened(name, sensor, placement, now)
    with closing(opened.pictures), udp_poses(poses, now, GelPoses(placement)) as source:
        yield Sources(
            opened.images, source, now, opened.sensor, placement.time_offset, _view(sensor, placement).is_stated
        )


@contextmanager
def hand_sources(cameras: Mapping[str, str], poses: str, hand: Hand, placement: Placement) -> Iterator[Sources]:
    """Open a camera for each finger of a hand, see `camera_sources`, and a source of the hand's poses."""
    check_names("--camera", cameras, hand.fingers)
    missing = [finger for finger in hand.fingers if finger not in cameras]
    if missing:
        raise SettingError(f"--camera: finger {missing[0]!r} has none; allowed is one for each")
    now = _clock()
    with ExitStack() as stack:
        opened: dict[str, _Opened] = {}
        for finger, sensor in hand.fingers.items():
            opened[finger] = _opened(cameras[finger], sensor, placement, now)
            stack.enter_context(closing(opened[finger].pictures))
        source = stack.enter_context(udp_poses(poses, now, GelPoses(placement)))
        images = together({finger: each.images for finger, each in opened.items()})
        seen = replace(hand, fingers={finger: each.sensor for finger, each in opened.items()})
        is_stated = all(_view(sensor, placement).is_stated for sensor in hand.fingers.values())
        yield Sources(images, source, now, seen, placement.time_offset, is_stated)


class _Opened(NamedTuple):
    """A camera that is open, or a video or folder in its place."""

    images: ImageSource
    pictures: Pictures
    """Its pictures, to be closed."""
    sensor: SensorProfile
    """The sensor, with the rate that was found; its images are upright."""


def _clock() -> Clock:
    """Return a clock that shows the time since 1970 [s]."""
    now = clock_from(time())
    now()  # it shows the time above when it is first read
    return now


def _view(sensor: SensorProfile, placement: Placement) -> CameraView:
    """Return the way in which the images of a sensor lie."""
    return camera_view(placement.orientation or sensor.orientation)


def _opened(name: str, sensor: SensorProfile, placement: Placement, now: Clock) -> _Opened:
    """Return a camera that is opened by its number or path; see `camera_sources`."""
    path = Path(f"/dev/video{name}" if name.isdecimal() else name)
    is_film = path.is_dir() or path.is_file()
    orientation = placement.orientation or sensor.orientation
    open_images = film if is_film else camera
    rate, pictures = open_images(path, sensor, now)
    first = 0 if is_film else 5  # the first images of a camera are old ones, from the driver's buffer

    def images(stop: threading.Event) -> Iterator[TouchImage | str]:
        for when, pixels in islice(pictures, first, None):
            if stop.is_set():
                return
            yield TouchImage(when, b"" if pixels is None else upright(pixels, sensor, orientation))
        if not is_film:
            yield "the camera is lost, which ends the session"

    return _Opened(images, pictures, replace(sensor, rate=rate, orientation=""))


def camera(path: Path, sensor: SensorProfile, now: Clock) -> tuple[float, Pictures]:
    """Open a camera by OpenCV; return its measured rate [Hz] and its images until it is lost.

    Its exposure settles for a second. Raises SettingError if it cannot be opened or gives no images.
    """
    os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "2")  # [s] instead of 10
    cv2 = library("cv2", "camera", f"camera {path}")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # errors are reported in one sentence

    def pictures() -> Pictures:
        capture = cv2.VideoCapture(str(path), cv2.CAP_V4L2)
        # Cameras have landscape images, also those of a DIGIT.
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, min(sensor.image_height, sensor.image_width))
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, max(sensor.image_height, sensor.image_width))
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        try:
            while path.exists() and capture.grab():  # OpenCV goes on grabbing from an unplugged camera
                yield now(), capture.retrieve()[1]
        finally:
            capture.release()

    opened = pictures()
    begin = now()
    times = [when for when, _ in takewhile(lambda picture: picture[0] < begin + 1.0, opened)]
    if len(times) < 2:
        cause = "another program may use it, or it gives no images" if path.exists() else "there is none"
        raise SettingError(f"camera {path} cannot be opened: {cause}")
    return (len(times) - 1) / (times[-1] - times[0]), opened


def film(path: Path, sensor: SensorProfile, now: Clock) -> tuple[float, Pictures]:
    """Return rate [Hz] and images of a video, or of a folder in the order of their names, in place of a camera's.

    Raises SettingError if there are none.
    """
    if path.is_dir():
        names = sorted(map(str, path.glob("[!.]*")), key=counting_order)
        files = [name for name in names if name.lower().endswith((".png", ".jpg", ".jpeg"))]
        has_images = bool(files)
        rate = sensor.rate
        pixels = map(_picture, files)
    else:
        cv2 = library("cv2", "camera", f"camera {path}: a video")
        video = cv2.VideoCapture(str(path))
        # A video in AV1 opens without a decoder for it (findings/opencv-av1-video-without-frames.sh).
        has_images = video.grab()
        rate = video.get(cv2.CAP_PROP_FPS) or sensor.rate
        pixels = (video.retrieve()[1] for _ in chain([True], iter(video.grab, False)))
    if not has_images:
        raise SettingError(f"camera {path}: is no video that OpenCV reads, nor a folder with PNG or JPEG images")

    def pictures() -> Pictures:
        begin = now()
        for index, image in enumerate(pixels):
            sleep(max(begin + index / rate - now(), 0.0))
            yield begin + index / rate, image

    return rate, pictures()


def _picture(file: str) -> Any:
    """Return the pixels of an image file in the order of OpenCV; None if it is damaged."""
    try:
        return read_image(Path(file))[..., ::-1]
    except FileError:
        return None


def upright(pixels: Any, sensor: SensorProfile, orientation: str) -> Image:
    """Return an image of OpenCV as upright RGB, scaled to a sensor's size if it is a multiple of it.

    If the user has not said how images lie, those on their side are turned as digit-interface turns them.
    """
    size = (sensor.image_height, sensor.image_width)
    view = camera_view(orientation)
    if not orientation and (pixels.shape[0] < pixels.shape[1]) != (size[0] < size[1]):
        view = CameraView(quarter_turns=1)
    image = np.ascontiguousarray(pixels[..., ::-1])
    return scaled(view.of(image), size)
