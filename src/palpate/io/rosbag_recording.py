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
from palpate.errors import FileError, SettingError, kept_warnings
from palpate.files import in_file, numbers_of, read_table
from palpate.geometry.shapes import Shape
from palpate.io.decode_message import decoded
from palpate.io.from_arrays import SpatialFrames, nanoseconds, planar_fields
from palpate.io.hand_frames import OfFinger, hand_fields
from palpate.io.recording import Recording
from palpate.io.ros_messages import BOOL, IMAGE_TYPES, ODOMETRY, POSE_TYPES, TRANSFORM, image_in, stamp_of, yuv_order
from palpate.io.rosbag_reader import Contents, CutShort, Stream, bag_messages, contents
from palpate.io.time_order import check_not_rounded, stamped_in_order
from palpate.types.choices import DEFAULT_SENSOR, BagChoices
from palpate.types.hand import Hand, by_finger, check_names
from palpate.types.images import UprightImage, camera_view, encode_image, fitted
from palpate.types.sensor import SENSORS, SensorProfile, is_named_touch
from palpate.types.space import NoneKnown, Placed, Plane, Times, onto_gel

logger = logging.getLogger(__name__)


LONGEST_DELAY = 0.1
"""[s] Largest difference of the times that messages of two streams take to be recorded."""


_LAST = (TRANSFORM, ODOMETRY)
"""Types of poses that are taken where there are no others, unless one is named."""
_READ = {
    "image topic": "sensor_msgs Image and CompressedImage, foxglove RawImage and CompressedImage",
    "topic of contact flags": "std_msgs Bool",
    "source of poses": "geometry_msgs PoseStamped, PoseWithCovarianceStamped and TransformStamped, nav_msgs Odometry, "
    "foxglove PoseInFrame, and transforms",
}
"""Kinds of topics, and the types of their messages that are read."""


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
    """The topic's poses, or the transforms on the way from parent to child; true for one that is inverted."""

    def placed(self, clock: str, time: Times) -> Placed:
        """Return the poses at times (M,) [ns] of a clock."""
        placed = []
        for stream, is_inverted in self.steps:
            step = stream.placed(clock, time)
            placed.append(step.inverse() if is_inverted else step)
        return replace(reduce(matmul, placed), name=self.name)

    def times(self, clock: str) -> list[Times]:
        """Return the times [ns] of all its streams that move, by a clock."""
        return [np.array(stream.times[clock], np.int64) for stream, _ in self.steps if not stream.is_static]


def read_bag(
    path: Path | str,
    shape: Shape,
    choices: BagChoices | None = None,
    sensor: SensorProfile | Hand = SENSORS[DEFAULT_SENSOR],
) -> BagReading:
    """Read a bag as a recording of an object of this shape.

    Frames are the images, at their times by the chosen clock, with the sensor's poses interpolated between those of the
    bag; a warning says how many are left out because no pose is known at their time. Without images, frames come at the
    sensor's rate, with the latest contact flag (std_msgs/Bool). A damaged image is a frame that tracking skips; ground
    truth is unknown where its poses are NaN. Raises FileError where topics are ambiguous, clocks differ, or poses leave
    the plane.

    Of a `palpate.Hand`, `choices.images` names the topic of each finger, as left=TOPIC,right=TOPIC, and the sensor's
    poses are those of the hand; see `Recording.from_arrays`.
    """
    with kept_warnings() as warnings:
        bag = contents(Path(path))
        with in_file(bag.path):
            read = recording_of if isinstance(sensor, SensorProfile) else hand_recording_of
            recording, plane = read(bag, shape, choices or BagChoices(), sensor)  # pyright: ignore[reportArgumentType]
    return BagReading(recording.warned(warnings), plane)


def read_poses(
    path: Path | str, source: str | None = None, clock: Literal["header", "log"] = "header"
) -> tuple[NDArray[np.int64], Array]:
    """Return times (N,) [ns] and poses (N, 7) of a bag, x, y, z, qx, qy, qz, qw, as `Recording.from_arrays` takes them.

    The source is a topic, or two frames of the transforms, PARENT:CHILD; None if there is only one. Raises FileError.
    """
    bag = contents(Path(path))
    with in_file(bag.path):
        chosen, _ = _sources(bag, BagChoices(sensor_poses=source, clock=clock))
        time = np.unique(max(chosen.times(clock), key=len, default=np.zeros(1, np.int64)))
        placed = chosen.placed(clock, time)
    poses = np.hstack([placed.position, placed.rotation.as_quat()])
    return time[placed.known], poses[placed.known]


def _sources(bag: Contents, choices: BagChoices, *others: Stream) -> tuple[_Source, _Source | None]:
    """Return the sources of the sensor's and the object's poses; checks their times, and those of other streams.

    Raises FileError, which lists the candidates if there are several and none is named.
    """
    if choices.clock not in ("header", "log"):
        raise SettingError(f"clock is {choices.clock!r}; allowed are header, log")
    truth = None if choices.object_poses is None else _source(bag, choices.object_poses, None)
    sensor = _source(bag, choices.sensor_poses, truth)
    streams = [*others, *(stream for stream, _ in sensor.steps)]
    if truth is not None:
        streams += [stream for stream, _ in truth.steps]
    _check_times([stream for stream in streams if not stream.is_static], choices.clock)
    if truth is not None and truth.frame != sensor.frame:
        raise FileError(
            f"poses of the sensor are given in frame {sensor.frame!r}, those of the object in {truth.frame!r}"
        )
    return sensor, truth


def _check_times(streams: list[Stream], clock: Literal["header", "log"]) -> None:
    """Raise FileError unless the times of streams are set, differ, and come from one clock.

    Header stamps are compared with the times of recording, where there are any: they must agree within a second, as a
    message is recorded some time after it was sent, unless a converter or a replay wrote other times of recording.
    """
    is_header = clock == "header" and not any(stream.are_equal("log") for stream in streams)
    advice = "; --clock log takes the times of recording" if is_header else ""
    ends: list[tuple[int, str]] = []  # the least and the largest offset of each stream [ns], with its name
    for stream in streams:
        if not stream.times["log"]:
            raise FileError(f"none of {stream.damaged} messages in {stream.name} decodes")
        if stream.are_equal(clock):
            times = stream.times[clock]
            kind = "times of recording" if clock == "log" else "header stamps"
            different = f"{len(times)} messages in {stream.name} have only {len(set(times))} different"
            raise FileError(f"{different} {kind}{advice}")
        if is_header:
            check_not_rounded(f"{stream.name}: header stamps", np.array(stream.times[clock], np.int64), advice)
        if len(stream.offsets):
            ends.append((int(stream.offsets.min()), stream.name))
            ends.append((int(stream.offsets.max()), stream.name))
    if not is_header or not ends:
        return
    least, early = min(ends)
    most, late = max(ends)
    if most - least <= 10**9:
        _warn_if_apart(streams)
        return
    if _are_written_later(streams):
        logger.warning("header stamps count: the times of recording are those of a converter or a replay")
        return
    raise FileError(
        f"clocks differ or jump: header stamps are {least * 1e-9:+.3f} s off the times of recording in "
        f"{early}, {most * 1e-9:+.3f} s in {late}{_cause_of(least, most)}{advice}"
    )


def _warn_if_apart(streams: list[Stream]) -> None:
    """Warn of streams whose stamps differ in their distance to the times of recording by more than LONGEST_DELAY."""
    late = sorted((float(np.median(each.offsets)) * 1e-9, each.name) for each in streams if len(each.offsets))
    (least, early), (most, last) = late[0], late[-1]
    if most - least > LONGEST_DELAY:
        words = (
            "header stamps are %+.3f s off the times of recording in %s, %+.3f s in %s: if messages are not that late, "
        )
        logger.warning(words + "clocks differ: --time-offset moves the images", least, early, most, last)


def _are_written_later(streams: list[Stream]) -> bool:
    """Return true if all streams last longer or shorter by their times of recording than by stamps, which overlap."""
    starts: list[int] = []
    ends: list[int] = []
    for stream in streams:
        stamps = np.array(stream.times["header"], np.int64)
        if len(stamps) < 2 or not stamps.all():
            return False
        pace = np.ptp(np.array(stream.times["log"], np.int64)) / max(np.ptp(stamps), 1)
        if 0.9 < pace < 1.1:
            return False
        starts.append(int(stamps.min()))
        ends.append(int(stamps.max()))
    return max(starts) < min(ends)


def _cause_of(least: int, most: int) -> str:
    """Return a question on clocks that differ by constant times [ns], or ""."""
    half_hours = (most - least) / 1.8e12
    if 0.9 < half_hours < 29.0 and abs(half_hours - round(half_hours)) < 1e-3:
        return ": is one in another time zone?"
    if least < -1e18 and most > -1e16:
        return ": does one count from the start of a machine or a simulation?"
    return ""


def _source(bag: Contents, name: str | None, leave_out: _Source | None) -> _Source:
    """Return the named source of poses, or the only one but `leave_out`: a topic, or one chain of all transforms."""
    parent, colon, child = (name or "").partition(":")
    if colon:
        return _chain(bag, parent.lstrip("/"), child.lstrip("/"))
    chains = _whole_chains(bag)
    topics = bag.of(POSE_TYPES)
    names = other_poses(bag, leave_out and leave_out.name)
    if name in topics and (leave_out is None or name != leave_out.name):
        names.append(name)  # of the last types, too
    option = "--sensor-poses TOPIC or PARENT:CHILD, and --object-poses if one is ground truth"
    chosen = _only(bag, "source of poses", names, name, option)
    if chosen in chains:
        return _chain(bag, *chosen.split(":"))
    frames = sorted(topics[chosen].frames)  # none if all messages are damaged
    if len(frames) > 1:
        raise FileError(f"{chosen}: poses are given in several frames, {', '.join(map(repr, frames))}")
    bodies = sorted(topics[chosen].bodies)
    if len(bodies) > 1:
        names = ", ".join(map(repr, bodies))
        raise FileError(f"{chosen}: poses are those of several bodies, child frames {names}; allowed is one to a topic")
    return _Source(chosen, "".join(frames), [(topics[chosen], False)])


def _whole_chains(bag: Contents) -> list[str]:
    """Return PARENT:CHILD of each chain of transforms from a frame without a parent to one without a child."""
    parents = {frame for stream in bag.transforms.values() for frame in stream.frames}
    ways = [_way_up(bag, child) for child in sorted(bag.transforms.keys() - parents)]
    return [f"{way[-1]}:{way[0]}" for way in ways if way[-1] not in bag.transforms]


def _way_up(bag: Contents, name: str) -> list[str]:
    """Return a frame and those above it, up to one without a parent, with several, or that was met before."""
    way = [name]
    while way[-1] not in way[:-1] and way[-1] in bag.transforms and len(bag.transforms[way[-1]].frames) == 1:
        way += bag.transforms[way[-1]].frames
    return way


def _chain(bag: Contents, parent: str, child: str) -> _Source:
    """Return the chain of transforms between two frames. Raises FileError if there is none."""
    from_parent = _way_up(bag, parent)
    from_child = _way_up(bag, child)
    for way in (from_parent, from_child):
        if way[-1] in way[:-1]:
            raise FileError(f"transforms run in a circle: {' < '.join(way)}")
    meeting = next((name for name in from_child if name in from_parent), None)
    if meeting is None or parent == child:
        for way in (from_parent, from_child):
            if way[-1] in bag.transforms:
                frames = bag.transforms[way[-1]].frames
                raise FileError(f"frame {way[-1]} has {len(frames)} parents, {' and '.join(frames)}")
        raise FileError(f"no chain of transforms leads from {parent!r} to {child!r}{_frames(bag)}")
    up = from_parent[: from_parent.index(meeting)]
    down = from_child[: from_child.index(meeting)]
    steps = [(bag.transforms[name], True) for name in up]
    steps += [(bag.transforms[name], False) for name in reversed(down)]
    return _Source(f"{parent}:{child}", parent, steps)


def _frames(bag: Contents) -> str:
    """Return words that list the frames of all transforms, or ""."""
    names = {name for child, stream in bag.transforms.items() for name in (child, *stream.frames)}
    return f"; frames of transforms are {', '.join(sorted(names))}" if names else ""


def _contradiction(bag: Contents) -> str:
    """Return words on a frame with several parents, or a circle of transforms, which leave no whole chain; or ""."""
    for name in bag.transforms:
        way = _way_up(bag, name)
        if way[-1] in way[:-1]:
            return f"transforms run in a circle: {' < '.join(way)}"
        if way[-1] in bag.transforms:
            parents = " and ".join(bag.transforms[way[-1]].frames)
            return f"frame {way[-1]} has several parents, {parents}: allowed is one"
    return ""


def _only(bag: Contents, kind: str, names: list[str], chosen: str | None, option: str) -> str:
    """Return the chosen name, or the only one of some. Raises FileError that lists them."""
    if chosen in names or (chosen is None and len(names) == 1):
        return chosen or names[0]
    problem = f"has {'more than one' if names else 'no'} {kind}"
    if not names and "PARENT:" in option and _contradiction(bag):
        raise FileError(f"{problem}, as {_contradiction(bag)}")
    if chosen:
        problem = f"has no {kind} {chosen!r}"
    frames = _frames(bag) if "PARENT:" in option else ""
    if names:
        raise FileError(f"{problem}; there are {', '.join(names)}{frames}; name one by {option}")
    others = ", ".join(f"{channel.topic} of {channel.type}" for channel in bag.topics if not channel.is_read)
    unread = f"; not read are {others}" if others else ""
    raise FileError(f"{problem}; there are none of a type that is read, which are {_READ[kind]}{frames}{unread}")


def likely_choices(bag: Contents, choices: BagChoices) -> BagChoices:
    """Return choices with what names tell of topics that are not chosen: images and poses of a touch sensor.

    What no name or more than one tells stays open.
    """
    images = [*bag.of(IMAGE_TYPES)]
    poses = other_poses(bag, None)
    return replace(choices, images=_only_of_touch(images), sensor_poses=_only_of_touch(poses))


def _only_of_touch(names: list[str]) -> str | None:
    """Return the only name, or the only one of a touch sensor; None if there is none."""
    touch = [name for name in names if is_named_touch(name)]
    return next((some[0] for some in (names, touch) if len(some) == 1), None)


def other_poses(bag: Contents, chosen: str | None) -> list[str]:
    """Return the sources of poses of a bag but the chosen one: topics, and whole chains of transforms.

    Odometry and single transforms may be of the base, or of what a chain has as well: they are sources where nothing
    else is.
    """
    first = [*bag.of([kind for kind in POSE_TYPES if kind not in _LAST]), *_whole_chains(bag)]
    others = [name for name in first if name != chosen]
    return others or [name for name in bag.of(_LAST) if name != chosen]


def _topic_of_frames(bag: Contents, kind: str, names: list[str], choices: BagChoices) -> str:
    """Return the topic of images or flags. Raises FileError, which also names what is missing of poses."""
    try:
        return _only(bag, kind, names, choices.images, "--images TOPIC")
    except FileError as error:
        problems = [str(error)]
    try:
        _source(bag, choices.sensor_poses, None)
    except FileError as error:
        problems.append(str(error))
    raise FileError("; and it ".join(problems))


def recording_of(bag: Contents, shape: Shape, choices: BagChoices, sensor: SensorProfile) -> BagReading:
    """Return a bag whose contents are known as a recording; see `read_bag`."""
    poses_of_gel = onto_gel(choices)
    are_flags = not sensor.image_height or (bag.of((BOOL,)) and not bag.of(IMAGE_TYPES))
    images = None
    flags = None
    if choices.image_times is not None:
        poses, truth = _sources(bag, choices)
        topic = str(choices.image_times)
        stamps, images = _one_at_a_time(topic, sorted(_listed_images(Path(choices.image_times), choices.images)))
    elif are_flags:
        topics = bag.of((BOOL,))
        topic = _topic_of_frames(bag, "topic of contact flags", [*topics], choices)
        poses, truth = _sources(bag, choices, topics[topic])
        stamps, flags = _flags(topics[topic], poses, choices.clock, sensor.rate)
    else:
        topics = bag.of(IMAGE_TYPES)
        topic = _topic_of_frames(bag, "image topic", [*topics], choices)
        poses, truth = _sources(bag, choices, topics[topic])
        stamps, images = _one_at_a_time(topic, _images_in_order(bag, topic, choices, sensor))
    time = stamps + round(choices.time_offset * 1e9)
    frames = SpatialFrames(
        time,
        poses_of_gel(poses.placed(choices.clock, time)),
        _true_poses(truth, choices.clock, time),
        None if images is None else (topic, images),
        flags,
    )
    names = [topic, poses.name]
    if truth is not None:
        names.append(truth.name)
    source = f"bag {bag.path.name}: {', '.join(names)}"
    fields, plane = planar_fields(str(bag.path), poses.frame, frames, choices, sensor)
    return BagReading(Recording(**fields, shape=shape, source=source, file=bag.path), plane)


def hand_recording_of(bag: Contents, shape: Shape, choices: BagChoices, hand: Hand) -> BagReading:
    """Return a bag whose contents are known as a recording of a hand; see `read_bag`."""
    poses_of_hand = onto_gel(choices)
    if choices.image_times is not None:
        raise SettingError("image_times is a table of one camera's images; of a hand they are in the bag")
    topics = by_finger("images", choices.images or "")
    check_names("images", topics, hand.fingers)
    offset = round(choices.time_offset * 1e9)
    given = {}
    for finger, topic in topics.items():
        chosen = _only(bag, "image topic", [*bag.of(IMAGE_TYPES)], topic, "--images FINGER=TOPIC,...")
        profile = hand.fingers[finger]
        stamps, images = _one_at_a_time(topic, _images_in_order(bag, chosen, choices, profile))
        given[finger] = OfFinger(topic, stamps + offset, images)
    poses, truth = _sources(bag, choices, *(bag.of(IMAGE_TYPES)[topic] for topic in topics.values()))

    def placed(time: Times) -> tuple[Placed, Placed | None]:
        return poses_of_hand(poses.placed(choices.clock, time)), _true_poses(truth, choices.clock, time)

    fields, plane = hand_fields(str(bag.path), poses.frame, given, placed, choices, hand)
    names = [*(f"{finger}={topic}" for finger, topic in topics.items()), poses.name]
    if truth is not None:
        names.append(truth.name)
    source = f"bag {bag.path.name}: {', '.join(names)}"
    return BagReading(Recording(**fields, shape=shape, source=source, file=bag.path), plane)


def _true_poses(truth: _Source | None, clock: str, time: Times) -> Placed | None:
    """Return true poses at times (M,) [ns]; None if there are none or, with a warning, none is known."""
    if truth is None:
        return None
    try:
        return truth.placed(clock, time)
    except NoneKnown as error:
        logger.warning("%s; there is no ground truth", error)
        return None


def _one_at_a_time(topic: str, images: list[tuple[int, Any]]) -> tuple[Times, list[Any]]:
    """Return times [ns] and images in the order of time; of several at one time the last is kept, with a warning."""
    by_time = dict(images)
    repeated = len(images) - len(by_time)
    if repeated:
        logger.warning("%s: %d images have the time of another one and are left out", topic, repeated)
    return np.array(list(by_time), np.int64), list(by_time.values())


def _images_in_order(
    bag: Contents, topic: str, choices: BagChoices, sensor: SensorProfile
) -> list[tuple[int, bytes | FileError]]:
    """Return times [ns] by the chosen clock and encoded images of a topic. Raises FileError if the times go back."""
    found = _once(topic, list(_images(bag, topic, choices, sensor)))
    log_time = np.array([time for time, _, _ in found], np.int64)
    stamp = np.array([time for _, time, _ in found], np.int64)
    ordered = stamped_in_order(topic, stamp, log_time, choices.clock == "header")
    return [(time, found[index][2]) for index, time in zip(ordered.numbers, ordered.time.tolist(), strict=True)]


def _once(topic: str, images: list[tuple[int, int, bytes | FileError]]) -> list[tuple[int, int, bytes | FileError]]:
    """Return images without those that a second recorder has, too, at about the same time, which a warning counts."""
    times: dict[tuple[int, bytes | FileError], int] = {}
    kept: list[tuple[int, int, bytes | FileError]] = []
    for log_time, stamp, image in images:
        before = times.get((stamp, image)) if stamp else None
        if before is None or abs(log_time - before) > 1e9 * LONGEST_DELAY:
            times[stamp, image] = log_time
            kept.append((log_time, stamp, image))
    if len(kept) < len(images):
        logger.warning("%s: %d of %d images are there twice", topic, len(images) - len(kept), len(images))
    return kept


def _flags(stream: Stream, poses: _Source, clock: str, rate: float) -> tuple[Times, Flags]:
    """Return times (N,) [ns] at a rate [Hz], from the first contact flag to the last pose, and the latest flags.

    Flags have no headers: by that clock they are taken to have been recorded as late as the poses.
    """
    sent = np.array(stream.times["log"], np.int64)
    if clock == "header":
        offsets = [step.offsets for step, _ in poses.steps if not step.is_static]
        if offsets:
            sent += int(np.median(offsets[0]))
    order = np.argsort(sent, kind="stable")
    end = max([sent.min(), *map(np.max, poses.times(clock))])
    time = np.arange(sent.min(), end + 1, round(1e9 / rate))
    latest = np.searchsorted(sent[order], time, "right") - 1
    flags = np.array(stream.numbers)[order] == 1.0
    return time, flags[latest]


def _images(
    bag: Contents, topic: str, choices: BagChoices, sensor: SensorProfile
) -> Iterator[tuple[int, int, bytes | FileError]]:
    """Yield times of recording and stamps [ns] of a topic, and its encoded images or the error on one that is damaged.

    A message without a stamp has 0.
    """
    view = camera_view(choices.orientation)
    size = (sensor.image_height, sensor.image_width)
    encoding: str | None = None  # of the first image, if its label is wrong
    with suppress(CutShort):  # of which `contents` has warned
        for raw in bag_messages(bag.path):
            if raw.channel.topic != topic or not raw.channel.is_read or raw.channel.type not in IMAGE_TYPES:
                continue
            with suppress(FileError):  # `contents` has counted messages that do not decode
                message = decoded(raw)
                if encoding is None:
                    encoding = yuv_order(message)
                    if encoding:
                        words = "%s: images are labelled %r, but their colours are in the order of %r, which is taken"
                        logger.warning(words, topic, message.encoding, encoding)
                stamp = stamp_of(message) or 0
                try:
                    data = image_in(message, encoding)
                    if not isinstance(data, bytes):
                        data = UprightImage(encode_image(fitted(data, size, view), "png"))
                    yield raw.log_time, stamp, data
                except FileError as error:
                    yield raw.log_time, stamp, error


def _listed_images(table: Path, folder: Path | str | None) -> list[tuple[int, Path]]:
    """Return times [ns] and files of images as a table lists them, in a folder, by default the table's."""
    with in_file(table):
        rows = read_table(table, ("time", "file"))
        for line, (time, _) in rows:
            if numbers_of([time]) is None:
                raise FileError(f"line {line}: time is {time!r}, expected seconds, or whole nanoseconds")
        texts = [time for _, (time, _) in rows]
        are_nanoseconds = all(text.isdecimal() for text in texts)
        stamps = nanoseconds("time", [int(text) if are_nanoseconds else float(text) for text in texts], least=1e-3)
    files = [(folder or table.parent) / Path(name) for _, (_, name) in rows]
    return list(zip(stamps.tolist(), files, strict=True))
