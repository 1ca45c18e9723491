"""What a live session is made of: an object, a sensor, and where images and poses come from."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.config import NoiseSettings
from palpate.errors import SettingError
from palpate.geometry.shapes import Shape
from palpate.live.camera import Camera
from palpate.live.clock import Clock
from palpate.live.devices import Device, V4l2Device, camera_path
from palpate.live.own_poses import own_poses
from palpate.live.poses import PoseSource
from palpate.live.replay import Replay
from palpate.live.ros2_sources import ros2_poses
from palpate.live.session import Sources
from palpate.live.udp import UdpPoses
from palpate.pipeline.prepared import first_pose_of
from palpate.touch.calibration import Calibration, view_of
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile

Array = NDArray[np.float64]


def _nothing() -> None:
    """What there is to close of what is not open."""


@dataclass(frozen=True, eq=False)
class Rig:
    """What is tracked by what."""

    name: str
    """What to call it."""
    scene: Recording
    """What is known beforehand, for a view: of a camera, one frame."""
    sensor: SensorProfile
    """The sensor, its rate as measured."""
    size: tuple[int, int]
    """Rows and columns of images as they come."""
    first_pose: Array
    """world_T_object at the start, (3,) [m, m, rad]."""
    first_pose_sigma: ArrayLike | None
    """How well it is known, (3,) [m, m, rad]; None leaves that to the noise settings."""
    begin: Callable[[], Sources]
    """Returns the sources, which come from then on, and close what they come from as they end."""
    close: Callable[[], None] = _nothing
    """Lets go of what is open where the session does not begin."""

    @property
    def recorded_sensor(self) -> SensorProfile:
        """The sensor, its images as they come."""
        return replace(self.sensor, image_height=self.size[0], image_width=self.size[1])


def replay_rig(
    recording: Recording, name: str, first_pose: ArrayLike | None, first_pose_sigma: ArrayLike | None = None
) -> Rig:
    """A recording that is played in real time; the first pose is as `tracking.prepared.first_pose_of` finds it."""
    size = (recording.sensor.image_height, recording.sensor.image_width)
    first, sigma = first_pose_of(recording, NoiseSettings(), first_pose, first_pose_sigma)
    replay = Replay(recording)

    def begin() -> Sources:
        replay.begin()
        return Sources(replay.images, replay.poses, replay.clock, size)

    return Rig(name, recording, recording.sensor, size, first, sigma, begin)


def camera_rig(
    name: str,
    poses: str,
    shape: Shape,
    first_pose: ArrayLike,
    first_pose_sigma: ArrayLike | None = None,
    calibration: Calibration | None = None,
    sensor: SensorProfile = DIGIT,
    open_device: Callable[..., Device] = V4l2Device,
) -> Rig:
    """A camera by number, path or serial, and poses by udp:PORT, ros2:TOPIC or an entry point of `palpate.poses`.

    Opens both. Raises SettingError where one of them is not there, or images do not lie as the calibration says.
    """
    size = size_of_images(sensor, calibration)
    clock = Clock(time.time())
    path = camera_path(name)
    camera = Camera(partial(open_device, path, size), clock)
    with ExitStack() as opened:
        opened.callback(camera.close)
        check_size(f"camera {path}", camera.size, size)
        source, close = _pose_source(poses, clock)
        opened.callback(close)
        close_all = opened.pop_all().close
    first = np.asarray(first_pose, np.float64)
    measured = replace(sensor, rate=camera.rate)
    beforehand = Recording(np.zeros(1), first[None], shape, sensor, image=(b"",))
    sources = partial(Sources, camera.images, source, clock, size)
    return Rig(name, beforehand, measured, size, first, first_pose_sigma, sources, close_all)


def size_of_images(sensor: SensorProfile, calibration: Calibration | None) -> tuple[int, int]:
    """Rows and columns of a sensor's images as they come, before they are turned as a calibration says."""
    height, width = sensor.image_height, sensor.image_width
    return (width, height) if view_of(calibration).quarter_turns % 2 else (height, width)


def check_size(what: str, found: tuple[int, int], expected: tuple[int, int]) -> None:
    """Raise SettingError where images of a source have not the rows and columns that are expected."""
    if found != expected:
        turned = "; palpate calibrate --presses finds how they are turned" if found == expected[::-1] else ""
        raise SettingError(
            f"{what}: its images have {found[0]} rows and {found[1]} columns, expected {expected[0]} and "
            f"{expected[1]}{turned}"
        )


def _pose_source(name: str, clock: Clock) -> tuple[PoseSource, Callable[[], None]]:
    """The source of poses with this name, and what closes it where it is not used."""
    if name.startswith("ros2:"):
        return ros2_poses(name.removeprefix("ros2:"), clock)
    if not name.startswith("udp:"):
        return own_poses(name, clock), _nothing
    port: Any = name.removeprefix("udp:")
    if not (port.isdecimal() and 0 < int(port) < 65536):
        raise SettingError(f"poses are to come from {name!r}; allowed are ports from 1 to 65535")
    listening = UdpPoses(int(port), clock)
    return listening.poses, listening.close
