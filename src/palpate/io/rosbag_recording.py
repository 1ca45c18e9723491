"""A bag as a recording: each image with the pose that the sensor had when it was taken."""

import logging
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import FileError, SettingError
from palpate.files import existing_file, in_file, numbers_of, read_table
from palpate.geometry.shapes import Shape
from palpate.io.mcap_file import CutShort
from palpate.io.ros_messages import (
    BOOL,
    IMAGE_TYPES,
    POSE_TYPES,
    TRANSFORM_TYPES,
    Pose,
    decoded,
    image_of,
    poses_of,
    stamp_of,
)
from palpate.io.rosbag_reader import Contents, Topic, bag_messages, contents
from palpate.types.from_arrays import nanoseconds
from palpate.types.images import CameraView, camera_view, decode_image, turned_image
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
    in_plane,
    on_the_gel,
    pose_numbers,
    poses_in_time,
)

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BagChoices:
    """Settings for reading a bag; what is None is found where there is only one."""

    images: str | None = None
    """Topic of the touch images or, without images, of contact flags (std_msgs/Bool); with `image_times`, a folder."""
    image_times: Path | str | None = None
    """Table of images in a folder, not in the bag: columns time, seconds or whole nanoseconds, and file."""
    orientation: str = ""
    """Words with commas that say how images lie; see `Recording.from_arrays`."""
    sensor_poses: str | None = None
    """Topic of the sensor's poses, or its frames in the transforms, PARENT:CHILD."""
    sensor_T_gel: ArrayLike | None = None
    """Pose of the gel in the frame of these poses, such as that of a flange; see `Recording.from_arrays`."""
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
        camera_view(self.orientation)
        if self.sensor_T_gel is not None:
            gel = pose_numbers("sensor_T_gel", [self.sensor_T_gel])[0]
            object.__setattr__(self, "sensor_T_gel", tuple(gel.tolist()))  # so that choices compare
        object.__setattr__(self, "plane", checked_choices(self.plane, self.off_plane, self.time_offset))


class PoseSource(NamedTuple):
    """Source of poses: a topic, or a chain of transforms."""

    name: str
    """As an option takes it: TOPIC or PARENT:CHILD."""
    parent: str | None
    """Frame that a chain begins at; a topic's poses name theirs."""
    up: list[str]
    """Frames on the way up from the parent, without the one at which both ways meet."""
    down: list[str]
    """The topic, or the frames on the way up from the child."""


@dataclass(frozen=True)
class Mapping:
    """The parts of a bag that a recording is made of."""

    images: str
    """Topic of the touch images, or of contact flags; "" where poses alone are read."""
    sensor: PoseSource
    """Source of the sensor's poses."""
    object: PoseSource | None
    """Source of the object's poses, which are ground truth."""
    topics: list[Topic]
    """All that is read."""


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
    bag; a warning says how many are left out because no pose is known at their time. Without images, frames come at the
    sensor's rate, with the latest contact flag (std_msgs/Bool). A damaged image is a frame that tracking skips; ground
    truth is unknown where its poses are NaN. Raises FileError where topics are ambiguous, clocks differ, or poses leave
    the plane.
    """
    choices, found = choices or BagChoices(), contents(Path(path))
    return read_contents(found, mapping(found, choices, sensor), choices, shape, sensor)


def read_contents(
    found: Contents, chosen: Mapping, choices: BagChoices, shape: Shape, sensor: SensorProfile
) -> BagReading:
    """Read a bag whose contents are known; see `read_bag`."""
    try:
        return _recording(found, chosen, choices, _read_streams(found, chosen, choices, sensor), shape, sensor)
    except FileError as error:
        message = " ".join(str(error).split())  # names of topics may hold line breaks
        raise FileError(f"{found.path}: {message}") from error


def read_poses(
    path: Path | str, source: str | None = None, clock: Literal["header", "log"] = "header"
) -> tuple[NDArray[np.int64], Array]:
    """Return times (N,) [ns] and poses (N, 7) of a bag, x, y, z, qx, qy, qz, qw, as `Recording.from_arrays` takes them.

    The source is a topic, or two frames of the transforms, PARENT:CHILD; None if there is only one. Raises FileError.
    """
    choices, found = BagChoices(sensor_poses=source, clock=clock), contents(Path(path))
    chosen = mapping(found, choices, None)
    with in_file(found.path):
        streams = _read_streams(found, chosen, choices, None)
        moving = [poses for name, poses in streams.poses.items() if name not in streams.static]
        time = max((poses.time for poses in moving), key=len, default=np.zeros(1, np.int64))
        placed = _placed_at(streams, chosen.sensor, time)[1]
    return time[placed.known], np.hstack([placed.position, placed.rotation])[placed.known]


def mapping(found: Contents, choices: BagChoices, sensor: SensorProfile | None) -> Mapping:
    """Choose topics and frames, and check times and images of what is read; without a sensor, of poses alone.

    Raises FileError, with the candidates where none of several is named.
    """
    readable = [topic for topic in found.topics if topic.channel.is_read]

    def named(types: tuple[str, ...]) -> list[str]:
        return [topic.channel.topic for topic in readable if topic.channel.type in types]

    types, what = IMAGE_TYPES, "image topic"
    if sensor and not (sensor.image_height and (named(IMAGE_TYPES) or not named((BOOL,)))):
        types, what = (BOOL,), "topic of contact flags"
    has_topic = sensor is not None and choices.image_times is None
    images = _only(found, what, named(types), choices.images, "--images TOPIC") if has_topic else ""
    poses = named(POSE_TYPES)
    truth = None if choices.object_poses is None else _source(found, poses, choices.object_poses, None)
    place = _source(found, poses, choices.sensor_poses, truth)
    sources = [source for source in (place, truth) if source]
    used = {images: types, **{source.name: POSE_TYPES for source in sources}}
    if any(source.parent is not None for source in sources):
        used |= dict.fromkeys(named(TRANSFORM_TYPES), TRANSFORM_TYPES)
    topics = [topic for topic in readable if topic.channel.type in used.get(topic.channel.topic, ())]
    with in_file(found.path):
        for topic in topics:
            if topic.error and topic.damaged == len(topic.log_times):
                raise topic.error
        _check_times(topics, choices.clock)
        if sensor:
            _check_images(images, topics, sensor, camera_view(choices.orientation))
    return Mapping(images, place, truth, topics)


def _check_times(topics: list[Topic], clock: Literal["header", "log"], tolerance: float = 1.0) -> None:
    """Raise FileError unless the times of what is read are set, differ, and come from one clock.

    Header stamps are held against the times of recording, where there are any; `tolerance` [s] covers the delay between
    a message and its recording.
    """
    moving = sorted(
        (topic for topic in topics if not topic.is_static), key=lambda topic: topic.channel.type not in IMAGE_TYPES
    )
    advice = "" if any(topic.are_equal("log") for topic in moving) else "; --clock log takes the times of recording"
    first: tuple[str, float] | None = None
    for topic in moving:
        name, unstamped = topic.channel.topic, topic.stamps.count(0)
        wrong = ""
        # The first message by a clock that starts at zero is no fault.
        if clock == "header" and unstamped and (unstamped > 1 or unstamped == len(topic.stamps)):
            wrong = f"{unstamped} headers in {name} have a stamp of zero"
        elif topic.are_equal(clock):
            times = topic.times(clock)
            kind = "times of recording" if clock == "log" else "header stamps"
            wrong = f"{len(times)} messages in {name} have only {len(set(times))} different {kind}"
        elif clock == "header" and not topic.are_equal("log") and (found := topic.clock_offset()):
            offset, spread = found
            first = first or (name, offset)
            if spread > tolerance:
                wrong = f"the header stamps in {name} jump by {spread:.1f} s against the times of recording"
            elif abs(offset - first[1]) > tolerance:
                both = f"{first[1]:+.3f} s off the times of recording in {first[0]}, {offset:+.3f} s in {name}"
                wrong = f"clocks differ: header stamps are {both}"
        if wrong:
            raise FileError(wrong + advice * (clock == "header"))


def _check_images(name: str, topics: list[Topic], sensor: SensorProfile, view: CameraView) -> None:
    """Raise FileError if none of a topic's sampled images is one of this sensor; some may be damaged."""
    first: FileError | None = None
    for message in (sample for topic in topics for sample in topic.samples):
        try:
            decode_image(image_of(message), (sensor.image_height, sensor.image_width), view)
        except FileError as error:
            first = first or error
        else:
            return
    if first:
        raise FileError(f"{name}: an image: {first}") from first


def _source(found: Contents, topics: list[str], name: str | None, leave_out: PoseSource | None) -> PoseSource:
    """Return the named source of poses, or the only one but `leave_out`: a topic, or one chain of all transforms."""
    parent, colon, child = (name or "").partition(":")
    if colon:
        return _chain(found, parent, child)
    above, placed = {each for several in found.parents.values() for each in several}, set(found.parents)
    ends = ":".join([*(above - placed), *(placed - above)])
    chains = [ends] if len(above - placed) == len(placed - above) == 1 else []
    names = [each for each in [*topics, *chains] if leave_out is None or each != leave_out.name]
    option = "--sensor-poses TOPIC or PARENT:CHILD, and --object-poses if one is ground truth"
    chosen = _only(found, "source of poses", names, name, option)
    return PoseSource(chosen, None, [], [chosen]) if chosen in topics else _chain(found, *chosen.split(":"))


def _chain(found: Contents, parent: str, child: str) -> PoseSource:
    """Return the chain of transforms between two frames. Raises FileError where there is none."""
    ways = [parent], [child]
    for way in ways:
        while len(above := found.parents.get(way[-1], [])) == 1:
            if above[0] in way:
                raise FileError(f"{found.path}: transforms run in a circle: {' < '.join([*way, *above])}")
            way += above
    meeting = next((name for name in ways[1] if name in ways[0]), None)
    if meeting is None or parent == child:
        for way in ways:
            if above := found.parents.get(way[-1]):
                raise FileError(f"{found.path}: frame {way[-1]} has {len(above)} parents, {' and '.join(above)}")
        raise FileError(f"{found.path}: no chain of transforms leads from {parent!r} to {child!r}{_frames(found)}")
    return PoseSource(f"{parent}:{child}", parent, *(way[: way.index(meeting)] for way in ways))


def _frames(found: Contents) -> str:
    names = {name for child, above in found.parents.items() for name in (child, *above)}
    return f"; frames of transforms are {', '.join(sorted(names))}" if names else ""


def _only(found: Contents, what: str, names: list[str], chosen: str | None, option: str) -> str:
    """Return the chosen name, or the only one of some. Raises FileError that lists them."""
    if chosen in names or (chosen is None and len(names) == 1):
        return chosen or names[0]
    there = (", ".join(names) or "none of a type that is read") + _frames(found)
    wrong = f"has no {what} {chosen!r}" if chosen else f"has {'more than one' if names else 'no'} {what}"
    raise FileError(f"{found.path}: {wrong}; there are {there}; name one by {option}")


class _Streams(NamedTuple):
    """Images and poses of a bag with their times."""

    images: list[bytes]
    """Encoded images in the order of the bag; those that are damaged may be empty."""
    flags: list[bool]
    """Contact flags likewise."""
    order: dict[int, int]
    """Index of each image or flag by its time [ns]."""
    poses: dict[str, Poses]
    """Poses by topic, and those of transforms by the frame that they place."""
    static: set[str]
    """Frames whose transforms hold at all times."""


def _read_streams(found: Contents, chosen: Mapping, choices: BagChoices, sensor: SensorProfile | None) -> _Streams:
    """Read what a mapping uses. Raises FileError, without the name of the bag, on a message that cannot be used."""
    images, index, static = list[bytes](), dict[int, int](), set[str]()
    needed = {name for source in (chosen.sensor, chosen.object) if source for name in (*source.up, *source.down)}
    gathered: dict[str, list[tuple[int, Pose]]] = {}
    topics = {topic.channel: topic for topic in chosen.topics}
    size = (sensor.image_height, sensor.image_width) if sensor else (0, 0)
    flags, view = list[bool](), camera_view(choices.orientation)
    offsets = [topic.clock_offset() for topic in chosen.topics if choices.clock == "header" and not topic.is_static]
    # Flags have no headers: they came as long after their time as the poses did.
    offset = next((round(each[0] * 1e9) for each in offsets if each), 0)
    if sensor and choices.image_times is not None:
        for time, path in _listed_images(choices.image_times, choices.images):
            with in_file(path):
                images.append(turned_image(existing_file(path).read_bytes(), size, view))
                if not index:
                    decode_image(images[0], size)
            index[time] = len(images) - 1
    # `contents` has counted messages that do not decode, and warned of a bag that is cut off.
    with suppress(CutShort):
        for raw in bag_messages(found.path):
            message, topic = None, topics.get(raw.channel)
            with suppress(FileError):
                message = decoded(raw) if topic else None
            if topic is None or message is None:
                continue
            if raw.channel.type in IMAGE_TYPES:
                index[raw.log_time if choices.clock == "log" else stamp_of(message) or 0] = len(images)
                data = b""
                with suppress(FileError):  # a damaged image is a frame that tracking skips
                    data = turned_image(image_of(message), size, view)
                images.append(data)
                continue
            if raw.channel.type == BOOL:
                index[raw.log_time + offset] = len(flags)
                flags.append(bool(message.data))
                continue
            for pose in poses_of(message):
                name = pose.child or raw.channel.topic
                if name in needed:
                    time = raw.log_time if choices.clock == "log" else pose.stamp
                    gathered.setdefault(name, []).append((time, pose))
                    static |= {name} if topic.is_static else set()
    for topic in chosen.topics:
        if topic.damaged:
            words = "%s: %d messages of %s do not decode and are left out"
            logger.warning(words, found.path, topic.damaged, topic.channel.topic)
    if repeated := max(len(images) - len(index), 0):
        logger.warning("%s: %d images have the time of another one and are left out", found.path, repeated)
    poses = {name: _in_time(name, rows) for name, rows in gathered.items()}
    return _Streams(images, flags, index, poses, static)


def _in_time(name: str, rows: list[tuple[int, Pose]]) -> Poses:
    frames = sorted({pose.frame for _, pose in rows})
    if len(frames) > 1:
        raise FileError(f"{name}: poses are given in several frames, {', '.join(map(repr, frames))}")
    time = np.array([time for time, _ in rows], np.int64)
    return poses_in_time(name, frames[0], time, np.array([pose.numbers for _, pose in rows]))


def _placed_at(streams: _Streams, source: PoseSource, time: NDArray[np.int64]) -> tuple[str, Placed]:
    """Return the frame that a source's poses are given in, and the poses at times (M,) [ns]."""

    def placed(name: str) -> Placed:
        poses = streams.poses[name]
        return always(poses, len(time)) if name in streams.static else at_times(poses, time)

    up, down = (
        reduce(lambda lower, name: placed(name) @ lower, names[1:], placed(names[0])) if names else None
        for names in (source.up, source.down)
    )
    back = None if up is None else up.inverse()
    together = down if back is None else back if down is None else back @ down
    assert together is not None
    return source.parent or streams.poses[source.name].frame, together


def _recording(
    found: Contents, chosen: Mapping, choices: BagChoices, streams: _Streams, shape: Shape, sensor: SensorProfile
) -> BagReading:
    stamps, flags = np.array(sorted(streams.order), np.int64), None
    if streams.flags:
        given = np.array([streams.flags[streams.order[stamp]] for stamp in stamps.tolist()])
        end = max(poses.time[-1] for name, poses in streams.poses.items() if name not in streams.static)
        times = np.arange(stamps[0], max(end, stamps[0]) + 1, round(1e9 / sensor.rate))
        flags, stamps = given[np.searchsorted(stamps, times, "right") - 1], times
    time = stamps + round(choices.time_offset * 1e9)
    frame, carrier = _placed_at(streams, chosen.sensor, time)
    placed = on_the_gel(carrier, choices.sensor_T_gel)
    name, truth = chosen.sensor.name, None
    frames = {}
    if chosen.object is not None:
        other, seen = _placed_at(streams, chosen.object, time)
        if other != frame:
            raise FileError(f"poses of the sensor are given in frame {frame!r}, those of the object in {other!r}")
        truth = f"the object ({chosen.object.name})", seen
        frames["object_pose"] = f"{chosen.object.name}, likewise"
    of_sensor = f"the sensor ({name})", placed
    if choices.plane == "fit" and flags is None:
        flags = _touched([streams.images[streams.order[stamp]] for stamp in stamps.tolist()], sensor)
    motion = in_plane(str(found.path), frame, time, of_sensor, truth, choices.plane, choices.off_plane, flags)
    frames["sensor_pose"] = f"{name} in {frame!r}, interpolated; {motion.plane}"
    kept = stamps[motion.keep].tolist()
    images = None if streams.flags else [streams.images[streams.order[stamp]] for stamp in kept]
    seen = f"{'contact' if images is None else 'images'} {chosen.images or choices.image_times}"
    recording = Recording(
        time=time[motion.keep] / 1e9,
        sensor_pose=motion.sensor_pose,
        shape=shape,
        sensor=sensor,
        object_pose=motion.object_pose,
        contact=flags[motion.keep] if streams.flags and flags is not None else None,
        image=images,
        source=f"bag {found.path.name}, {seen}",
        frames=frames,
        file=found.path,
    )
    return BagReading(recording, motion.plane)


def _listed_images(table: Path | str, folder: str | None) -> list[tuple[int, Path]]:
    """Return the times [ns] and paths of the images that a table lists, by default in its own folder."""
    rows = read_table(table, ("time", "file"))
    if not rows:
        raise FileError(f"{table}: lists no images")
    for line, (time, _) in rows:
        if numbers_of([time]) is None:
            raise FileError(f"{table}: line {line}: time is {time!r}, expected seconds, or whole nanoseconds")
    are_whole = all(time.isdecimal() for _, (time, _) in rows)
    times = np.array([int(time) if are_whole else float(time) for _, (time, _) in rows])
    with in_file(table):
        stamps = nanoseconds("time", times, least=1e-3).tolist()
    where = Path(table).parent if folder is None else Path(folder)
    return [(stamp, where / name) for stamp, (_, (_, name)) in zip(stamps, rows, strict=True)]


def _touched(images: Iterable[bytes], sensor: SensorProfile) -> NDArray[np.bool_]:
    """Return flags of images in which the gel looks touched."""
    from palpate.touch.contact_detector import ContactDetector

    detector, size, flags = ContactDetector(sensor), (sensor.image_height, sensor.image_width), []
    for image in images:
        touched = False
        with suppress(FileError, SettingError):
            touched = detector.update(detector.read(decode_image(image, size)))
        flags.append(touched)
    return np.array(flags)
