"""Bags of ROS messages, read by `rosbags` and `mcap`: MCAP, ROS 2 (.db3 or its folder) and ROS 1 (.bag).

`bag_messages` yields what is in a bag, `contents` summarises it: topics, rates, clocks and frames. Bags hold no
outline of the object, so `rosbag_recording.read_bag` makes a recording of one together with an outline.
"""

import logging
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError, one_line
from palpate.files import existing_file
from palpate.io.mcap_file import CutShort, begins_with, is_mcap, mcap_messages
from palpate.io.ros_messages import TRANSFORM_TYPES, Channel, RawMessage, decoded, poses_of, stamp_of
from palpate.types.recording import Recording

logger = logging.getLogger(__name__)


def is_bag(path: Path) -> bool:
    """Return true for a bag, by its first bytes."""
    return is_mcap(path) or _is_ros2(path) or begins_with(path, b"#ROSBAG V2.0")


def _is_ros2(path: Path) -> bool:
    return (path / "metadata.yaml").is_file() or begins_with(path, b"SQLite format 3\x00")


def refuse_bag(path: Path) -> Recording:
    """Raise FileError: a bag alone is no recording."""
    raise FileError(
        f"{path}: is a bag of ROS messages without an outline of the object; palpate track and convert take it by "
        "--shape, in Python palpate.read_bag"
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
    if not is_bag(path):
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


@dataclass
class Topic:
    """The messages of one channel in numbers."""

    channel: Channel
    # Arrays of integers, as a bag may hold millions of messages.
    log_times: "array[int]" = field(default_factory=lambda: array("q"))
    """Times of recording [ns]."""
    offsets: "array[int]" = field(default_factory=lambda: array("q"))
    """Header stamps less times of recording [ns]; none where messages have no header that is read."""
    unstamped: int = 0
    """Number of headers with a stamp of zero."""

    @property
    def count(self) -> int:
        """Number of messages."""
        return len(self.log_times)

    @cached_property
    def _steps(self) -> NDArray[np.float64]:
        return np.diff(np.sort(np.array(self.log_times))) * 1e-9

    @property
    def rate(self) -> float | None:
        """Messages per second by the median interval [Hz]; None for fewer than two."""
        median = float(np.median(self._steps)) if len(self._steps) else 0.0
        return 1.0 / median if median else None

    @property
    def longest_gap(self) -> float | None:
        """The longest interval [s]; None for fewer than two messages."""
        return float(self._steps.max()) if len(self._steps) else None

    @property
    def clock_offset(self) -> float | None:
        """Header stamps less times of recording, median [s]; None without headers."""
        return float(np.median(np.array(self.offsets) * 1e-9)) if len(self.offsets) else None

    @property
    def clock_spread(self) -> float | None:
        """Largest less smallest of these differences [s]."""
        return float(np.ptp(np.array(self.offsets) * 1e-9)) if len(self.offsets) else None

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

    def of(self, types: tuple[str, ...]) -> list[str]:
        """Return the names of topics of these message types that can be read."""
        return [each.channel.topic for each in self.topics if each.channel.type in types and each.channel.is_read]


def contents(path: Path) -> Contents:
    """Read a bag through and summarise it; warns where it is cut off. Raises FileError if it holds nothing."""
    topics: dict[Channel, Topic] = {}
    parents: dict[str, str] = {}
    cut = None
    try:
        for raw in bag_messages(path):
            _count(path, raw, topics.setdefault(raw.channel, Topic(raw.channel)), parents)
    except CutShort as error:
        cut = error
    if not topics:
        raise FileError(f"{cut}; there is no message before that" if cut else f"{path}: holds no messages")
    if cut:
        count = sum(topic.count for topic in topics.values())
        logger.warning("%s, as when its recorder was killed; the %d messages before it are read", cut, count)
    return Contents(path, tuple(topics[channel] for channel in sorted(topics)), parents, cut is not None)


def _count(path: Path, raw: RawMessage, topic: Topic, parents: dict[str, str]) -> None:
    """Count a message in its topic, and add its transforms to the parents of frames."""
    topic.log_times.append(raw.log_time)
    if not raw.channel.is_read:
        return
    try:
        message = decoded(raw)
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    stamp = stamp_of(message)
    if stamp is not None:
        topic.offsets.append(stamp - raw.log_time)
        topic.unstamped += stamp == 0
    for pose in poses_of(message) if raw.channel.type in TRANSFORM_TYPES else ():
        if parents.setdefault(pose.child, pose.frame) != pose.frame:
            raise FileError(f"{path}: frame {pose.child} has two parents, {parents[pose.child]} and {pose.frame}")
