"""A bag as a recording: each image with the pose that the sensor had when it was taken."""

import logging
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.geometry.shapes import Shape
from palpate.io.bags.choices import BagChoices, Mapping, mapping, written
from palpate.io.bags.clocks import check_stamps
from palpate.io.bags.contents import Contents, contents
from palpate.io.bags.streams import Streams, placed_at, read_streams
from palpate.types.images import decode_image
from palpate.types.motion import Placed
from palpate.types.plane import Plane, chosen_plane, planar
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile
from palpate.types.stored_images import SpooledImages

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]


class BagReading(NamedTuple):
    """What was read of a bag."""

    recording: Recording
    plane: Plane
    """The plane that its poses are in."""
    mapping: Mapping
    """What was read from where."""


def read_bag(
    path: Path | str, shape: Shape, choices: BagChoices | None = None, sensor: SensorProfile = DIGIT
) -> BagReading:
    """Read a bag as a recording of an object of this shape.

    Frames are the images, at their times by the chosen clock, with the sensor's poses between those of the bag; a
    warning says how many are left out because no pose is known at their time. Raises FileError where topics are
    ambiguous, clocks do not go together, or poses leave the plane.
    """
    choices = choices or BagChoices()
    found = contents(Path(path))
    chosen = mapping(found, choices)
    if choices.clock == "header":
        check_stamps(found, chosen)
    try:
        recording, plane = _recording(found, chosen, choices, read_streams(found, chosen, choices), shape, sensor)
    except FileError as error:
        said = " ".join(str(error).split())  # names of topics may hold line breaks
        raise FileError(f"{path}: {said}") from error
    return BagReading(recording, plane, chosen)


def _recording(
    found: Contents, chosen: Mapping, choices: BagChoices, streams: Streams, shape: Shape, sensor: SensorProfile
) -> tuple[Recording, Plane]:
    stamps = np.array(sorted(streams.images), np.int64)
    time = stamps + round(choices.time_offset * 1e9)
    frame, placed = placed_at(streams, chosen.sensor, found, time)
    stamps, time, placed = _known(found.path, stamps, time, placed)
    images = SpooledImages(streams.spool, [streams.images[stamp] for stamp in stamps.tolist()])
    assert streams.codec is not None
    try:
        decode_image(images[0], streams.codec, (sensor.image_height, sensor.image_width))
    except FileError as error:
        raise FileError(f"{chosen.images}: an image: {error}") from error
    plane = chosen_plane(str(found.path), choices.plane, frame, placed)
    sensor_pose = planar(f"the sensor ({written(chosen.sensor)})", plane, time, placed, choices.off_plane)
    object_pose = _truth(found, chosen, choices, streams, plane, time)
    frames = {"sensor_pose": f"{written(chosen.sensor)} in {frame!r}, between its messages; {plane}"}
    if chosen.object is not None:
        frames["object_pose"] = f"{written(chosen.object)}, likewise"
    recording = Recording(
        time=time / 1e9,
        sensor_pose=sensor_pose,
        shape=shape,
        sensor=sensor,
        object_pose=object_pose,
        image=images,
        codec=streams.codec,
        source=f"bag {found.path.name}, images {chosen.images}",
        frames=frames,
        file=found.path,
    )
    return recording, plane


def _known(
    path: Path, stamps: NDArray[np.int64], time: NDArray[np.int64], placed: Placed
) -> tuple[NDArray[np.int64], NDArray[np.int64], Placed]:
    """The frames at whose times the sensor's pose is known."""
    lost = int(np.count_nonzero(~placed.known))
    if lost == len(time):
        raise FileError(
            f"no sensor pose is known at the time of any image, {time[0] * 1e-9:.3f} to {time[-1] * 1e-9:.3f} s"
        )
    if lost:
        logger.warning("%s: %d of %d images have no sensor pose at their time and are left out", path, lost, len(time))
    return stamps[placed.known], time[placed.known], placed[placed.known]


def _truth(
    found: Contents, chosen: Mapping, choices: BagChoices, streams: Streams, plane: Plane, time: NDArray[np.int64]
) -> Array | None:
    """The object's poses in the plane (N, 3), NaN where they are not known; None if the bag is to have none."""
    if chosen.object is None:
        return None
    frame, placed = placed_at(streams, chosen.object, found, time)
    if frame != plane.frame:
        raise FileError(
            f"poses of the sensor are given in frame {plane.frame!r}, those of the object in {frame!r}; expected one "
            "frame"
        )
    known, what = placed.known, f"the object ({written(chosen.object)})"
    pose = np.full((len(time), 3), np.nan)
    pose[known] = planar(what, plane, time[known], placed[known], choices.off_plane)
    return pose
