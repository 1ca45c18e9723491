"""Pictures of the overhead camera: as they come, or of a video that is played in real time."""

import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from palpate.errors import SettingError
from palpate.lab.truth.camera import load_camera
from palpate.lab.truth.tags import Gray
from palpate.lab.truth.video import pictures as pictures_of
from palpate.live.camera import Camera
from palpate.live.clock import Clock
from palpate.live.devices import Device, V4l2Device, camera_path
from palpate.live.truth import LiveTruth, Picture, PictureSource


def overhead_truth(name: str, calibration: Path, open_device: Callable[..., Device] = V4l2Device) -> LiveTruth:
    """Ground truth by a camera by number, path or serial, or a video file, and its file of `palpate truth-camera`.

    Opens the camera. Raises FileError where a file is not what it should be, SettingError where the camera cannot be
    opened or gives pictures of another size.
    """
    seen_by = load_camera(calibration)
    if Path(name).is_file():
        return LiveTruth(partial(_played, Path(name)), seen_by)
    path = camera_path(name)
    # Its clock need not be the session's: how far the two are apart is part of the delay that is found.
    camera = Camera(partial(open_device, path, seen_by.size), Clock(0.0))
    if camera.size != seen_by.size:
        camera.close()
        raise SettingError(
            f"camera {path}: its pictures have {camera.size} rows and columns, {calibration} is for {seen_by.size}"
        )
    return LiveTruth(_coming(camera), seen_by, camera.close)


def _coming(camera: Camera) -> PictureSource:
    def pictures(stop: threading.Event) -> Iterator[Picture | str]:
        import cv2

        for image in camera.images(stop):
            if isinstance(image, str):
                yield f"overhead: {image}"
                continue
            assert not isinstance(image.data, bytes)
            gray: Gray = np.asarray(cv2.cvtColor(image.data, cv2.COLOR_RGB2GRAY), np.uint8)
            yield Picture(image.time, gray)

    return pictures


def _played(video: Path, stop: threading.Event) -> Iterator[Picture | str]:
    clock = Clock(0.0)
    for time, gray in pictures_of(video):
        if stop.wait(max(0.0, time - clock.now())):
            return
        yield Picture(time, gray)
