"""The second passage through a bag: the images and poses that are used, with their times."""

import logging
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.io.bags.choices import BagChoices, Mapping, PoseSource, topics_of
from palpate.io.bags.containers import raw_messages
from palpate.io.bags.contents import Contents
from palpate.io.bags.frames import chain, compose_chain
from palpate.io.bags.messages import (
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
from palpate.io.bags.raw import CutShort
from palpate.types.images import Codec
from palpate.types.motion import Placed, Poses, always, at_times, poses_in_time
from palpate.types.stored_images import ImageSpool

logger = logging.getLogger(__name__)


@dataclass
class Streams:
    """What was read of a bag."""

    spool: ImageSpool = field(default_factory=ImageSpool)
    """Encoded images."""
    images: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Where in the spool they are, by their times [ns], in the order of the bag."""
    codec: Codec | None = None
    """How they are encoded."""
    poses: dict[str, Poses] = field(default_factory=dict)
    """Poses by topic, and those of transforms by the frame that they place."""
    static: set[str] = field(default_factory=set)
    """Frames whose transforms hold once and for all."""


def read_streams(found: Contents, chosen: Mapping, choices: BagChoices) -> Streams:
    """Read what a mapping uses. Raises FileError, without the name of the bag, on a message that cannot be used."""
    streams = Streams()
    needed = {name for source in (chosen.sensor, chosen.object) for name in _names(found, source)}
    count = 0
    gathered: dict[str, tuple[list[Pose], list[int]]] = {}
    topics = {topic.channel: topic for topic in topics_of(found, chosen)}
    try:
        for raw in raw_messages(found.path):
            topic = topics.get(raw.channel)
            types = IMAGE_TYPES if raw.channel.topic == chosen.images else (*POSE_TYPES, *TRANSFORM_TYPES)
            # A topic may have several channels, of several types.
            if topic is None or raw.channel.type not in types or not is_read(raw.channel):
                continue
            message = decoded(raw)
            log_time = raw.log_time if choices.clock == "log" else None
            if raw.channel.topic == chosen.images:
                _add_image(streams, chosen.images, message, log_time)
                count += 1
                continue
            for pose in poses_of(message):
                name = pose.child if raw.channel.type in TRANSFORM_TYPES else raw.channel.topic
                if name not in needed:
                    continue
                poses, times = gathered.setdefault(name, ([], []))
                poses.append(pose)
                times.append(pose.stamp if log_time is None else log_time)
                if topic.static:
                    streams.static.add(name)
    except CutShort:
        pass  # `contents` has warned of it
    if repeated := count - len(streams.images):
        logger.warning("%s: %d images have the time of another one and are left out", found.path, repeated)
    streams.poses = {name: _in_time(name, *rows) for name, rows in gathered.items()}
    return streams


def placed_at(streams: Streams, source: PoseSource, found: Contents, time: NDArray[np.int64]) -> tuple[str, Placed]:
    """The frame that a source's poses are given in, and where its child was at times (M,) [ns]."""
    if isinstance(source, str):
        poses = streams.poses[source]
        return poses.frame, at_times(poses, time)

    def placed(name: str) -> Placed:
        poses = streams.poses[name]
        return always(poses, len(time)) if name in streams.static else at_times(poses, time)

    return source[0], compose_chain(*chain(found.parents, *source), placed)


def _names(found: Contents, source: PoseSource | None) -> list[str]:
    """The topic, or the frames of the transforms, that a source needs."""
    if source is None or isinstance(source, str):
        return [] if source is None else [source]
    up_parent, up_child = chain(found.parents, *source)
    return [*up_parent, *up_child]


def _in_time(name: str, poses: list[Pose], times: list[int]) -> Poses:
    """Poses of a topic or frame with their times [ns]; FileError that names it where they are in several frames."""
    if frames := sorted({pose.frame for pose in poses} - {poses[0].frame}):
        raise FileError(f"{name}: poses are given in several frames, {poses[0].frame!r} and {frames[0]!r}")
    return poses_in_time(name, poses[0].frame, np.array(times, np.int64), np.array([pose.numbers for pose in poses]))


def _add_image(streams: Streams, topic: str, message: Any, log_time: int | None) -> None:
    try:
        data, codec = image_of(message)
    except FileError as error:
        raise FileError(f"{topic}: {error}") from error
    if streams.codec not in (None, codec):
        raise FileError(f"{topic}: some images are {streams.codec}, others {codec}; expected one of them")
    if streams.codec is None and getattr(message, "encoding", "") == "8UC3":
        logger.warning(
            "%s: encoding 8UC3 does not say which colour comes first; it is taken as blue, as the driver of the DIGIT "
            "has it",
            topic,
        )
    streams.codec = codec
    time = (stamp_of(message) or 0) if log_time is None else log_time
    streams.images[time] = streams.spool.add(data)
