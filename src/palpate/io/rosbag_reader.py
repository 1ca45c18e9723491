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
from os.path import realpath
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import FileError, one_line
from palpate.files import begins_with, existing_file, read_text
from palpate.io.ros_messages import BOOL, TRANSFORM_TYPES, Channel, Pose, RawMessage, decoded, poses_of, stamp_of
from palpate.types.space import Placed, Times, placed_at

logger = logging.getLogger(__name__)


class CutShort(Exception):
    """A file ends too early or is damaged from some place on; everything before that was read."""


def is_mcap(path: Path) -> bool:
    """Return true if a file begins as an MCAP does."""
    return begins_with(path, b"\x89MCAP0\r\n")


def mcap_messages(path: Path) -> Iterator[RawMessage]:
    """Yield the messages of an MCAP in the order in which they were written. Raises CutShort."""
    from mcap.reader import NonSeekingReader

    with path.open("rb") as file:
        try:
            reader = NonSeekingReader(file, validate_crcs=True, record_size_limit=path.stat().st_size)
            for schema, channel, message in reader.iter_messages(log_time_order=False):
                encoding, type_ = channel.message_encoding, schema.name if schema else ""
                type_ = type_.replace("/", "/msg/") if encoding == "ros1" else type_
                yield RawMessage(Channel(channel.topic, type_, encoding), message.log_time, message.data)
        except OSError as error:
            raise FileError(f"{path}: cannot be read ({error.strerror})") from error
        except Exception as error:  # damaged bytes can raise anything in lengths, texts and compressed data
            words = f"{path}: is cut off or damaged after {file.tell()} bytes"
            raise CutShort(f"{words}, as when its recorder was killed or still writes it") from error


def front_matter(path: Path) -> tuple[dict[str, dict[str, str]], dict[str, bytes]]:
    """Return metadata and attachments, by name, that stand before the first message of an MCAP."""
    from mcap.records import Attachment, Chunk, Message, Metadata
    from mcap.stream_reader import StreamReader

    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    with path.open("rb") as file, suppress(Exception):  # of damaged bytes; what stands before them counts
        limit = path.stat().st_size  # so that a damaged length does not ask for memory
        for record in StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=limit).records:
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


def existing_bag(path: Path | str) -> Path:
    """Return the path of a file with content or of the folder of a ROS 2 bag. Raises FileError.

    `rosbags` sees neither what a database has beside it, a log (NAME.db3-wal) or the journal of a write that was cut
    off (NAME.db3-journal), nor files that metadata.yaml does not list.
    """
    path = Path(path)
    files = sorted([*path.glob("[!.]*.mcap*"), *path.glob("[!.]*.db3*")]) if path.is_dir() else [path]
    parts = [file for file in files if not file.name.endswith(("-wal", "-shm", "-journal"))]
    for part in parts:
        for mark, first in (("-wal", b""), ("-journal", b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7")):
            log = realpath(part) + mark
            if Path(log).is_file() and Path(log).stat().st_size and begins_with(Path(log), first):
                raise FileError(
                    f"{part}: {Path(log).name} beside it holds what is not in it yet, as its recorder runs or was "
                    f"killed; stop the recorder and run: sqlite3 {part} 'PRAGMA journal_mode=DELETE'"
                )
    if not path.is_dir():
        return existing_file(path)
    if not parts:
        raise FileError(
            f"{path}: is a folder without .db3 or .mcap; were they moved? One of images: see palpate convert --images"
        )
    listed = read_text(path / "metadata.yaml") if (path / "metadata.yaml").is_file() else ""
    for part in parts:
        if existing_file(part).name not in listed:
            raise FileError(
                f"{path}: {part.name} is not in its metadata.yaml, as after a killed recorder; run `ros2 bag reindex` "
                f"on the folder, or give recordings themselves, as {part}"
            )
    return path


def bag_messages(path: Path) -> Iterator[RawMessage]:
    """Yield the messages of a bag.

    Raises CutShort after the last whole message of an MCAP that ends too early, FileError where a bag cannot be read.
    """
    path = existing_bag(path)
    if not is_bag(path):  # also a file of a bag that is compressed as a whole
        raise FileError(f"{path}: is no bag; known are MCAP, ROS 2 .db3 or its folder, and ROS 1 .bag")
    for raw in mcap_messages(path) if is_mcap(path) else _library_messages(path):
        if not 0 <= raw.log_time < 2**62:
            raise FileError(f"{path}: {raw.channel.topic}: a message was recorded at {raw.log_time} ns, past any clock")
        if raw.data[:4] == b"\x28\xb5\x2f\xfd" and raw.channel.encoding == "cdr":
            raise FileError(f"{path}: its messages are compressed by zstd, as its metadata.yaml says: give the folder")
        yield raw


def _library_messages(path: Path) -> Iterator[RawMessage]:
    """Yield the messages of a ROS 1 or ROS 2 bag. Raises FileError, which names the tool that may repair the bag."""
    from rosbags import rosbag1, rosbag2

    is_ros2 = _is_ros2(path)
    if is_ros2 and path.is_file() and path.suffix != ".db3":
        raise FileError(f"{path}: is a ROS 2 database with the suffix {path.suffix!r}, allowed is .db3: rename it")
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


@dataclass
class Stream:
    """The messages of one topic, or the transforms of one frame, as numbers."""

    name: str
    is_transform: bool = False
    is_static: bool = False
    """True for transforms that hold at all times."""
    times: dict[str, "array[int]"] = field(default_factory=lambda: {"log": array("q"), "header": array("q")})
    """Times by clock [ns]; messages without headers have none in these."""
    frames: list[str] = field(default_factory=list)
    """Frames that its poses are given in; several contradict one another."""
    numbers: "array[float]" = field(default_factory=partial(array, "d"))
    """Seven of each pose, position x, y, z [m] and quaternion x, y, z, w; one of each contact flag."""
    damaged: int = 0
    """Number of messages that do not decode."""

    def are_equal(self, clock: str) -> bool:
        """Return true if too many messages have one time; transforms may be sent again."""
        times = self.times[clock]
        return len(times) > 1 and len(set(times)) <= (1 if self.is_transform else len(times) // 2)

    @property
    def offsets(self) -> Times:
        """Header stamps less times of recording [ns]; none without headers, or where they are 0, which is no stamp."""
        header = np.array(self.times["header"], np.int64)
        return (header - np.array(self.times["log"], np.int64)[: len(header)])[header != 0]

    def about(self) -> dict[str, Any]:
        """Return the numbers that `palpate info` shows."""
        steps, offsets = np.diff(np.sort(np.array(self.times["log"]))) * 1e-9, self.offsets * 1e-9
        median = float(np.median(steps)) if len(steps) else 0.0
        return {
            "messages": len(self.times["log"]) + self.damaged,
            "rate_hz": 1.0 / median if median else None,
            "longest_gap_s": float(steps.max()) if len(steps) else None,
            "clock_offset_s": float(np.median(offsets)) if len(offsets) else None,
            "clock_spread_s": float(np.ptp(offsets)) if len(offsets) else None,
            "unstamped": self.times["header"].count(0),
            "damaged": self.damaged,
        }

    def add(self, log_time: int, stamp: int | None, pose: Pose | None = None) -> None:
        """Add a message with its times [ns] and, if it has one, its pose."""
        self.times["log"].append(log_time)
        if stamp is not None:
            self.times["header"].append(stamp)
        if pose is not None:
            self.numbers.extend(pose.numbers)
            if pose.frame not in self.frames:
                self.frames.append(pose.frame)

    def placed(self, clock: str, time: Times) -> Placed:
        """Return the poses at times (M,) [ns] of a clock."""
        numbers = np.array(self.numbers).reshape(-1, 7)
        return placed_at(self.name, np.array(self.times[clock], np.int64), numbers, time, self.is_static)


@dataclass(frozen=True)
class Contents:
    """Contents of a bag, but for its images."""

    path: Path
    topics: dict[Channel, Stream]
    """Sorted by name."""
    transforms: dict[str, Stream]
    """Transforms by the frame that they place."""

    def of(self, types: Collection[str]) -> dict[str, Stream]:
        """Return the topics of some types that are read, by name."""
        return {each.topic: stream for each, stream in self.topics.items() if each.is_read and each.type in types}


def contents(path: Path) -> Contents:
    """Read a bag through and summarise it; warns where it is cut off or damaged. Raises FileError if it is empty."""
    topics: dict[Channel, Stream] = {}
    transforms: dict[str, Stream] = {}
    cut = None
    try:
        for raw in bag_messages(path):
            channel, is_transform = raw.channel, raw.channel.type in TRANSFORM_TYPES
            topic = topics.setdefault(channel, Stream(channel.topic, is_transform))
            if not channel.is_read:
                topic.add(raw.log_time, None)
                continue
            try:
                message = decoded(raw)
            except FileError:
                topic.damaged += 1
                continue
            poses = poses_of(message)
            if is_transform and not poses:
                continue
            topic.add(raw.log_time, stamp_of(message), None if is_transform or not poses else poses[0])
            if channel.type == BOOL:
                topic.numbers.append(message.data)
            for pose in poses if is_transform else ():
                stream = transforms.setdefault(pose.child, Stream(f"transforms of {pose.child}", is_transform))
                stream.is_static |= channel.topic.endswith("tf_static")
                stream.add(raw.log_time, pose.stamp, pose)
    except CutShort as error:
        cut = error
    count = sum(len(topic.times["log"]) + topic.damaged for topic in topics.values())
    if not count:
        raise FileError(f"{cut}; there is no message before that" if cut else f"{path}: holds no messages")
    if cut:
        logger.warning("%s; the %d messages before that are read", cut, count)
    for topic in topics.values():
        if topic.damaged:
            logger.warning("%s: %d messages of %s do not decode and are left out", path, topic.damaged, topic.name)
    return Contents(path, dict(sorted(topics.items())), transforms)
