"""A bag as a recording: each image with the pose that the sensor had when it was taken."""

import logging
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import reduce
from operator import matmul
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array, Flags
from palpate.errors import FileError, SettingError
from palpate.files import in_file, numbers_of, read_table
from palpate.geometry.shapes import Shape
from palpate.io.from_arrays import SpatialFrames, nanoseconds, planar_recording
from palpate.io.ros_messages import BOOL, IMAGE_TYPES, POSE_TYPES, decoded, image_in, stamp_of
from palpate.io.rosbag_reader import Contents, CutShort, Stream, bag_messages, contents
from palpate.types.choices import BagChoices
from palpate.types.images import encode_image
from palpate.types.recording import Recording
from palpate.types.sensor import DIGIT, SensorProfile
from palpate.types.space import Placed, Plane, Times, onto_gel

logger = logging.getLogger(__name__)


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
    steps: list[tuple[Stream, bool]]
    """The topic's poses, or transforms on the way from parent to child; true where one is taken backwards."""

    def placed(self, clock: str, time: Times) -> Placed:
        """Return the poses at times (M,) [ns] of a clock."""
        steps = ((stream.placed(clock, time), is_backwards) for stream, is_backwards in self.steps)
        found = reduce(matmul, [step.inverse() if is_backwards else step for step, is_backwards in steps])
        return replace(found, name=self.name)

    def times(self, clock: str) -> list[Times]:
        """Return the times [ns] of all its streams that move, by a clock."""
        return [np.array(stream.times[clock], np.int64) for stream, _ in self.steps if not stream.is_static]


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
    found, choices = contents(Path(path)), BagChoices(sensor_poses=source, clock=clock)
    with in_file(found.path):
        chosen, _ = _sources(found, choices)
        time = np.unique(max(chosen.times(clock), key=len, default=np.zeros(1, np.int64)))
        placed = chosen.placed(clock, time)
    return time[placed.known], np.hstack([placed.position, placed.rotation.as_quat()])[placed.known]


def _sources(found: Contents, choices: BagChoices, *others: Stream) -> tuple[_Source, _Source | None]:
    """Return the sources of the sensor's and the object's poses; checks their times, and those of other streams.

    Raises FileError, with the candidates where none of several is named.
    """
    if choices.clock not in ("header", "log"):
        raise SettingError(f"clock is {choices.clock!r}; allowed are header, log")
    truth = None if choices.object_poses is None else _source(found, choices.object_poses, None)
    place = _source(found, choices.sensor_poses, truth)
    streams = [*others, *(stream for source in (place, truth) if source for stream, _ in source.steps)]
    _check_times([stream for stream in streams if not stream.is_static], choices.clock)
    if truth is not None and truth.frame != place.frame:
        raise FileError(
            f"poses of the sensor are given in frame {place.frame!r}, those of the object in {truth.frame!r}"
        )
    return place, truth


def _check_times(streams: list[Stream], clock: Literal["header", "log"]) -> None:
    """Raise FileError unless the times of what is read are set, differ, and come from one clock.

    Header stamps are held against the times of recording, where there are any: within a second, as a message is
    recorded some time after it was sent.
    """
    is_header = clock == "header" and not any(stream.are_equal("log") for stream in streams)
    advice = "; --clock log takes the times of recording" if is_header else ""
    ends = list[tuple[int, str]]()
    for stream in streams:
        times, offsets = stream.times[clock], stream.offsets
        if not stream.times["log"]:
            raise FileError(f"none of {stream.damaged} messages in {stream.name} decodes")
        if stream.are_equal(clock):
            found = f"{len(times)} messages in {stream.name} have only {len(set(times))} different"
            raise FileError(f"{found} {'times of recording' if clock == 'log' else 'header stamps'}{advice}")
        ends += [(int(end(offsets)), stream.name) for end in (np.min, np.max) if len(offsets)]
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
        return _chain(found, parent.lstrip("/"), child.lstrip("/"))
    above = {each for one in found.transforms.values() for each in one.frames}
    ways = [_way_up(found, child) for child in sorted(found.transforms.keys() - above)]
    chains = [f"{way[-1]}:{way[0]}" for way in ways if way[-1] not in found.transforms]
    topics = found.of(POSE_TYPES)
    names = [each for each in [*topics, *chains] if leave_out is None or each != leave_out.name]
    option = "--sensor-poses TOPIC or PARENT:CHILD, and --object-poses if one is ground truth"
    chosen = _only(found, "source of poses", names, name, option)
    if chosen in chains:
        return _chain(found, *chosen.split(":"))
    frames = sorted(topics[chosen].frames)  # none where all messages are damaged
    if len(frames) > 1:
        raise FileError(f"{chosen}: poses are given in several frames, {', '.join(map(repr, frames))}")
    return _Source(chosen, "".join(frames), [(topics[chosen], False)])


def _way_up(found: Contents, name: str) -> list[str]:
    """Return a frame and those above it, up to one without a parent, with several, or that was met before."""
    way = [name]
    while way[-1] not in way[:-1] and way[-1] in found.transforms and len(found.transforms[way[-1]].frames) == 1:
        way += found.transforms[way[-1]].frames
    return way


def _chain(found: Contents, parent: str, child: str) -> _Source:
    """Return the chain of transforms between two frames. Raises FileError where there is none."""
    ways = _way_up(found, parent), _way_up(found, child)
    for way in ways:
        if way[-1] in way[:-1]:
            raise FileError(f"transforms run in a circle: {' < '.join(way)}")
    meeting = next((name for name in ways[1] if name in ways[0]), None)
    if meeting is None or parent == child:
        for way in ways:
            if way[-1] in found.transforms:
                frames = found.transforms[way[-1]].frames
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
    others = ", ".join(f"{each.topic} of {each.type}" for each in found.topics if not each.is_read)
    there = (", ".join(names) or f"none of a type that is read, but {others or 'no others'}") + _frames(found)
    wrong = f"has no {what} {chosen!r}" if chosen else f"has {'more than one' if names else 'no'} {what}"
    raise FileError(f"{wrong}; there are {there}; name one by {option}")


def recording_of(found: Contents, shape: Shape, choices: BagChoices, sensor: SensorProfile) -> BagReading:
    """Return a bag whose contents are known as a recording; see `read_bag`."""
    of_gel, flags = onto_gel(choices), None
    seen: list[tuple[int, Any]] | None = None
    are_flags = not sensor.image_height or (found.of((BOOL,)) and not found.of(IMAGE_TYPES))
    if choices.image_times is not None:
        place, truth = _sources(found, choices)
        topic, seen = str(choices.image_times), _listed_images(Path(choices.image_times), choices.images)
    else:
        types, what = ((BOOL,), "topic of contact flags") if are_flags else (IMAGE_TYPES, "image topic")
        topics = found.of(types)
        topic = _only(found, what, [*topics], choices.images, "--images TOPIC")
        place, truth = _sources(found, choices, topics[topic])
        if not are_flags:
            seen = list(_images(found, topic, choices.clock))
    images = dict(seen or ())
    if seen is None:
        stamps, flags = _flags(found.of((BOOL,))[topic], place, choices.clock, sensor.rate)
    else:
        stamps = np.array(sorted(images), np.int64)
        if repeated := len(seen) - len(images):
            logger.warning("%s: %d images have the time of another one and are left out", topic, repeated)
    time = stamps + round(choices.time_offset * 1e9)
    return BagReading(
        *planar_recording(
            str(found.path),
            place.frame,
            SpatialFrames(
                time,
                of_gel(place.placed(choices.clock, time)),
                truth and truth.placed(choices.clock, time),
                None if seen is None else (topic, [images[stamp] for stamp in stamps.tolist()]),
                flags,
            ),
            choices,
            sensor,
            shape=shape,
            source=f"bag {found.path.name}: {', '.join([topic, place.name, *([truth.name] if truth else [])])}",
            file=found.path,
        )
    )


def _flags(stream: Stream, place: _Source, clock: str, rate: float) -> tuple[Times, Flags]:
    """Return times (N,) [ns] at a rate [Hz], from the first contact flag to the last pose, and the latest flags.

    Flags have no headers: they came as long after their time as the poses did.
    """
    sent, poses = np.array(stream.times["log"], np.int64), place.times(clock)
    if clock == "header":
        offsets = [each.offsets for each, _ in place.steps if not each.is_static]
        sent += int(np.median(offsets[0])) if offsets else 0
    order = np.argsort(sent, kind="stable")
    time = np.arange(sent.min(), max([sent.min(), *map(np.max, poses)]) + 1, round(1e9 / rate))
    latest = np.searchsorted(sent[order], time, "right") - 1
    return time, np.array(stream.numbers)[order][latest] == 1.0


def _images(found: Contents, topic: str, clock: str) -> Iterator[tuple[int, bytes | FileError]]:
    """Yield times [ns] and encoded images of a topic, or the error on one that is damaged."""
    with suppress(CutShort):  # of which `contents` has warned
        for raw in bag_messages(found.path):
            if raw.channel.topic != topic or not raw.channel.is_read or raw.channel.type not in IMAGE_TYPES:
                continue
            with suppress(FileError):  # `contents` has counted messages that do not decode
                message = decoded(raw)
                time = raw.log_time if clock == "log" else stamp_of(message) or 0
                try:
                    data = image_in(message)
                    yield time, data if isinstance(data, bytes) else encode_image(data, "png")
                except FileError as error:
                    yield time, error


def _listed_images(table: Path, folder: Path | str | None) -> list[tuple[int, Path]]:
    """Return times [ns] and files of images as a table lists them, in a folder, by default the table's."""
    with in_file(table):
        rows = read_table(table, ("time", "file"))
        for line, (time, _) in rows:
            if numbers_of([time]) is None:
                raise FileError(f"line {line}: time is {time!r}, expected seconds, or whole nanoseconds")
        are_whole = all(time.isdecimal() for _, (time, _) in rows)
        stamps = nanoseconds("time", [int(row[0]) if are_whole else float(row[0]) for _, row in rows], least=1e-3)
    files = [(folder or table.parent) / Path(name) for _, (_, name) in rows]
    return list(zip(stamps.tolist(), files, strict=True))
