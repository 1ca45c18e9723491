"""The recording of a live session, written as it goes on; a kill loses at most the last second."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from palpate.geometry.shapes import Shape
from palpate.io.estimates_mcap import add_estimates
from palpate.io.mcap_file import growing_mcap, nanoseconds
from palpate.io.recording_mcap import IMAGES, SENSOR_POSES, describe
from palpate.io.ros_messages import COMPRESSED_IMAGE, POSE, MessageSink, ros_types
from palpate.live.session import Listen
from palpate.live.sources import TimedPose, TouchImage
from palpate.pipeline.track import gathered
from palpate.types.estimate import Estimate
from palpate.types.images import codec_of, encode_image
from palpate.types.sensor import SensorProfile
from palpate.types.space import Plane, flat, out_of_plane


@contextmanager
def recorder(path: Path, shape: Shape, sensor: SensorProfile, force: bool = False) -> Iterator[Listen]:
    """Yield a function that records into a new MCAP; `sensor` has the size of arriving images.

    Raises FileError if the file exists, unless `force`.
    """
    ros_types("cdr")  # loading them takes a quarter of a second, which the first step should not wait for
    plane = flat()
    with growing_mcap(path, force) as file:
        describe(file, shape, sensor)

        def record(item: TouchImage | TimedPose | Estimate) -> None:
            (stamp,) = nanoseconds(path, np.array([item.time]))
            if isinstance(item, Estimate):
                add_live_estimate(file, plane, stamp, item, {})
            elif isinstance(item, TimedPose):
                (position,), (rotation,) = out_of_plane(plane, item.pose[None])
                header, pose = file.header(stamp, plane.frame), file.pose(position, rotation)
                file.add(SENSOR_POSES, POSE, stamp, header=header, pose=pose)
            else:
                data = item.data if isinstance(item.data, bytes) else encode_image(item.data)
                pixels, header = np.frombuffer(data, np.uint8), file.header(stamp, "sensor")
                format_ = codec_of(data) or "jpeg"  # of a damaged image too
                file.add(IMAGES, COMPRESSED_IMAGE, stamp, header=header, format=format_, data=pixels)

        yield record


def add_live_estimate(sink: MessageSink, plane: Plane, stamp: int, estimate: Estimate, more: Mapping[str, str]) -> None:
    """Add the messages of an estimate with its stamp [ns], the same in a file and on topics.

    Its diagnostics hold the reason and `more`.
    """
    trajectory, answers = gathered([estimate])
    add_estimates(sink, trajectory, [stamp], plane, answers, {"reason": estimate.reason, **more})
