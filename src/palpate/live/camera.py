"""A camera of this computer: found by number, path or serial, settled, and opened again when it is lost."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from palpate.errors import SettingError
from palpate.live.sources import Clock, Image, TouchImage

BY_ID = Path("/dev/v4l/by-id")
"""Folder in which Linux lists cameras by serial."""
_IMAGES = "video-index0"  # ending of the link to a camera's images; further links are metadata


@dataclass(frozen=True)
class CameraTiming:
    """Limits of opening and reading a camera."""

    settled_images: int = 15
    """Consecutive images whose mean brightness must agree before the exposure counts as settled."""
    settled_range: float = 0.5
    """Range of these means [grey levels]."""
    longest_settling: float = 5.0
    """Time after which images are taken as they are [s]."""
    reopen_every: float = 0.5
    """Time between attempts to open a lost camera [s]."""
    stale_images: int = 5
    """Images in the driver's buffer, which are old when reading begins."""
    damaged_images: int = 10
    """Consecutive damaged images after which a camera counts as lost."""


TIMING = CameraTiming()


class Device(Protocol):
    """An open camera."""

    def grab(self) -> bool:
        """Wait for the next image; return False if none arrives, as from a camera that was unplugged."""
        ...

    def image(self) -> Image | None:
        """Return the grabbed image (height, width, 3) RGB; None if it is damaged."""
        ...

    def close(self) -> None:
        """Release the camera."""
        ...


class V4l2Device:
    """A camera read by OpenCV through V4L2."""

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        """Open the camera and ask for images of `size` (rows, columns); SettingError if it cannot be opened."""
        os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "2")  # [s] instead of 10
        import cv2

        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # the error below says it in one sentence
        self._path = path
        self._capture: Any = cv2.VideoCapture(str(path), cv2.CAP_V4L2)
        if not self._capture.isOpened():
            raise SettingError(f"camera {path} cannot be opened: another program may use it, or it gives no images")
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[0])
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[1])
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def grab(self) -> bool:
        """See Device."""
        return self._path.exists() and bool(self._capture.grab())  # OpenCV goes on grabbing from an unplugged camera

    def image(self) -> Image | None:
        """See Device."""
        import cv2

        done, pixels = self._capture.retrieve()
        if not done or pixels is None or pixels.ndim != 3:
            return None
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), np.uint8)

    def close(self) -> None:
        """See Device."""
        self._capture.release()


class Camera:
    """A camera that survives being unplugged and plugged in again."""

    def __init__(self, open_device: Callable[[], Device], clock: Clock) -> None:
        """Open the camera, let its exposure settle and measure its rate; SettingError if it gives no images."""
        self._open, self._clock = open_device, clock
        self._device: Device | None = open_device()
        images = list(self._settling(threading.Event()))
        if len(images) < 2:
            self.close()
            raise SettingError("the camera is open, but gives no images")
        self.size: tuple[int, int] = images[-1].pixels().shape[:2]
        """Rows and columns of its images."""
        self.rate: float = (len(images) - 1) / (images[-1].time - images[0].time)
        """Measured rate [Hz]."""

    def images(self, stop: threading.Event) -> Iterator[TouchImage | str]:
        """Yield each image with the time of its arrival and, as text, notes for the user; ends at the event."""
        try:
            for _ in range(TIMING.stale_images):
                self._read()
            while not stop.is_set():
                image = self._read()
                size = None if image is None else image.pixels().shape[:2]
                if image is not None and size == self.size:
                    yield image
                    continue
                if image is not None:
                    yield f"the camera gives images of {size} rows and columns, not {self.size}"
                yield from self._reopen(stop)
        finally:
            self.close()

    def close(self) -> None:
        """Release the camera."""
        if self._device is not None:
            self._device.close()
        self._device = None

    def _reopen(self, stop: threading.Event) -> Iterator[str]:
        lost = self._clock.now()
        yield "the camera is lost, and is opened again as soon as it is there"
        self.close()
        while self._device is None:
            if stop.wait(TIMING.reopen_every):
                return
            with suppress(SettingError):
                self._device = self._open()
            if self._device is not None and not list(self._settling(stop)):
                self.close()
        yield f"the camera is back after {self._clock.now() - lost:.1f} s"

    def _settling(self, stop: threading.Event) -> Iterator[TouchImage]:
        """Yield images until the exposure has settled or the time for it is over."""
        means: list[float] = []
        begin = self._clock.now()
        while not stop.is_set() and self._clock.now() - begin < TIMING.longest_settling:
            image = self._read()
            if image is None:
                return
            yield image
            means.append(float(image.pixels().mean()))
            if len(means) >= TIMING.settled_images and np.ptp(means[-TIMING.settled_images :]) <= TIMING.settled_range:
                return

    def _read(self) -> TouchImage | None:
        """Return the next image with the time of its arrival; None if the camera gives none."""
        for _ in range(TIMING.damaged_images):
            if self._device is None or not self._device.grab():
                return None
            time = self._clock.now()
            pixels = self._device.image()
            if pixels is not None:
                return TouchImage(time, pixels)
        return None


def camera_path(name: str) -> Path:
    """Return the device of a camera given by number, path, serial or part of a serial.

    Raises SettingError, listing the cameras there are, if the name fits none of them or several.
    """
    if name.isdecimal() and len(name) <= 2:
        name = f"/dev/video{name}"
    links = sorted(BY_ID.glob(f"*{_IMAGES}"))
    names = [f"{link.name.removesuffix(f'-{_IMAGES}')} ({link.resolve()})" for link in links]
    listed = f"cameras are {', '.join(names)}" if names else "no camera is connected"
    if name.startswith("/"):
        if not Path(name).exists():
            raise SettingError(f"camera {name}: there is no such device; {listed}")
        return Path(name)
    found = [link for link in links if name in link.name]
    if len(found) == 1:
        return found[0]
    fault = f"fits {len(found)} cameras" if found else "is no number, path or serial of a camera"
    raise SettingError(f"camera {name!r} {fault}; {listed}")
