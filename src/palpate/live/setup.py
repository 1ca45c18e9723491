"""The set-up of a live session: an object, a sensor, and the sources of images and poses."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import NoiseSettings
from palpate.errors import SettingError
from palpate.geometry.shapes import Shape
from palpate.live.camera import Camera, Device, V4l2Device, camera_path
from palpate.live.sources import Clock, Sources, pose_source, replayed
from palpate.pipeline.track import first_pose_of
from palpate.touch.calibration import Calibration, view_of
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile


@dataclass(frozen=True, eq=False)
class SetUp:
    """Everything that a live session starts with."""

    name: str
    """Name for people."""
    scene: Recording
    """The recording that is replayed; of a camera, a recording of one frame that says what is tracked."""
    sensor: SensorProfile
    """The sensor with its measured rate."""
    size: tuple[int, int]
    """Rows and columns of images as they arrive."""
    first_pose: NDArray[np.float64]
    """world_T_object at the start, (3,) [m, m, rad]."""
    first_pose_sigma: ArrayLike | None
    """Its standard deviations, (3,) [m, m, rad]; None for the default."""
    start: Callable[[], Sources]
    """Starts the sources, whose threads close what they read from."""
    close: Callable[[], None] = lambda: None
    """Closes the sources if the session does not start."""

    @property
    def recorded_sensor(self) -> SensorProfile:
        """The sensor with the size of images as they arrive."""
        return replace(self.sensor, image_height=self.size[0], image_width=self.size[1])


def replay_set_up(
    recording: Recording, name: str, first_pose: ArrayLike | None, first_pose_sigma: ArrayLike | None = None
) -> SetUp:
    """Return the set-up that replays a recording in real time.

    Raises SettingError if it has no images, FileError if the first one is damaged.
    """
    if recording.image is None:
        raise SettingError(f"{recording.file or 'the recording'}: has no images, and live tracking needs them")
    recording[0]  # loads OpenCV and finds damaged images now, not in the first step
    first, sigma = first_pose_of(recording, NoiseSettings(), first_pose, first_pose_sigma)
    sensor = recording.sensor
    size = sensor.image_height, sensor.image_width
    return SetUp(name, recording, sensor, size, first, sigma, partial(replayed, recording))


def camera_set_up(
    name: str,
    poses: str,
    shape: Shape,
    first_pose: ArrayLike,
    first_pose_sigma: ArrayLike | None = None,
    calibration: Calibration | None = None,
    sensor: SensorProfile = DIGIT,
    open_device: Callable[..., Device] = V4l2Device,
) -> SetUp:
    """Open a camera (number, path or serial) and a source of poses (see `pose_source`).

    Raises SettingError if one of them is missing or images have another size than the calibration's.
    """
    size = size_of_images(sensor, calibration)
    clock = Clock(time.time())
    path = camera_path(name)
    with ExitStack() as opened:
        camera = Camera(partial(open_device, path, size), clock)
        opened.callback(camera.close)
        check_size(f"camera {path}", camera.size, size)
        source, close_source = pose_source(poses, clock)
        opened.callback(close_source)
        close = opened.pop_all().close
    first = np.asarray(first_pose, np.float64)
    scene = Recording(np.zeros(1), first[None], shape, sensor, image=(b"",))
    start = partial(Sources, camera.images, source, clock, size)
    return SetUp(name, scene, replace(sensor, rate=camera.rate), size, first, first_pose_sigma, start, close)


def size_of_images(sensor: SensorProfile, calibration: Calibration | None) -> tuple[int, int]:
    """Return rows and columns of a sensor's images as they arrive, before a calibration turns them."""
    height, width = sensor.image_height, sensor.image_width
    return (width, height) if view_of(calibration).quarter_turns % 2 else (height, width)


def check_size(source: str, found: tuple[int, int], expected: tuple[int, int]) -> None:
    """Raise SettingError if images of a source have other rows and columns than expected."""
    if found != expected:
        turned = "; palpate calibrate --presses finds how they are turned" if found == expected[::-1] else ""
        raise SettingError(
            f"{source}: its images have {found[0]} rows and {found[1]} columns, expected {expected[0]} and "
            f"{expected[1]}{turned}"
        )


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C and SIGTERM set, so that a session ends in order and its files are complete."""
    stop = threading.Event()
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
