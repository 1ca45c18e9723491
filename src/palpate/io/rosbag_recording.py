"""A bag as a recording: each image with the pose that the sensor had when it was taken."""

import logging
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError
from palpate.files import in_file
from palpate.geometry.shapes import Shape
from palpate.io.mcap_file import CutShort
from palpate.io.ros_messages import (
    IMAGE_TYPES,
    POSE_TYPES,
    TRANSFORM_TYPES,
    Pose,
    decoded,
    image_of,
    poses_of,
    stamp_of,
)
from palpate.io.rosbag_reader import Contents, bag_messages, contents
from palpate.types.images import Codec, SpooledImages, decode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile
from palpate.types.space import (
    Normal,
    Placed,
    Plane,
    Poses,
    always,
    at_times,
    checked_choices,
    chosen_plane,
    planar,
    poses_in_time,
)

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]
PoseSource = str | tuple[str, str]
"""A topic of poses, or the parent and the child frame of a chain of transforms."""


@dataclass(frozen=True)
class BagChoices:
    """Settings for reading a bag; what is None is found where there is only one."""

    images: str | None = None
    """Topic of the touch images."""
    sensor_poses: str | None = None
    """Topic of the sensor's poses, or its frames in the transforms, PARENT:CHILD."""
    object_poses: str | None = None
    """Topic or frames, likewise, of the object's poses, which are ground truth."""
    clock: Literal["header", "log"] = "header"
    """Clock of all times: the messages' headers, or their recording."""
    time_offset: float = 0.0
    """Added to the times of the images [s]: negative where they are stamped late."""
    plane: Normal = (0.0, 0.0, 1.0)
    """Normal of the plane of the push in the frame of the poses, or "fit" for the plane through the sensor's path."""
    off_plane: float = 0.01
    """Largest distance of poses from the plane [m]."""

    def __post_init__(self) -> None:
        if self.clock not in ("header", "log"):
            raise SettingError(f"clock is {self.clock!r}; allowed are header, log")
        object.__setattr__(self, "plane", checked_choices(self.plane, self.off_plane, self.time_offset))


@dataclass(frozen=True)
class Mapping:
    """The parts of a bag that a recording is made of."""

    images: str
    """Topic of the touch images."""
    sensor: PoseSource
    """Source of the sensor's poses."""
    object: PoseSource | None
    """Source of the object's poses, which are ground truth."""
    unused: tuple[str, ...]
    """Topics that nothing is read from."""


class BagReading(NamedTuple):
    """A bag that was read as a recording."""

    recording: Recording
    plane: Plane
    """The plane of its poses."""


def read_bag(
    path: Path | str, shape: Shape, choices: BagChoices | None = None, sensor: SensorProfile = DIGIT
) -> BagReading:
    """Read a bag as a recording of an object of this shape.

    Frames are the images, at their times by the chosen clock, with the sensor's poses interpolated between those of the
    bag; a warning says how many are left out because no pose is known at their time. Raises FileError where topics are
    ambiguous, clocks differ, or poses leave the plane.
    """
    choices = choices or BagChoices()
    found = contents(Path(path))
    chosen = mapping(found, choices)
    if choices.clock == "header":
        check_stamps(found, chosen)
    try:
        return _recording(found, chosen, choices, _read_streams(found, chosen, choices), shape, sensor)
    except FileError as error:
        message = " ".join(str(error).split())  # names of topics may hold line breaks
        raise FileError(f"{path}: {message}") from error


def mapping(found: Contents, choices: BagChoices) -> Mapping:
    """Choose topics and frames. Raises FileError that lists the candidates where none of several is named."""
    images = _only(found, "image topic", found.of(IMAGE_TYPES), choices.images, "--images TOPIC")
    truth = None if choices.object_poses is None else _source(found, choices.object_poses, None)
    sensor = _source(found, choices.sensor_poses, truth)
    used = {images, sensor, truth}
    if isinstance(sensor, tuple) or isinstance(truth, tuple):
        used |= set(found.of(TRANSFORM_TYPES))
    unused = tuple(topic.channel.topic for topic in found.topics if topic.channel.topic not in used)
    return Mapping(images, sensor, truth, unused)


def written(source: PoseSource) -> str:
    """Return a source as an option takes it: TOPIC or PARENT:CHILD."""
    return source if isinstance(source, str) else ":".join(source)


def check_stamps(found: Contents, chosen: Mapping, tolerance: float = 1.0) -> None:
    """Raise FileError unless the header stamps of what is read are set, do not jump, and come from one clock.

    `tolerance` [s] covers the delay between a message and its recording.
    """
    topics = [topic for topic in found.topics if topic.channel.topic not in chosen.unused and not topic.is_static]
    seen = (each for each in topics if each.channel.topic == chosen.images and each.channel.type in IMAGE_TYPES)
    of_images = next(seen).clock_offset or 0.0
    for topic in topics:
        name, offset, spread = topic.channel.topic, topic.clock_offset, topic.clock_spread
        if offset is None or spread is None:
            continue
        # The first message by a clock that starts at zero is no fault.
        if topic.unstamped > 1 or topic.unstamped == topic.count:
            wrong = f"{topic.unstamped} headers in {name} have a stamp of zero"
        elif spread > tolerance:
            wrong = f"the header stamps in {name} jump by {spread:.1f} s against the times of recording"
        elif abs(offset - of_images) > tolerance:
            both = f"{of_images:+.3f} s off the times of recording in {chosen.images}, {offset:+.3f} s in {name}"
            wrong = f"clocks differ: header stamps are {both}"
        else:
            continue
        raise FileError(f"{found.path}: {wrong}; --clock log takes the times of recording")


def _source(found: Contents, name: str | None, leave_out: PoseSource | None) -> PoseSource:
    """Return the named source of poses, or the only one but `leave_out`: a topic, or one chain of all transforms."""
    parent, colon, child = (name or "").partition(":")
    if colon:
        return parent, child
    sources: dict[str, PoseSource] = {topic: topic for topic in found.of(POSE_TYPES)}
    roots = set(found.parents.values()) - set(found.parents)
    leaves = set(found.parents) - set(found.parents.values())
    if len(roots) == len(leaves) == 1:
        ends = (roots.pop(), leaves.pop())
        sources[written(ends)] = ends
    names = [each for each, source in sources.items() if source != leave_out]
    option = "--sensor-poses TOPIC or PARENT:CHILD, and --object-poses if one is ground truth"
    return sources[_only(found, "source of poses", names, name, option)]


def _only(found: Contents, what: str, names: list[str], chosen: str | None, option: str) -> str:
    """Return the chosen name, or the only one of some. Raises FileError that lists them."""
    if chosen in names or (chosen is None and len(names) == 1):
        return chosen or names[0]
    frames = ", ".join(sorted({*found.parents, *found.parents.values()}))
    there = ", ".join(names) or "none of a type that is read"
    there += f"; frames of transforms are {frames}" if frames else ""
    wrong = f"has no {what} {chosen!r}" if chosen else f"has {'more than one' if names else 'no'} {what}"
    raise FileError(f"{found.path}: {wrong}; there are {there}; name one by {option}")


@dataclass
class _Streams:
    """Images and poses of a bag with their times."""

    images: SpooledImages = field(default_factory=SpooledImages)
    """Encoded images in the order of the bag."""
    index: dict[int, int] = field(default_factory=dict)
    """Index of each image by its time [ns]."""
    codec: Codec | None = None
    poses: dict[str, Poses] = field(default_factory=dict)
    """Poses by topic, and those of transforms by the frame that they place."""
    static: set[str] = field(default_factory=set)
    """Frames whose transforms hold at all times."""

    def add_image(self, message: Any, time: int) -> None:
        """Take an image message. Raises FileError."""
        data, codec = image_of(message)
        if self.codec not in (None, codec):
            raise FileError(f"some images are {self.codec}, others {codec}; expected one of them")
        if self.codec is None and getattr(message, "encoding", "") == "8UC3":
            logger.warning("images: encoding 8UC3 does not name the order of colours; blue is taken as the first")
        self.codec = codec
        self.index[time] = len(self.images)
        self.images.append(data)


def _read_streams(found: Contents, chosen: Mapping, choices: BagChoices) -> _Streams:
    """Read what a mapping uses. Raises FileError, without the name of the bag, on a message that cannot be used."""
    streams = _Streams()
    needed = {name for source in (chosen.sensor, chosen.object) if source for name in _names(found, source)}
    gathered: dict[str, list[tuple[int, Pose]]] = {}
    topics = {
        each.channel: each for each in found.topics if each.channel.is_read and each.channel.topic not in chosen.unused
    }
    try:
        for raw in bag_messages(found.path):
            # A topic may have several channels, of several types.
            is_image, is_transform = raw.channel.type in IMAGE_TYPES, raw.channel.type in TRANSFORM_TYPES
            if raw.channel not in topics or (is_image and raw.channel.topic != chosen.images):
                continue
            message = decoded(raw)
            if is_image:
                time = raw.log_time if choices.clock == "log" else stamp_of(message) or 0
                with in_file(chosen.images):
                    streams.add_image(message, time)
                continue
            for pose in poses_of(message):
                name = pose.child if is_transform else raw.channel.topic
                if name in needed:
                    time = raw.log_time if choices.clock == "log" else pose.stamp
                    gathered.setdefault(name, []).append((time, pose))
                    streams.static |= {name} if topics[raw.channel].is_static else set()
    except CutShort:
        pass  # `contents` has warned of it
    if repeated := len(streams.images) - len(streams.index):
        logger.warning("%s: %d images have the time of another one and are left out", found.path, repeated)
    streams.poses = {name: _in_time(name, rows) for name, rows in gathered.items()}
    return streams


def _in_time(name: str, rows: list[tuple[int, Pose]]) -> Poses:
    frames = sorted({pose.frame for _, pose in rows})
    if len(frames) > 1:
        raise FileError(f"{name}: poses are given in several frames, {', '.join(map(repr, frames))}")
    time = np.array([time for time, _ in rows], np.int64)
    return poses_in_time(name, frames[0], time, np.array([pose.numbers for _, pose in rows]))


def _names(found: Contents, source: PoseSource) -> list[str]:
    """Return the topic, or the frames of the transforms, that a source needs."""
    return [source] if isinstance(source, str) else [name for way in _ways(found.parents, *source) for name in way]


def _ways(parents: dict[str, str], parent: str, child: str) -> tuple[list[str], list[str]]:
    """Return the frames on the ways up from `parent` and from `child` to the frame where both meet, without that."""
    ways = [parent], [child]
    for way in ways:
        while (above := parents.get(way[-1])) is not None:
            if above in way:
                raise FileError(f"transforms run in a circle: {' < '.join([*way, above])}")
            way.append(above)
    meeting = next((name for name in ways[1] if name in ways[0]), None)
    if meeting is None or parent == child:
        known = ", ".join(sorted({*parents, *parents.values()}))
        raise FileError(f"no chain of transforms leads from {parent!r} to {child!r}; frames are {known or 'none'}")
    return ways[0][: ways[0].index(meeting)], ways[1][: ways[1].index(meeting)]


def _placed_at(streams: _Streams, source: PoseSource, found: Contents, time: NDArray[np.int64]) -> tuple[str, Placed]:
    """Return the frame that a source's poses are given in, and the poses at times (M,) [ns]."""
    if isinstance(source, str):
        poses = streams.poses[source]
        return poses.frame, at_times(poses, time)

    def placed(name: str) -> Placed:
        poses = streams.poses[name]
        return always(poses, len(time)) if name in streams.static else at_times(poses, time)

    up_parent, up_child = (
        reduce(lambda lower, name: placed(name) @ lower, names[1:], placed(names[0])) if names else None
        for names in _ways(found.parents, *source)
    )
    back = None if up_parent is None else up_parent.inverse()
    together = up_child if back is None else back if up_child is None else back @ up_child
    assert together is not None
    return source[0], together


def _recording(
    found: Contents, chosen: Mapping, choices: BagChoices, streams: _Streams, shape: Shape, sensor: SensorProfile
) -> BagReading:
    stamps = np.array(sorted(streams.index), np.int64)
    time = stamps + round(choices.time_offset * 1e9)
    frame, placed = _placed_at(streams, chosen.sensor, found, time)
    if not placed.known.any():
        span = f"{time[0] * 1e-9:.3f} to {time[-1] * 1e-9:.3f} s"
        raise FileError(f"no sensor pose is known at the time of any image, {span}")
    if lost := int(np.count_nonzero(~placed.known)):
        words = "%s: %d of %d images have no sensor pose at their time and are left out"
        logger.warning(words, found.path, lost, len(time))
    stamps, time, placed = stamps[placed.known], time[placed.known], placed[placed.known]
    images = streams.images.selected(streams.index[stamp] for stamp in stamps.tolist())
    assert streams.codec is not None
    with in_file(f"{chosen.images}: an image"):
        decode_image(images[0], streams.codec, (sensor.image_height, sensor.image_width))
    plane = chosen_plane(str(found.path), choices.plane, frame, placed)
    sensor_pose = planar(f"the sensor ({written(chosen.sensor)})", plane, time, placed, choices.off_plane)
    frames = {"sensor_pose": f"{written(chosen.sensor)} in {frame!r}, interpolated; {plane}"}
    object_pose = None
    if chosen.object is not None:
        name, (other, placed) = written(chosen.object), _placed_at(streams, chosen.object, found, time)
        if other != frame:
            raise FileError(f"poses of the sensor are given in frame {frame!r}, those of the object in {other!r}")
        known = placed.known
        object_pose = np.full((len(time), 3), np.nan)
        object_pose[known] = planar(f"the object ({name})", plane, time[known], placed[known], choices.off_plane)
        frames["object_pose"] = f"{name}, likewise"
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
    return BagReading(recording, plane)
