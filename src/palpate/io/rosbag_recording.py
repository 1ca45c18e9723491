"""A bag as a recording: each image with the pose that the sensor had when it was taken."""

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError
from palpate.geometry.shapes import Shape
from palpate.io.mcap_file import CutShort
from palpate.io.ros_messages import (
    IMAGE_TYPES,
    POSE_TYPES,
    TRANSFORM_TYPES,
    Pose,
    decoded,
    image_of,
    is_read,
    poses_of,
    stamp_of,
)
from palpate.io.rosbag_reader import Contents, Topic, bag_messages, contents
from palpate.io.transform_chain import chain, compose_chain, single_chain
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
    mapping: Mapping
    """The parts of the bag that it was made of."""


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
        recording, plane = _recording(found, chosen, choices, _read_streams(found, chosen, choices), shape, sensor)
    except FileError as error:
        message = " ".join(str(error).split())  # names of topics may hold line breaks
        raise FileError(f"{path}: {message}") from error
    return BagReading(recording, plane, chosen)


def mapping(found: Contents, choices: BagChoices) -> Mapping:
    """Choose topics and frames. Raises FileError that lists the candidates where none of several is named."""
    image_topics = [topic.channel.topic for topic in found.of(IMAGE_TYPES)]
    images = choices.images or _only(found.path, "image topic", image_topics, "--images TOPIC")
    if images not in image_topics:
        raise FileError(f"{found.path}: has no images in {images}; {_listed('image topics', image_topics)}")
    truth = None if choices.object_poses is None else _source(found, choices.object_poses)
    sensor = _only_source(found, truth) if choices.sensor_poses is None else _source(found, choices.sensor_poses)
    used = {images}
    for source in (sensor, truth):
        if isinstance(source, str):
            used.add(source)
        elif source is not None:
            used |= {topic.channel.topic for topic in found.of(TRANSFORM_TYPES)}
    unused = tuple(topic.channel.topic for topic in found.topics if topic.channel.topic not in used)
    return Mapping(images, sensor, truth, unused)


def written(source: PoseSource) -> str:
    """Return a source as an option takes it: TOPIC or PARENT:CHILD."""
    return source if isinstance(source, str) else ":".join(source)


def check_stamps(found: Contents, chosen: Mapping, tolerance: float = 1.0) -> None:
    """Raise FileError unless the header stamps of what is read are set, do not jump, and come from one clock.

    `tolerance` [s] covers the delay between a message and its recording.
    """
    way_out = "--clock log takes the times of recording"
    offsets: dict[str, float] = {}
    for topic in _topics_of(found, chosen):
        if topic.clock_offset is None or topic.clock_spread is None or topic.is_static:
            continue
        name = topic.channel.topic
        # The first message by a clock that starts at zero is no fault.
        if topic.unstamped > 1 or topic.unstamped == topic.count:
            raise FileError(f"{found.path}: {topic.unstamped} headers in {name} have a stamp of zero; {way_out}")
        if topic.clock_spread > tolerance:
            raise FileError(
                f"{found.path}: the header stamps in {name} jump by {topic.clock_spread:.1f} s against the times of "
                f"recording; {way_out}"
            )
        offsets[name] = topic.clock_offset
    of_images = offsets[chosen.images]
    for name, offset in offsets.items():
        if abs(offset - of_images) > tolerance:
            raise FileError(
                f"{found.path}: clocks differ: header stamps are {of_images:+.3f} s off the times of recording in "
                f"{chosen.images}, {offset:+.3f} s in {name}; {way_out}"
            )


def _topics_of(found: Contents, chosen: Mapping) -> list[Topic]:
    return [topic for topic in found.topics if topic.channel.topic not in chosen.unused]


def _source(found: Contents, name: str) -> PoseSource:
    parent, colon, child = name.partition(":")
    if colon:
        return parent, child
    topics = [topic.channel.topic for topic in found.of(POSE_TYPES)]
    if name not in topics:
        raise FileError(f"{found.path}: has no poses in {name}; {_listed('pose topics', topics)}; {_frames(found)}")
    return name


def _only_source(found: Contents, leave_out: PoseSource | None) -> PoseSource:
    topics: list[PoseSource] = [topic.channel.topic for topic in found.of(POSE_TYPES)]
    frames = single_chain(found.parents)
    sources = [source for source in (*topics, *([frames] if frames else [])) if source != leave_out]
    if not sources and found.parents:
        raise FileError(f"{found.path}: {_frames(found)}; name those of the sensor: --sensor-poses PARENT:CHILD")
    names = [written(source) for source in sources]
    option = "--sensor-poses, and --object-poses if one is ground truth"
    return sources[names.index(_only(found.path, "source of poses", names, option))]


def _only(path: Path, what: str, found: list[str], option: str) -> str:
    if len(found) == 1:
        return found[0]
    if not found:
        raise FileError(f"{path}: has no {what} of a type that is read; palpate info lists what it holds")
    raise FileError(f"{path}: has more than one {what}: {', '.join(found)}; name one by {option}")


def _listed(what: str, names: list[str]) -> str:
    return f"{what} are {', '.join(names)}" if names else f"there are no {what}"


def _frames(found: Contents) -> str:
    return _listed("frames of transforms", sorted({*found.parents, *found.parents.values()}))


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

    def add_image(self, topic: str, message: Any, log_time: int | None) -> None:
        """Take an image message. Raises FileError that names the topic."""
        try:
            data, codec = image_of(message)
        except FileError as error:
            raise FileError(f"{topic}: {error}") from error
        if self.codec not in (None, codec):
            raise FileError(f"{topic}: some images are {self.codec}, others {codec}; expected one of them")
        if self.codec is None and getattr(message, "encoding", "") == "8UC3":
            logger.warning("%s: encoding 8UC3 does not name the order of colours; blue is taken as the first", topic)
        self.codec = codec
        self.index[stamp_of(message) or 0 if log_time is None else log_time] = len(self.images)
        self.images.append(data)


def _read_streams(found: Contents, chosen: Mapping, choices: BagChoices) -> _Streams:
    """Read what a mapping uses. Raises FileError, without the name of the bag, on a message that cannot be used."""
    streams = _Streams()
    needed = {name for source in (chosen.sensor, chosen.object) for name in _names(found, source)}
    gathered: dict[str, tuple[list[Pose], list[int]]] = {}
    topics = {topic.channel: topic for topic in _topics_of(found, chosen)}
    try:
        for raw in bag_messages(found.path):
            topic, is_image = topics.get(raw.channel), raw.channel.topic == chosen.images
            # A topic may have several channels, of several types.
            types = IMAGE_TYPES if is_image else POSE_TYPES + TRANSFORM_TYPES
            if topic is None or raw.channel.type not in types or not is_read(raw.channel):
                continue
            message = decoded(raw)
            log_time = raw.log_time if choices.clock == "log" else None
            if is_image:
                streams.add_image(chosen.images, message, log_time)
                continue
            for pose in poses_of(message):
                name = pose.child if raw.channel.type in TRANSFORM_TYPES else raw.channel.topic
                if name not in needed:
                    continue
                poses, times = gathered.setdefault(name, ([], []))
                poses.append(pose)
                times.append(pose.stamp if log_time is None else log_time)
                if topic.is_static:
                    streams.static.add(name)
    except CutShort:
        pass  # `contents` has warned of it
    if repeated := len(streams.images) - len(streams.index):
        logger.warning("%s: %d images have the time of another one and are left out", found.path, repeated)
    streams.poses = {name: _in_time(name, *rows) for name, rows in gathered.items()}
    return streams


def _placed_at(streams: _Streams, source: PoseSource, found: Contents, time: NDArray[np.int64]) -> tuple[str, Placed]:
    """Return the frame that a source's poses are given in, and the poses at times (M,) [ns]."""
    if isinstance(source, str):
        poses = streams.poses[source]
        return poses.frame, at_times(poses, time)

    def placed(name: str) -> Placed:
        poses = streams.poses[name]
        return always(poses, len(time)) if name in streams.static else at_times(poses, time)

    return source[0], compose_chain(*chain(found.parents, *source), placed)


def _names(found: Contents, source: PoseSource | None) -> list[str]:
    """Return the topic, or the frames of the transforms, that a source needs."""
    if source is None or isinstance(source, str):
        return [] if source is None else [source]
    up_parent, up_child = chain(found.parents, *source)
    return [*up_parent, *up_child]


def _in_time(name: str, poses: list[Pose], times: list[int]) -> Poses:
    if frames := sorted({pose.frame for pose in poses} - {poses[0].frame}):
        raise FileError(f"{name}: poses are given in several frames, {poses[0].frame!r} and {frames[0]!r}")
    return poses_in_time(name, poses[0].frame, np.array(times, np.int64), np.array([pose.numbers for pose in poses]))


def _recording(
    found: Contents, chosen: Mapping, choices: BagChoices, streams: _Streams, shape: Shape, sensor: SensorProfile
) -> tuple[Recording, Plane]:
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
    try:
        decode_image(images[0], streams.codec, (sensor.image_height, sensor.image_width))
    except FileError as error:
        raise FileError(f"{chosen.images}: an image: {error}") from error
    plane = chosen_plane(str(found.path), choices.plane, frame, placed)
    sensor_pose = planar(f"the sensor ({written(chosen.sensor)})", plane, time, placed, choices.off_plane)
    frames = {"sensor_pose": f"{written(chosen.sensor)} in {frame!r}, interpolated; {plane}"}
    object_pose = None
    if chosen.object is not None:
        object_pose = _truth(found, chosen.object, choices, streams, plane, time)
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


def _truth(
    found: Contents,
    source: PoseSource,
    choices: BagChoices,
    streams: _Streams,
    plane: Plane,
    time: NDArray[np.int64],
) -> Array:
    """Return the object's poses in the plane (N, 3), NaN where they are not known."""
    frame, placed = _placed_at(streams, source, found, time)
    if frame != plane.frame:
        raise FileError(f"poses of the sensor are given in frame {plane.frame!r}, those of the object in {frame!r}")
    known, what = placed.known, f"the object ({written(source)})"
    pose = np.full((len(time), 3), np.nan)
    pose[known] = planar(what, plane, time[known], placed[known], choices.off_plane)
    return pose
