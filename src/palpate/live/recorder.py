"""The recording of a live session, written as it goes on; a kill loses at most the last second."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from palpate.geometry.shapes import Shape
from palpate.io.estimates_mcap import add_estimate
from palpate.io.recording_mcap import IMAGES, SENSOR_POSES, describe
from palpate.io.ros_messages import nanoseconds, new_mcap, ros_types
from palpate.live.session import Listen
from palpate.live.sources import TimedPose, TouchImage
from palpate.types.estimate import Estimate
from palpate.types.images import encode_image
from palpate.types.sensor import SensorProfile
from palpate.types.space import flat


@contextmanager
def recorder(path: Path, shape: Shape, sensor: SensorProfile, force: bool = False) -> Iterator[Listen]:
    """Yield a function that records into a new MCAP; `sensor` has the size of arriving images.

    Raises FileError if the file exists, unless `force`.
    """
    ros_types("cdr")  # loading them takes a quarter of a second, which the first step should not wait for
    plane = flat()
    with new_mcap(path, force, growing=True) as file:
        describe(file, shape, sensor)

        def record(item: TouchImage | TimedPose | Estimate) -> None:
            (stamp,) = nanoseconds(path, np.array([item.time]))
            if isinstance(item, Estimate):
                add_estimate(file, plane, stamp, item)
            elif isinstance(item, TimedPose):
                file.add_pose(SENSOR_POSES, stamp, plane, item.pose)
            else:
                file.add_image(IMAGES, stamp, item.data if isinstance(item.data, bytes) else encode_image(item.data))

        yield record
