"""Cameras as OpenCV reads them by V4L2, found by number, path or serial."""

import os
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from palpate.errors import SettingError
from palpate.live.images import Image

BY_ID = Path("/dev/v4l/by-id")
"""Where Linux lists cameras with their serials."""

_TIMEOUT = "2"  # [s] that OpenCV waits for an image, 10 by default
_FIRST = "video-index0"  # how links to a camera's images end; further ones are metadata


class Device(Protocol):
    """A camera that is open."""

    def grab(self) -> bool:
        """Wait for the next image; False where none comes, as from a camera that was unplugged."""
        ...

    def image(self) -> Image | None:
        """Return the grabbed image (height, width, 3) RGB; None where it is damaged."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


class V4l2Device:
    """A camera of this computer."""

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        """Open it and ask for images of so many rows and columns. Raises SettingError where it cannot be opened."""
        os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", _TIMEOUT)
        import cv2

        # What is wrong is said here in a sentence, and not by OpenCV as well.
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        self._path = path
        self._capture: Any = cv2.VideoCapture(str(path), cv2.CAP_V4L2)
        if not self._capture.isOpened():
            raise SettingError(f"camera {path} cannot be opened: another program may use it, or it gives no images")
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[0])
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[1])
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def grab(self) -> bool:
        """Wait for the next image; False where none comes."""
        # OpenCV may go on reading a camera that was unplugged.
        return self._path.exists() and bool(self._capture.grab())

    def image(self) -> Image | None:
        """Return the grabbed image (height, width, 3) RGB; None where it is damaged."""
        import cv2

        done, pixels = self._capture.retrieve()
        if not done or pixels is None or pixels.ndim != 3:
            return None
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), np.uint8)

    def close(self) -> None:
        """Let go of it."""
        self._capture.release()


def camera_path(name: str) -> Path:
    """Return the device of a camera by number, path or serial, or part of it.

    Raises SettingError that lists the cameras where it is none of them, or several.
    """
    if name.isdecimal() and len(name) <= 2:
        name = f"/dev/video{name}"
    if name.startswith("/"):
        if not Path(name).exists():
            raise SettingError(f"camera {name}: there is no such device; {_listed()}")
        return Path(name)
    found = [link for link in _links() if name in link.name]
    if len(found) == 1:
        return found[0]
    what = f"stands for {len(found)} cameras" if found else "is no number, path or serial of a camera"
    raise SettingError(f"camera {name!r} {what}; {_listed()}")


def _links() -> list[Path]:
    return sorted(BY_ID.glob(f"*{_FIRST}")) if BY_ID.is_dir() else []


def _listed() -> str:
    names = [f"{link.name.removesuffix(f'-{_FIRST}')} ({link.resolve()})" for link in _links()]
    return f"cameras are {', '.join(names)}" if names else "no camera is connected"
