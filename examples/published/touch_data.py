"""Touch images of published data sets, with what was measured beside them: what the three readers beside this return.

In none of the sets does a sensor push an object of known outline about on a table, so palpate cannot be judged on them
as a whole. They show touch on real gels.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import palpate
from palpate.touch.contact_detector import touched
from palpate.types.images import decode_image, encode_image

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TouchData:
    """N touch images of one sensor with their times and poses."""

    time: Array
    """(N,) [s]"""
    images: list[bytes]
    """N encoded images, in the size and view of the set."""
    sensor_poses: Array | None
    """world_T_sensor (N, 7), x, y, z [m] and a quaternion x, y, z, w, NaN where unknown; None if none were measured."""
    object_poses: Array | None
    """world_T_object, likewise."""
    sensor: palpate.SensorProfile
    source: str
    """Origin of the data, for people."""

    def recording(self, shape: palpate.Shape, **placement: Any) -> palpate.Recording:
        """Return a recording of an object of this shape; `placement` are options of `Recording.from_arrays`."""
        if self.sensor_poses is None:
            raise palpate.FileError(f"{self.source}: no pose of the sensor was measured, and tracking needs them")
        given = self.time, self.images, self.time, self.sensor_poses, shape, self.sensor
        return palpate.Recording.from_arrays(*given, object_poses=self.object_poses, source=self.source, **placement)

    def about(self, calibration: palpate.Calibration | None = None) -> str:
        """Return the content in a line, with the share of images in which palpate sees a touch."""
        poses = self.sensor_poses, self.object_poses
        known = [0 if each is None else int(np.isfinite(each).all(axis=1).sum()) for each in poses]
        height, width, _ = decode_image(self.images[0]).shape
        share = touched(self.images, self.sensor, calibration).mean()
        return (
            f"{self.source}: {len(self.images)} images of {width} x {height} over {np.ptp(self.time):.1f} s; "
            f"{known[0]} poses of the sensor and {known[1]} of the object; {share:.0%} of the images show a touch"
        )


def film(path: Path) -> Iterator[bytes]:
    """Yield the images of a video, encoded. Raises FileError."""
    video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        raise palpate.FileError(f"{path}: is missing, or no video that OpenCV reads")
    for _ in iter(video.grab, False):
        yield encode_image(np.asarray(cv2.cvtColor(video.retrieve()[1], cv2.COLOR_BGR2RGB), np.uint8))


def checked(path: Path, images: list[bytes], **others: Any) -> None:
    """Raise FileError unless there are images, and as many rows of all others."""
    if not images:
        raise palpate.FileError(f"{path}: holds no images")
    for name, rows in others.items():
        if len(rows) != len(images):
            raise palpate.FileError(f"{path}: found {len(rows)} {name} for {len(images)} images, expected one for each")
