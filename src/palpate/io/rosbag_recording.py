"""A bag as a recording: each image with the pose that the sensor had when it was taken."""

import logging
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import reduce
from operator import matmul
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple

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
from palpate.types.from_arrays import nanoseconds, planar_recording
from palpate.types.images import camera_view, decode_image, turned_image
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


class BagReading(NamedTuple):
    """A bag that was read as a recording."""

    recording: Recording
    plane: Plane
    """The plane of its poses."""


class _Source(NamedTuple):
    """Source of poses: a topic, or a chain of transforms."""

    name: str
    """As an option takes it: TOPIC or PARENT:CHILD."""
    parent: str | None
    """Frame that a chain begins at; a topic's poses name theirs."""
    steps: list[tuple[str, bool]]
    """The topic, or frames of transforms on the way from parent to child; true where one is taken backwards."""


class _Mapping(NamedTuple):
    """The parts of a bag that a recording is made of."""

    images: str
    """Topic of the touch images, or of contact flags; "" where poses alone are read."""
    sensor: _Source
    """Source of the sensor's poses."""
    object: _Source | None
    """Source of the object's poses, which are ground truth."""
    topics: list[Topic]
    """All that is read."""


class _Streams(NamedTuple):
    """Images or contact flags and poses of a bag with their times."""

    images: dict[int, bytes]
    """Encoded images by their times [ns]; those that are damaged may be empty."""
    flags: dict[int, bool]
    """Contact flags likewise."""
    poses: dict[str, Poses]
    """Poses by topic, and those of transforms by the frame that they place."""
    static: set[str]
    """Frames whose transforms hold at all times."""

    def placed(self, source: _Source, time: NDArray[np.int64]) -> Placed:
        """Return a source's poses at times (M,) [ns]."""
        steps: list[Placed] = []
        for name, is_backwards in source.steps:
            poses = self.poses[name]
            step = always(poses, len(time)) if name in self.static else at_times(poses, time)
            steps.append(step.inverse() if is_backwards else step)
        return reduce(matmul, steps)

    def frame(self, source: _Source) -> str:
        """Return the frame that a source's poses are given in."""
        return source.parent or self.poses[source.name].frame


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
    return read_contents(contents(Path(path)), shape, choices or BagChoices(), sensor)


def read_contents(found: Contents, shape: Shape, choices: BagChoices, sensor: SensorProfile) -> BagReading:
    """Read a bag whose contents are known; see `read_bag`."""
    try:
        chosen = _mapping(found, choices, sensor)
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
    with in_file(found.path):
        chosen = _mapping(found, choices, None)
        streams = _read_streams(found, chosen, choices, None)
        moving = [poses.time for name, poses in streams.poses.items() if name not in streams.static]
        time = max(moving, key=len, default=np.zeros(1, np.int64))
        placed = streams.placed(chosen.sensor, time)
    return time[placed.known], np.hstack([placed.position, placed.rotation])[placed.known]


def _mapping(found: Contents, choices: BagChoices, sensor: SensorProfile | None) -> _Mapping:
    """Choose topics and frames, and check times of what is read; without a sensor, of poses alone.

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
    for topic in topics:
        if topic.error and topic.damaged == len(topic.log_times):
            raise topic.error
    _check_times(topics, choices.clock)
    return _Mapping(images, place, truth, topics)


def _check_times(topics: list[Topic], clock: Literal["header", "log"]) -> None:
    """Raise FileError unless the times of what is read are set, differ, and come from one clock.

    Header stamps are held against the times of recording, where there are any: within a second, as a message is
    recorded some time after it was sent.
    """
    moving = [topic for topic in topics if not topic.is_static]
    is_header = clock == "header" and not any(topic.are_equal("log") for topic in moving)
    advice = "; --clock log takes the times of recording" if is_header else ""
    for topic in moving:
        name, unstamped = topic.channel.topic, topic.stamps.count(0)
        times, kind = (topic.log_times, "times of recording") if clock == "log" else (topic.stamps, "header stamps")
        # The first message by a clock that starts at zero is no fault.
        if clock == "header" and unstamped and (unstamped > 1 or unstamped == len(times)):
            raise FileError(f"{unstamped} headers in {name} have a stamp of zero{advice}")
        if topic.are_equal(clock):
            raise FileError(f"{len(times)} messages in {name} have only {len(set(times))} different {kind}{advice}")
    ends = [(end(topic.offsets), topic.channel.topic) for topic in moving if topic.offsets for end in (min, max)]
    if is_header and ends:
        (least, early), (most, late) = min(ends), max(ends)
        if most - least > 10**9:
            raise FileError(
                f"clocks differ or jump: header stamps are {least * 1e-9:+.3f} s off the times of recording in "
                f"{early}, {most * 1e-9:+.3f} s in {late}{advice}"
            )


def _source(found: Contents, topics: list[str], name: str | None, leave_out: _Source | None) -> _Source:
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
    return _Source(chosen, None, [(chosen, False)]) if chosen in topics else _chain(found, *chosen.split(":"))


def _chain(found: Contents, parent: str, child: str) -> _Source:
    """Return the chain of transforms between two frames. Raises FileError where there is none."""
    ways = [parent], [child]
    for way in ways:
        while len(above := found.parents.get(way[-1], [])) == 1:
            if above[0] in way:
                raise FileError(f"transforms run in a circle: {' < '.join([*way, *above])}")
            way += above
    meeting = next((name for name in ways[1] if name in ways[0]), None)
    if meeting is None or parent == child:
        for way in ways:
            if above := found.parents.get(way[-1]):
                raise FileError(f"frame {way[-1]} has {len(above)} parents, {' and '.join(above)}")
        raise FileError(f"no chain of transforms leads from {parent!r} to {child!r}{_frames(found)}")
    up, down = (way[: way.index(meeting)] for way in ways)
    return _Source(f"{parent}:{child}", parent, [(name, True) for name in up] + [(name, False) for name in down[::-1]])


def _frames(found: Contents) -> str:
    names = {name for child, above in found.parents.items() for name in (child, *above)}
    return f"; frames of transforms are {', '.join(sorted(names))}" if names else ""


def _only(found: Contents, what: str, names: list[str], chosen: str | None, option: str) -> str:
    """Return the chosen name, or the only one of some. Raises FileError that lists them."""
    if chosen in names or (chosen is None and len(names) == 1):
        return chosen or names[0]
    there = (", ".join(names) or "none of a type that is read") + _frames(found)
    wrong = f"has no {what} {chosen!r}" if chosen else f"has {'more than one' if names else 'no'} {what}"
    raise FileError(f"{wrong}; there are {there}; name one by {option}")


def _read_streams(found: Contents, chosen: _Mapping, choices: BagChoices, sensor: SensorProfile | None) -> _Streams:
    """Read what a mapping uses. Raises FileError on messages that cannot be used, and if no image is of the sensor."""
    images, flags, static, repeated = dict[int, bytes](), dict[int, bool](), set[str](), 0
    gathered, damage = dict[str, list[tuple[int, Pose]]](), list[FileError]()
    needed = {name for source in (chosen.sensor, chosen.object) if source for name, _ in source.steps}
    topics = {topic.channel: topic for topic in chosen.topics}
    size, view = (sensor.image_height, sensor.image_width) if sensor else (0, 0), camera_view(choices.orientation)
    offsets = [topic.clock_offset for topic in chosen.topics if choices.clock == "header" and not topic.is_static]
    # Flags have no headers: they came as long after their time as the poses did.
    offset = next((round(each * 1e9) for each in offsets if each is not None), 0)

    def add_image(time: int, message: Any) -> None:
        nonlocal repeated
        repeated += time in images
        images[time] = b""
        try:
            images[time] = turned_image(image_of(message), size, view)
        except FileError as error:  # a damaged image is a frame that tracking skips
            damage.append(error)

    if sensor and choices.image_times is not None:
        for time, path in _listed_images(choices.image_times, choices.images):
            add_image(time, SimpleNamespace(format=path.name, data=existing_file(path).read_bytes()))
    # `contents` has counted messages that do not decode, and warned of a bag that is cut off.
    with suppress(CutShort):
        for raw in bag_messages(found.path):
            message, topic = None, topics.get(raw.channel)
            with suppress(FileError):
                message = decoded(raw) if topic else None
            if topic is None or message is None:
                continue
            if raw.channel.type in IMAGE_TYPES:
                add_image(raw.log_time if choices.clock == "log" else stamp_of(message) or 0, message)
                continue
            if raw.channel.type == BOOL:
                flags[raw.log_time + offset] = bool(message.data)
                continue
            for pose in poses_of(message):
                if (name := pose.child or raw.channel.topic) in needed:
                    time = raw.log_time if choices.clock == "log" else pose.stamp
                    gathered.setdefault(name, []).append((time, pose))
                    static |= {name} if topic.is_static else set()
    for topic in chosen.topics:
        if topic.damaged:
            words = "%s: %d messages of %s do not decode and are left out"
            logger.warning(words, found.path, topic.damaged, topic.channel.topic)
    if repeated:
        logger.warning("%s: %d images have the time of another one and are left out", found.path, repeated)
    for data in list(images.values())[:: len(images) // 10 + 1]:
        try:
            decode_image(data, size)
            break
        except FileError as error:
            damage.append(error)
    else:
        if damage:
            raise FileError(f"{chosen.images or choices.image_times}: an image: {damage[0]}") from damage[0]
    poses: dict[str, Poses] = {}
    for name, rows in gathered.items():
        frames = sorted({pose.frame for _, pose in rows})
        if len(frames) > 1:
            raise FileError(f"{name}: poses are given in several frames, {', '.join(map(repr, frames))}")
        time, numbers = np.array([time for time, _ in rows], np.int64), np.array([pose.numbers for _, pose in rows])
        poses[name] = poses_in_time(name, frames[0], time, numbers)
    return _Streams(images, flags, poses, static)


def _recording(
    found: Contents, chosen: _Mapping, choices: BagChoices, streams: _Streams, shape: Shape, sensor: SensorProfile
) -> BagReading:
    flags, stamps = None, np.array(sorted(streams.flags or streams.images), np.int64)
    if streams.flags:
        given = np.array([streams.flags[stamp] for stamp in stamps.tolist()])
        end = max(poses.time[-1] for name, poses in streams.poses.items() if name not in streams.static)
        times = np.arange(stamps[0], max(end, stamps[0]) + 1, round(1e9 / sensor.rate))
        flags, stamps = given[np.searchsorted(stamps, times, "right") - 1], times
    elif choices.plane == "fit":
        flags = _touched([streams.images[stamp] for stamp in stamps.tolist()], sensor)
    time, frame, truth = stamps + round(choices.time_offset * 1e9), streams.frame(chosen.sensor), None
    placed = on_the_gel(streams.placed(chosen.sensor, time), choices.sensor_T_gel)
    if chosen.object is not None:
        if (other := streams.frame(chosen.object)) != frame:
            raise FileError(f"poses of the sensor are given in frame {frame!r}, those of the object in {other!r}")
        truth = f"the object ({chosen.object.name})", streams.placed(chosen.object, time)
    sources = chosen.images or choices.image_times, chosen.sensor.name, chosen.object and chosen.object.name
    recording, plane = planar_recording(
        str(found.path),
        frame,
        time,
        (f"the sensor ({chosen.sensor.name})", placed),
        truth,
        choices.plane,
        choices.off_plane,
        touching=flags,
        images=None if streams.flags else lambda indices: [streams.images[stamp] for stamp in stamps[indices].tolist()],
        contact=flags if streams.flags else None,
        shape=shape,
        sensor=sensor,
        source=f"bag {found.path.name}: {', '.join(str(each) for each in sources if each)}",
        file=found.path,
    )
    return BagReading(recording, plane)


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
