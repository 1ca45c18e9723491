"""Bags of ROS messages, read by `rosbags` and `mcap`: MCAP, ROS 2 (.db3 or its folder) and ROS 1 (.bag).

`bag_messages` yields what is in a bag, `contents` summarises it: topics, rates, gaps, clocks and frames. Bags hold no
outline of the object, so `rosbag_recording.read_bag` makes a recording of one together with an outline.
"""

import logging
from array import array
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import FileError, one_line
from palpate.files import existing_file
from palpate.io.mcap_file import CutShort, is_mcap, mcap_messages
from palpate.io.ros_messages import (
    ENCODINGS,
    TRANSFORM_TYPES,
    Channel,
    RawMessage,
    decoded,
    is_read,
    poses_of,
    stamp_of,
)
from palpate.types.recording import Recording

logger = logging.getLogger(__name__)

DESCRIPTION = "bag of ROS messages: MCAP (.mcap), ROS 2 (.db3 or its folder), ROS 1 (.bag)"


def detect(path: Path) -> bool:
    """Return true for a bag, by its first bytes."""
    return is_mcap(path) or _is_ros2(path) or _begins(path, b"#ROSBAG V2.0")


def read(path: Path) -> Recording:
    """Raise FileError: a bag alone is no recording."""
    raise FileError(
        f"{existing_bag(path)}: is a bag of ROS messages without an outline of the object; palpate track and "
        "convert take it by --shape, in Python palpate.read_bag"
    )


def existing_bag(path: Path | str) -> Path:
    """Return the path of a file with content or of the folder of a ROS 2 bag. Raises FileError."""
    path = Path(path)
    if (path / "metadata.yaml").is_file():
        return path
    if path.is_dir() and (parts := sorted([*path.glob("*.mcap"), *path.glob("*.db3")])):
        raise FileError(
            f"{path}: is a folder without metadata.yaml, as a killed recorder leaves it; give {parts[0]}, or run "
            "`ros2 bag reindex` on the folder"
        )
    return existing_file(path)


def bag_messages(path: Path) -> Iterator[RawMessage]:
    """Yield the messages of a bag.

    Raises CutShort after the last whole message of an MCAP that ends too early, FileError where a bag cannot be read.
    """
    path = existing_bag(path)
    if not detect(path):
        raise FileError(f"{path}: is no bag; known are MCAP, ROS 2 .db3 or its folder, and ROS 1 .bag")
    for raw in mcap_messages(path) if is_mcap(path) else _library_messages(path):
        if not 0 <= raw.log_time < 2**62:
            raise FileError(f"{path}: {raw.channel.topic}: a message was recorded at {raw.log_time} ns, past any clock")
        yield raw


def _library_messages(path: Path) -> Iterator[RawMessage]:
    """Yield the messages of a ROS 1 or ROS 2 bag. Raises FileError, which names the tool that may repair the bag."""
    from rosbags import rosbag1, rosbag2

    is_ros2 = _is_ros2(path)
    try:
        with rosbag2.Reader(path) if is_ros2 else rosbag1.Reader(path) as reader:
            for connection, time, data in reader.messages():
                encoding: Any = getattr(connection.ext, "serialization_format", "ros1")
                yield RawMessage(Channel(connection.topic, connection.msgtype, encoding), time, bytes(data))
    except Exception as error:  # damaged bytes can raise anything in the readers
        repair = "ros2 bag reindex" if is_ros2 else "rosbag reindex"
        raise FileError(f"{path}: cannot be read ({one_line(error)}); `{repair}` may repair it") from error


def _is_ros2(path: Path) -> bool:
    return (path / "metadata.yaml").is_file() or _begins(path, b"SQLite format 3\x00")


def _begins(path: Path, first: bytes) -> bool:
    with suppress(OSError), path.open("rb") as file:
        return file.read(len(first)) == first
    return False


@dataclass(frozen=True)
class Topic:
    """The messages of one channel in numbers."""

    channel: Channel
    count: int
    """Number of messages."""
    rate: float | None
    """Messages per second by the median interval [Hz]; None for fewer than two."""
    gaps: int
    """Number of intervals of more than three median ones."""
    longest_gap: float | None
    """The longest interval [s]; None for fewer than two messages."""
    clock_offset: float | None
    """Header stamps less times of recording, median [s]; None where messages have no header that is read."""
    clock_spread: float | None
    """Largest less smallest of these differences [s]."""
    unstamped: int
    """Number of headers with a stamp of zero."""

    @property
    def is_static(self) -> bool:
        """True for transforms that hold at all times."""
        return self.channel.type in TRANSFORM_TYPES and self.channel.topic.endswith("tf_static")


@dataclass(frozen=True)
class Contents:
    """Contents of a bag."""

    path: Path
    topics: tuple[Topic, ...]
    """Sorted by name."""
    parents: dict[str, str]
    """Parent of each frame that a transform places."""
    cut: bool
    """True where the bag ends too early, as when its recorder was killed."""

    def of(self, types: tuple[str, ...]) -> list[Topic]:
        """Return the topics of these message types that can be read."""
        return [topic for topic in self.topics if topic.channel.type in types and is_read(topic.channel)]


def contents(path: Path) -> Contents:
    """Read a bag through and summarise it; warns where it is cut off. Raises FileError if it holds nothing."""
    tallies: dict[Channel, _Tally] = {}
    parents: dict[str, str] = {}
    cut = False
    try:
        for raw in bag_messages(path):
            tally = tallies.setdefault(raw.channel, _Tally())
            tally.log_times.append(raw.log_time)
            if is_read(raw.channel):
                tally.look_into(path, raw, parents)
    except CutShort as error:
        if not tallies:
            raise FileError(f"{error}; there is no message before that") from error
        cut = True
        count = sum(len(tally.log_times) for tally in tallies.values())
        logger.warning("%s, as when its recorder was killed; the %d messages before it are read", error, count)
    if not tallies:
        raise FileError(f"{path}: holds no messages")
    topics = tuple(tally.topic(channel) for channel, tally in sorted(tallies.items()))
    if ignored := [topic.channel for topic in topics if topic.channel.encoding not in ENCODINGS]:
        names = ", ".join(f"{channel.topic} ({channel.encoding or 'unknown'})" for channel in ignored)
        logger.warning("%s: topics that are no ROS messages are ignored: %s", path, names)
    return Contents(path, topics, parents, cut)


@dataclass
class _Tally:
    """Counts of one channel; arrays of integers, as a bag may hold millions of messages."""

    log_times: "array[int]" = field(default_factory=lambda: array("q"))
    offsets: "array[int]" = field(default_factory=lambda: array("q"))
    unstamped: int = 0

    def look_into(self, path: Path, raw: RawMessage, parents: dict[str, str]) -> None:
        try:
            message = decoded(raw)
        except FileError as error:
            raise FileError(f"{path}: {error}") from error
        stamp = stamp_of(message)
        if stamp is not None:
            self.offsets.append(stamp - raw.log_time)
            self.unstamped += stamp == 0
        if raw.channel.type in TRANSFORM_TYPES:
            for pose in poses_of(message):
                if parents.setdefault(pose.child, pose.frame) != pose.frame:
                    both = f"{parents[pose.child]} and {pose.frame}"
                    raise FileError(f"{path}: frame {pose.child} has two parents, {both}")

    def topic(self, channel: Channel) -> Topic:
        step = np.diff(np.sort(np.array(self.log_times))) * 1e-9
        median = float(np.median(step)) if len(step) else 0.0
        offsets = np.array(self.offsets) * 1e-9
        return Topic(
            channel=channel,
            count=len(self.log_times),
            rate=1.0 / median if median else None,
            gaps=int(np.count_nonzero(step > 3.0 * median)) if median else 0,
            longest_gap=float(step.max()) if len(step) else None,
            clock_offset=float(np.median(offsets)) if len(offsets) else None,
            clock_spread=float(np.ptp(offsets)) if len(offsets) else None,
            unstamped=self.unstamped,
        )
