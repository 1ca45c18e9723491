"""A bag as a recording: each image with the pose that the sensor had when it was taken."""

import logging
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial, reduce
from operator import matmul
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, SettingError
from palpate.files import existing_file, in_file, numbers_of, read_table
from palpate.geometry.shapes import Shape
from palpate.io.from_arrays import nanoseconds, planar_recording
from palpate.io.ros_messages import BOOL, IMAGE_TYPES, POSE_TYPES, TRANSFORM_TYPES, decoded, image_of, stamp_of
from palpate.io.rosbag_reader import Contents, CutShort, PoseStream, Topic, bag_messages, contents
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile
from palpate.types.space import Placed, Placement, Plane, Times

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BagChoices(Placement):
    """Settings for reading a bag; what is None is found where there is only one."""

    images: str | None = None
    """Topic of the touch images or, without images, of contact flags (std_msgs/Bool); with `image_times`, a folder."""
    image_times: Path | str | None = None
    """Table of images in a folder, not in the bag: columns time, seconds or whole nanoseconds, and file."""
    sensor_poses: str | None = None
    """Topic of the sensor's poses, or its frames in the transforms, PARENT:CHILD."""
    object_poses: str | None = None
    """Topic or frames, likewise, of the object's poses, which are ground truth."""
    clock: Literal["header", "log"] = "header"
    """Clock of all times: the messages' headers, or their recording."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.clock not in ("header", "log"):
            raise SettingError(f"clock is {self.clock!r}; allowed are header, log")


class BagReading(NamedTuple):
    """A bag that was read as a recording."""

    recording: Recording
    plane: Plane
    """The plane of its poses."""


class _Source(NamedTuple):
    """Source of poses: a topic, or a chain of transforms."""

    name: str
    """As an option takes it: TOPIC or PARENT:CHILD."""
    frame: str
    """Frame that the poses are given in."""
    steps: list[tuple[PoseStream, bool]]
    """The topic's poses, or transforms on the way from parent to child; true where one is taken backwards."""

    def placed(self, clock: str, time: Times) -> Placed:
        """Return the poses at times (M,) [ns] of a clock."""
        steps = ((stream.placed(clock, time), is_backwards) for stream, is_backwards in self.steps)
        return reduce(matmul, [step.inverse() if is_backwards else step for step, is_backwards in steps])


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
    found = contents(Path(path))
    with in_file(found.path):
        return recording_of(found, shape, choices or BagChoices(), sensor)


def read_poses(
    path: Path | str, source: str | None = None, clock: Literal["header", "log"] = "header"
) -> tuple[NDArray[np.int64], Array]:
    """Return times (N,) [ns] and poses (N, 7) of a bag, x, y, z, qx, qy, qz, qw, as `Recording.from_arrays` takes them.

    The source is a topic, or two frames of the transforms, PARENT:CHILD; None if there is only one. Raises FileError.
    """
    choices, found = BagChoices(sensor_poses=source, clock=clock), contents(Path(path))
    with in_file(found.path):
        chosen, _, _ = _sources(found, choices, {})
        moving = [stream.times[clock] for stream, _ in chosen.steps if not stream.is_static]
        time = np.unique(np.array(max(moving, key=len, default=[0]), np.int64))
        placed = chosen.placed(clock, time)
    return time[placed.known], np.hstack([placed.position, placed.rotation.as_quat()])[placed.known]


def _sources(
    found: Contents, choices: BagChoices, used: dict[str, tuple[str, ...]]
) -> tuple[_Source, _Source | None, int]:
    """Return the sources of the sensor's and the object's poses, and the offset of headers from recording [ns].

    Checks the times of these topics, and of others that are `used`, with their types. Raises FileError, with the
    candidates where none of several is named.
    """
    truth = None if choices.object_poses is None else _source(found, choices.object_poses, None)
    place = _source(found, choices.sensor_poses, truth)
    for source in filter(None, (place, truth)):
        names = [source.name] if source.name in found.poses else found.named(TRANSFORM_TYPES)
        used = used | dict.fromkeys(names, (*POSE_TYPES, *TRANSFORM_TYPES))
    topics = [topic for topic in found.topics if topic.channel.type in used.get(topic.channel.topic, ())]
    for topic in topics:
        if topic.damaged == len(topic.log_times):
            raise FileError(f"none of {topic.damaged} messages of {topic.channel.topic} is a {topic.channel.type}")
        if topic.damaged:
            words = "%s: %d messages of %s do not decode and are left out"
            logger.warning(words, found.path, topic.damaged, topic.channel.topic)
    _check_times(topics, choices.clock)
    offsets = [topic.clock_offset for topic in topics if choices.clock == "header" and not topic.is_static]
    return place, truth, next((round(each * 1e9) for each in offsets if each is not None), 0)


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
        if clock == "header" and unstamped > (len(times) > 1):
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


def _source(found: Contents, name: str | None, leave_out: _Source | None) -> _Source:
    """Return the named source of poses, or the only one but `leave_out`: a topic, or one chain of all transforms."""
    parent, colon, child = (name or "").partition(":")
    if colon:
        return _chain(found, parent, child)
    above, placed = {each for one in found.transforms.values() for each in one.frames}, set(found.transforms)
    ends = ":".join([*(above - placed), *(placed - above)])
    chains = [ends] if len(above - placed) == len(placed - above) == 1 else []
    names = [each for each in [*found.named(POSE_TYPES), *chains] if leave_out is None or each != leave_out.name]
    option = "--sensor-poses TOPIC or PARENT:CHILD, and --object-poses if one is ground truth"
    chosen = _only(found, "source of poses", names, name, option)
    if chosen in chains:
        return _chain(found, *chosen.split(":"))
    stream = found.poses.get(chosen, PoseStream(chosen, [""]))  # without any where all messages are damaged
    if len(stream.frames) > 1:
        raise FileError(f"{chosen}: poses are given in several frames, {', '.join(map(repr, sorted(stream.frames)))}")
    return _Source(chosen, stream.frames[0], [(stream, False)])


def _chain(found: Contents, parent: str, child: str) -> _Source:
    """Return the chain of transforms between two frames. Raises FileError where there is none."""

    def above(name: str) -> list[str]:
        return found.transforms[name].frames if name in found.transforms else []

    ways = [parent], [child]
    for way in ways:
        while len(frames := above(way[-1])) == 1:
            if frames[0] in way:
                raise FileError(f"transforms run in a circle: {' < '.join([*way, *frames])}")
            way += frames
    meeting = next((name for name in ways[1] if name in ways[0]), None)
    if meeting is None or parent == child:
        for way in ways:
            if frames := above(way[-1]):
                raise FileError(f"frame {way[-1]} has {len(frames)} parents, {' and '.join(frames)}")
        raise FileError(f"no chain of transforms leads from {parent!r} to {child!r}{_frames(found)}")
    up, down = (way[: way.index(meeting)] for way in ways)
    steps = [(name, True) for name in up] + [(name, False) for name in down[::-1]]
    return _Source(f"{parent}:{child}", parent, [(found.transforms[name], back) for name, back in steps])


def _frames(found: Contents) -> str:
    names = {name for child, stream in found.transforms.items() for name in (child, *stream.frames)}
    return f"; frames of transforms are {', '.join(sorted(names))}" if names else ""


def _only(found: Contents, what: str, names: list[str], chosen: str | None, option: str) -> str:
    """Return the chosen name, or the only one of some. Raises FileError that lists them."""
    if chosen in names or (chosen is None and len(names) == 1):
        return chosen or names[0]
    there = (", ".join(names) or "none of a type that is read") + _frames(found)
    wrong = f"has no {what} {chosen!r}" if chosen else f"has {'more than one' if names else 'no'} {what}"
    raise FileError(f"{wrong}; there are {there}; name one by {option}")


def recording_of(found: Contents, shape: Shape, choices: BagChoices, sensor: SensorProfile) -> BagReading:
    """Return a bag whose contents are known as a recording; see `read_bag`."""
    types, what = IMAGE_TYPES, "image topic"
    if not (sensor.image_height and (found.named(IMAGE_TYPES) or not found.named((BOOL,)))):
        types, what = (BOOL,), "topic of contact flags"
    topic = ""
    if choices.image_times is None:
        topic = _only(found, what, found.named(types), choices.images, "--images TOPIC")
    place, truth, offset = _sources(found, choices, {topic: types})
    if truth is not None and truth.frame != place.frame:
        raise FileError(
            f"poses of the sensor are given in frame {place.frame!r}, those of the object in {truth.frame!r}"
        )
    images, flags = {}, None
    if topic and types == (BOOL,):
        # Flags have no headers: they came as long after their time as the poses did.
        sent = (each.flags.items() for each in found.topics if each.channel.topic == topic)
        given = dict(sorted((time + offset, flag) for flags_ in sent for time, flag in flags_))
        begin, moving = min(given), [stream.times[choices.clock] for stream, _ in place.steps if not stream.is_static]
        stamps = np.arange(begin, max(map(max, [*moving, [begin]])) + 1, round(1e9 / sensor.rate))
        flags = np.array(list(given.values()))[np.searchsorted(np.array(list(given)), stamps, "right") - 1]
    else:
        images = _images(found, topic, choices)
        stamps = np.array(sorted(images), np.int64)
    sources = topic or choices.image_times, place.name, truth and truth.name
    return BagReading(
        *planar_recording(
            str(found.path),
            place.frame,
            stamps,
            choices,
            (f"the sensor ({place.name})", partial(place.placed, choices.clock)),
            truth and (f"the object ({truth.name})", partial(truth.placed, choices.clock)),
            None if flags is not None else (f"{sources[0]}", [images[stamp] for stamp in stamps.tolist()]),
            flags,
            sensor,
            shape=shape,
            source=f"bag {found.path.name}: {', '.join(str(each) for each in sources if each)}",
            file=found.path,
        )
    )


def _images(found: Contents, topic: str, choices: BagChoices) -> dict[int, bytes | FileError]:
    """Return encoded images by their times [ns], or the error on one that is damaged."""
    images, repeated = dict[int, bytes | FileError](), 0
    for time, message in _sent_images(found, topic, choices):
        repeated += time in images
        try:
            images[time] = image_of(message)
        except FileError as error:
            images[time] = error
    if repeated:
        logger.warning("%s: %d images have the time of another one and are left out", found.path, repeated)
    return images


def _sent_images(found: Contents, topic: str, choices: BagChoices) -> Iterator[tuple[int, Any]]:
    """Yield the images of a topic, or of the table beside the bag, as messages with their times [ns]."""
    if choices.image_times is not None:
        table = Path(choices.image_times)
        with in_file(table):
            rows = read_table(table, ("time", "file"))
            for line, (time, _) in rows:
                if numbers_of([time]) is None:
                    raise FileError(f"line {line}: time is {time!r}, expected seconds, or whole nanoseconds")
            are_whole = all(time.isdecimal() for _, (time, _) in rows)
            stamps = nanoseconds("time", [int(row[0]) if are_whole else float(row[0]) for _, row in rows], least=1e-3)
        for stamp, (_, (_, name)) in zip(stamps.tolist(), rows, strict=True):
            file = existing_file((choices.images or table.parent) / Path(name))
            yield stamp, SimpleNamespace(format=name, data=file.read_bytes())
        return
    with suppress(CutShort):  # of which `contents` has warned
        for raw in bag_messages(found.path):
            message = None
            if raw.channel.topic == topic and raw.channel.is_read and raw.channel.type in IMAGE_TYPES:
                with suppress(FileError):  # `contents` has counted messages that do not decode
                    message = decoded(raw)
            if message is not None:
                yield raw.log_time if choices.clock == "log" else stamp_of(message) or 0, message
