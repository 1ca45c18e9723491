"""Bags of ROS messages, read by `rosbags` and `mcap`: MCAP, ROS 2 (.db3 or its folder) and ROS 1 (.bag).

`bag_messages` yields what is in a bag, `contents` summarises it: topics, rates, clocks and frames. Bags hold no
outline of the object, so `rosbag_recording.read_bag` makes a recording of one together with an outline.
"""

import logging
from array import array
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import FileError, one_line
from palpate.files import existing_file, read_text
from palpate.io.ros_messages import BOOL, POSE_TYPES, TRANSFORM_TYPES, Channel, RawMessage, decoded, poses_of, stamp_of
from palpate.types.recording import Recording
from palpate.types.space import Placed, Times, placed_at

if TYPE_CHECKING:
    from mcap.records import McapRecord

logger = logging.getLogger(__name__)


class CutShort(Exception):
    """A file ends too early or is damaged from some place on; everything before that was read."""


def begins_with(path: Path, first: bytes) -> bool:
    """Return true if there is a file that begins with these bytes."""
    with suppress(OSError), path.open("rb") as file:
        return file.read(len(first)) == first
    return False


def is_mcap(path: Path) -> bool:
    """Return true if a file begins as an MCAP does."""
    return begins_with(path, b"\x89MCAP0\r\n")


def mcap_records(path: Path, chunks: bool = False) -> Iterator["McapRecord"]:
    """Yield all records of an MCAP; those in chunks one by one, or whole `chunks`. Raises CutShort at the end."""
    from mcap.stream_reader import StreamReader

    with path.open("rb") as file:
        # No record can be longer than the file, so a damaged length does not ask for memory.
        limit = path.stat().st_size
        try:
            yield from StreamReader(file, emit_chunks=chunks, validate_crcs=True, record_size_limit=limit).records
        except OSError as error:
            raise FileError(f"{path}: cannot be read ({error.strerror})") from error
        except Exception as error:  # damaged bytes can raise anything in lengths, texts and compressed data
            words = f"{path}: is cut off or damaged after {file.tell()} bytes"
            raise CutShort(f"{words}, as when its recorder was killed or still writes it") from error


def mcap_messages(path: Path) -> Iterator[RawMessage]:
    """Yield the messages of an MCAP in the order in which they were written. Raises CutShort."""
    from mcap.records import Channel as ChannelRecord
    from mcap.records import Message, Schema

    types: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    for record in mcap_records(path):
        if isinstance(record, Schema):
            types[record.id] = record.name
        elif isinstance(record, ChannelRecord):
            type_ = types.get(record.schema_id, "")
            if record.message_encoding == "ros1":
                type_ = type_.replace("/", "/msg/")
            channels[record.id] = Channel(record.topic, type_, record.message_encoding)
        elif isinstance(record, Message) and record.channel_id in channels:
            yield RawMessage(channels[record.channel_id], record.log_time, record.data)


def front_matter(path: Path) -> tuple[dict[str, dict[str, str]], dict[str, bytes]]:
    """Return metadata and attachments, by name, that stand before the first message of an MCAP."""
    from mcap.records import Attachment, Chunk, Message, Metadata

    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    with suppress(CutShort):
        for record in mcap_records(path, chunks=True):
            if isinstance(record, Metadata):
                metadata[record.name] = record.metadata
            elif isinstance(record, Attachment):
                attachments[record.name] = record.data
            elif isinstance(record, Chunk | Message):
                break
    return metadata, attachments


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
    """Return the path of a file with content or of the folder of a ROS 2 bag. Raises FileError.

    `rosbags` sees neither the write-ahead log of a database (NAME.db3-wal) nor files that metadata.yaml does not list.
    """
    path = Path(path)
    files = sorted([*path.glob("*.mcap*"), *path.glob("*.db3*")]) if path.is_dir() else [path]
    parts = [file for file in files if not file.name.endswith(("-wal", "-shm", "-journal"))]
    for part in parts:
        log = part.with_name(f"{part.name}-wal")
        if log.is_file() and log.stat().st_size:
            raise FileError(
                f"{part}: {log.name} beside it holds messages that are not in it yet, as its recorder runs or was "
                f"killed; stop the recorder and run: sqlite3 {part} 'PRAGMA wal_checkpoint(TRUNCATE)'"
            )
    metadata = path / "metadata.yaml"
    if not path.is_dir() or not (parts or metadata.is_file()):
        return existing_file(path)
    if not parts:
        raise FileError(f"{path}: holds metadata.yaml and no .db3 or .mcap; were they moved?")
    listed = read_text(metadata) if metadata.is_file() else ""
    for part in parts:
        if existing_file(part).name not in listed:
            raise FileError(
                f"{path}: {part.name} is not in its metadata.yaml, as when its recorder was killed; run "
                f"`ros2 bag reindex` on the folder, or give {part}"
            )
    return path


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
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({one_line(error)})") from error
    except Exception as error:  # damaged bytes can raise anything in the readers
        repair = "ros2 bag reindex" if is_ros2 else "rosbag reindex"
        raise FileError(f"{path}: cannot be read ({one_line(error)}); `{repair}` may repair it") from error


integers = partial(array, "q")
"""An array of integers, as a bag may hold millions of messages."""


@dataclass
class Topic:
    """The messages of one channel in numbers."""

    channel: Channel
    log_times: "array[int]" = field(default_factory=integers)
    """Times of recording [ns]."""
    stamps: "array[int]" = field(default_factory=integers)
    """Header stamps [ns] of messages that are read."""
    offsets: "array[int]" = field(default_factory=integers)
    """These stamps less the times of recording [ns]."""
    flags: dict[int, bool] = field(default_factory=dict)
    """Contact flags by their times of recording [ns]."""
    damaged: int = 0
    """Number of messages that do not decode."""

    @property
    def is_static(self) -> bool:
        """True for transforms that hold at all times."""
        return self.channel.type in TRANSFORM_TYPES and self.channel.topic.endswith("tf_static")

    def are_equal(self, clock: str) -> bool:
        """Return true if too many messages have one time; transforms of several frames may be sent at once."""
        times = self.log_times if clock == "log" else self.stamps
        return len(times) > 1 and len(set(times)) <= (1 if self.channel.type in TRANSFORM_TYPES else len(times) // 2)

    @property
    def clock_offset(self) -> float | None:
        """The median of header stamps less times of recording [s]; None without headers."""
        return float(np.median(self.offsets)) * 1e-9 if self.offsets else None

    def about(self) -> dict[str, Any]:
        """Return the numbers that `palpate info` shows."""
        steps = np.diff(np.sort(np.array(self.log_times))) * 1e-9
        median = float(np.median(steps)) if len(steps) else 0.0
        return {
            **self.channel._asdict(),
            "messages": len(self.log_times),
            "rate_hz": 1.0 / median if median else None,
            "longest_gap_s": float(steps.max()) if len(steps) else None,
            "clock_offset_s": self.clock_offset,
            "clock_spread_s": (max(self.offsets) - min(self.offsets)) * 1e-9 if self.offsets else None,
            "unstamped": self.stamps.count(0),
            "damaged": self.damaged,
        }


@dataclass
class PoseStream:
    """Poses of one topic, or of one frame that transforms place."""

    name: str
    frames: list[str] = field(default_factory=list)
    """Frames that they are given in; several contradict one another."""
    is_static: bool = False
    """True for transforms that hold at all times."""
    times: dict[str, "array[int]"] = field(default_factory=lambda: {"log": integers(), "header": integers()})
    """Times [ns] by clock."""
    numbers: "array[float]" = field(default_factory=partial(array, "d"))
    """Seven of each pose: position x, y, z [m] and quaternion x, y, z, w."""

    def placed(self, clock: str, time: Times) -> Placed:
        """Return the poses at times (M,) [ns] of a clock."""
        numbers = np.array(self.numbers).reshape(-1, 7)
        return placed_at(self.name, np.array(self.times[clock], np.int64), numbers, time, self.is_static)


@dataclass(frozen=True)
class Contents:
    """Contents of a bag, but for its images."""

    path: Path
    topics: tuple[Topic, ...]
    """Sorted by name."""
    poses: dict[str, PoseStream]
    """Poses by topic."""
    transforms: dict[str, PoseStream]
    """Transforms by the frame that they place."""

    def named(self, types: Collection[str]) -> list[str]:
        """Return the names of topics of some types that are read."""
        return [topic.channel.topic for topic in self.topics if topic.channel.is_read and topic.channel.type in types]


def contents(path: Path) -> Contents:
    """Read a bag through and summarise it; warns where it is cut off. Raises FileError if it holds nothing."""
    topics: dict[Channel, Topic] = {}
    poses: dict[str, PoseStream] = {}
    transforms: dict[str, PoseStream] = {}
    cut = None
    try:
        for raw in bag_messages(path):
            topic = topics.setdefault(raw.channel, Topic(raw.channel))
            topic.log_times.append(raw.log_time)
            if not raw.channel.is_read:
                continue
            try:
                message = decoded(raw)
            except FileError:
                topic.damaged += 1
                continue
            if (stamp := stamp_of(message)) is not None:
                topic.stamps.append(stamp)
                topic.offsets.append(stamp - raw.log_time)
            if raw.channel.type == BOOL:
                topic.flags[raw.log_time] = bool(message.data)
            is_transform = raw.channel.type in TRANSFORM_TYPES
            for pose in poses_of(message) if is_transform or raw.channel.type in POSE_TYPES else ():
                name, streams = (pose.child, transforms) if is_transform else (raw.channel.topic, poses)
                stream = streams.setdefault(name, PoseStream(name))
                stream.is_static |= topic.is_static
                if pose.frame not in stream.frames:
                    stream.frames.append(pose.frame)
                stream.times["log"].append(raw.log_time)
                stream.times["header"].append(pose.stamp)
                stream.numbers.extend(pose.numbers)
    except CutShort as error:
        cut = error
    if not topics:
        raise FileError(f"{cut}; there is no message before that" if cut else f"{path}: holds no messages")
    if cut:
        count = sum(len(topic.log_times) for topic in topics.values())
        logger.warning("%s; the %d messages before that are read", cut, count)
    return Contents(path, tuple(topics[channel] for channel in sorted(topics)), poses, transforms)
