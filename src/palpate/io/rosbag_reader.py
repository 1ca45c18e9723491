"""Bags of ROS messages, read by `rosbags` and `mcap`: MCAP, ROS 2 (.db3 or its folder) and ROS 1 (.bag).

`bag_messages` yields the messages of a bag, `contents` summarises them: topics, rates, clocks and frames. Bags hold no
outline of the object; `rosbag_recording.read_bag` makes a recording of a bag and an outline.
"""

import logging
import shlex
from array import array
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from os.path import realpath
from pathlib import Path
from sys import intern
from typing import Any
from zlib import crc32

import numpy as np

from palpate.arrays import Flags
from palpate.errors import FileError, one_line
from palpate.files import begins_with, existing_file, read_text
from palpate.io.decode_message import decoded
from palpate.io.image_folder import image_files
from palpate.io.ros_messages import BOOL, IMAGE_TYPES, TRANSFORM_TYPES, Channel, Pose, RawMessage, poses_of, stamp_of
from palpate.io.time_order import are_few, believed, stamped_in_order
from palpate.types.space import Placed, Times, check_unchanged, placed_at

logger = logging.getLogger(__name__)


_PACKED = {
    b"\x28\xb5\x2f\xfd": ("zstd", "of a bag give the folder, whose metadata.yaml says so, or run `zstd -d` on"),
    b"\x04\x22\x4d\x18": ("lz4", "run `lz4 -d` on"),
    b"BZh": ("bzip2", "run `bunzip2` on"),
    b"\xfd7zXZ\x00": ("xz", "run `unxz` on"),
    b"7z\xbc\xaf\x27\x1c": ("7-Zip", "unpack"),
}
"""First bytes of compressed files that nothing here reads, with their kind and what to do."""


FEWEST_POSES = 10
"""Poses of which a single one in another frame is no second source."""


class CutShort(Exception):
    """A file ends too early, or is damaged from some point on; everything before that was read."""


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
                encoding = channel.message_encoding
                type_ = schema.name if schema else ""
                if encoding == "ros1":
                    type_ = type_.replace("/", "/msg/")
                definition = schema.data if schema else b""
                yield RawMessage(Channel(channel.topic, type_, encoding), message.log_time, message.data, definition)
        except OSError as error:
            raise FileError(f"{path}: cannot be read ({error.strerror})") from error
        except Exception as error:  # damaged bytes can raise anything in lengths, texts and compressed data
            words = f"{path}: is cut off or damaged after {file.tell()} bytes"
            raise CutShort(f"{words}, as when its recorder was killed or still writes it") from error


def front_matter(path: Path) -> tuple[dict[str, dict[str, str]], dict[str, bytes]]:
    """Return the metadata and attachments, by name, that come before the first message of an MCAP."""
    from mcap.records import Attachment, Chunk, Message, Metadata
    from mcap.stream_reader import StreamReader

    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    with path.open("rb") as file, suppress(Exception):  # of damaged bytes; what comes before them counts
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


def _elsewhere(path: Path) -> str:
    """Return in words what to do with a folder that is no bag."""
    for folder in sorted(inner for inner in path.glob("[!.]*") if inner.is_dir()):
        if image_files(folder):
            return f"images are in {folder}: palpate info {shlex.quote(str(folder))} says how to convert them"
    return "were they moved? If it is one of images or a dataset of LeRobot, palpate info says how to convert it"


def existing_bag(path: Path | str) -> Path:
    """Return the path of a file with content or of the folder of a ROS 2 bag. Raises FileError.

    Errors also name two things that `rosbags` would overlook: files beside a database that hold a part of it, its log
    (NAME.db3-wal) or the journal of a write that was cut off (NAME.db3-journal), and files that metadata.yaml does not
    list.
    """
    path = Path(path)
    if not path.is_dir():
        _check_no_journal(path)
        for first_bytes, (kind, advice) in _PACKED.items():
            if begins_with(path, first_bytes):
                raise FileError(f"{path}: is compressed by {kind}; {advice} it")
        return existing_file(path)
    files = sorted([*path.glob("[!.]*.mcap*"), *path.glob("[!.]*.db3*")])
    parts = [file for file in files if not file.name.endswith(("-wal", "-shm", "-journal"))]
    for part in parts:
        _check_no_journal(part)
    if not parts:
        raise FileError(f"{path}: is a folder without .db3 or .mcap; {_elsewhere(path)}")
    if not (path / "metadata.yaml").is_file():
        raise FileError(
            f"{path}: is a folder of {len(parts)} recordings or files of a bag, without metadata.yaml; give recordings "
            f"themselves, as {parts[0]}, or run `ros2 bag reindex` on the folder if it is a bag of a killed recorder"
        )
    listed = read_text(path / "metadata.yaml")
    for part in parts:
        if existing_file(part).name not in listed:
            raise FileError(
                f"{path}: {part.name} is not in its metadata.yaml, as after a killed recorder; run `ros2 bag reindex` "
                f"on the folder, or give recordings themselves, as {part}"
            )
    return path


def _check_no_journal(part: Path) -> None:
    """Raise FileError if a file beside a database holds a part of it."""
    for suffix, first_bytes in (("-wal", b""), ("-journal", b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7")):
        log = Path(realpath(part) + suffix)
        if log.is_file() and log.stat().st_size and begins_with(log, first_bytes):
            raise FileError(
                f"{part}: {log.name} beside it holds what is not in it yet, as its recorder runs or was killed; stop "
                f"the recorder and run: sqlite3 {part} 'PRAGMA journal_mode=DELETE'"
            )


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
    found = 0
    try:
        with rosbag2.Reader(path) if is_ros2 else rosbag1.Reader(path) as reader:
            count = reader.message_count
            for connection, time, data in reader.messages():
                encoding: Any = getattr(connection.ext, "serialization_format", "ros1")
                yield RawMessage(Channel(connection.topic, connection.msgtype, encoding), time, bytes(data))
                found += 1
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({one_line(error)})") from error
    except Exception as error:  # damaged bytes can raise anything in the readers
        words = one_line(error)
        if "malformed" in words:
            database = path if path.is_file() else next(path.glob("[!.]*.db3"), path)
            new = database.with_stem(f"{database.stem}_new")
            repair = f"`sqlite3 {database} .recover | sqlite3 {new}` may save a part of it"
            raise FileError(f"{path}: its database is cut off or damaged; {repair}") from error
        repair = "ros2 bag reindex" if is_ros2 else "rosbag reindex"
        raise FileError(f"{path}: cannot be read ({words}); `{repair}` may repair it{_parts(path)}") from error
    if count and not found:
        raise FileError(
            f"{path}: {count} messages are in its metadata.yaml, and it fits none of its files{_parts(path)}"
        )


def _parts(path: Path) -> str:
    """Return advice to give a file of a folder in its place, or ""."""
    files = sorted([*path.glob("[!.]*.mcap"), *path.glob("[!.]*.db3")])
    return f"; or give its file itself, as {files[0]}" if len(files) == 1 else ""


@dataclass
class Stream:
    """Times and numbers of the messages of one topic, or of the transforms of one frame."""

    name: str
    is_transform: bool = False
    is_static: bool = False
    """True for transforms that hold at all times."""
    is_foxglove: bool = False
    """True for transforms by a schema of Foxglove, where one that is sent once holds at all times."""
    times: dict[str, "array[int]"] = field(default_factory=lambda: {"log": array("q"), "header": array("q")})
    """Times by clock [ns]; by the clock of headers there are none if messages have no headers."""
    frame: "list[str]" = field(default_factory=list)
    """Frame in which each pose is given."""
    numbers: "array[float]" = field(default_factory=partial(array, "d"))
    """Seven numbers of each pose, position x, y, z [m] and quaternion x, y, z, w; of each contact flag its value; of
    each image a checksum, which tells one that was recorded twice."""
    bodies: set[str] = field(default_factory=set)
    """Frames whose poses transforms and odometry give."""
    topics: set[str] = field(default_factory=set)
    """Topics that the transforms were on."""
    damaged: int = 0
    """Number of messages that do not decode."""

    def are_equal(self, clock: str) -> bool:
        """Return true if too many messages have the same time: half of them or, of transforms, all.

        Transforms may be sent again, and so may poses, with their value.
        """
        times = self.times[clock]
        different = len(set(times))
        if len(times) < 2 or different > len(times) // 2:
            return False
        if different == 1 or not self.numbers:
            return different == 1 or not self.is_transform
        rows = np.array(self.numbers).reshape(len(times), -1)
        messages = len(np.unique(np.column_stack([np.array(times, np.int64).view(np.float64), rows]), axis=0))
        return not self.is_transform and different <= messages // 2

    @property
    def frames(self) -> list[str]:
        """Frames in which the poses are given, but those of a few poses; several contradict one another."""
        counts = Counter(self.frame)
        usual, most = counts.most_common(1)[0] if counts else ("", 0)
        others = len(self.frame) - most
        if len(self.frame) >= FEWEST_POSES and are_few(others, len(self.frame)):
            return [usual]
        return list(counts)

    @property
    def offsets(self) -> Times:
        """Header stamps less times of recording [ns], of messages whose stamp is neither 0 nor one of a few far off."""
        stamp = np.array(self.times["header"], np.int64)
        log_time = np.array(self.times["log"], np.int64)[: len(stamp)]
        return (stamp - log_time)[believed(stamp, log_time)]

    def about(self) -> dict[str, Any]:
        """Return the numbers that `palpate info` shows."""
        steps = np.diff(np.sort(np.array(self.times["log"]))) * 1e-9
        offsets = self.offsets * 1e-9
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
            self.frame.append(intern(pose.frame))
            self.bodies.add(pose.child)

    def placed(self, clock: str, time: Times) -> Placed:
        """Return the poses at times (M,) [ns] of a clock. Raises FileError if the times of the poses go back."""
        numbers = np.array(self.numbers).reshape(-1, 7)
        times = np.array(self.times[clock], np.int64)
        log_time = np.array(self.times["log"], np.int64)
        holds_always = self.is_static or (self.is_foxglove and len(numbers) == 1)
        if self.is_static and len(self.topics) > 1:
            raise FileError(f"{self.name} are on {' and '.join(sorted(self.topics))}; allowed is one of both")
        in_frame = self._in_usual_frame()
        numbers = numbers[in_frame]
        times = times[in_frame]
        log_time = log_time[in_frame]
        if self.is_static:
            check_unchanged(self.name, log_time, numbers)
        if not holds_always:
            ordered = stamped_in_order(self.name, times, log_time, clock == "header")
            times = ordered.time
            numbers = numbers[ordered.numbers]
        return placed_at(self.name, times, numbers, time, holds_always)

    def _in_usual_frame(self) -> Flags:
        """Return flags of poses without the few that are given in another frame, which a warning counts."""
        frames = self.frames
        kept = np.array([frame in frames for frame in self.frame], np.bool_)
        if not kept.all():
            words = "%s: %d of %d poses are given in frame %r, not in %r, and are left out"
            other = self.frame[int(np.argmin(kept))]
            logger.warning(words, self.name, (~kept).sum(), len(kept), other, frames[0])
        return kept


@dataclass(frozen=True)
class Contents:
    """Contents of a bag without its images."""

    path: Path
    topics: dict[Channel, Stream]
    """Sorted by name."""
    transforms: dict[str, Stream]
    """Transforms by the frame whose pose they give."""

    def of(self, types: Collection[str]) -> dict[str, Stream]:
        """Return the topics of some types that are read, by name."""
        return {
            channel.topic: stream
            for channel, stream in self.topics.items()
            if channel.is_read and channel.type in types
        }


def contents(path: Path) -> Contents:
    """Read a whole bag and summarise it; warns where it is cut off or damaged. Raises FileError if it is empty."""
    topics: dict[Channel, Stream] = {}
    transforms: dict[str, Stream] = {}
    cut = None
    try:
        for raw in bag_messages(path):
            is_transform = raw.channel.type in TRANSFORM_TYPES
            topic = topics.setdefault(raw.channel, Stream(raw.channel.topic, is_transform))
            _add_message(raw, topic, transforms)
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


def _add_message(raw: RawMessage, topic: Stream, transforms: dict[str, Stream]) -> None:
    """Add a message to the stream of its topic, and its transforms to those of their frames."""
    if not raw.channel.is_read:
        topic.add(raw.log_time, None)
        return
    try:
        message = decoded(raw)
    except FileError:
        topic.damaged += 1
        return
    poses = poses_of(message)
    if not topic.is_transform:
        topic.add(raw.log_time, stamp_of(message), poses[0] if poses else None)
        if raw.channel.type == BOOL:
            topic.numbers.append(message.data)
        elif raw.channel.type in IMAGE_TYPES:
            topic.numbers.append(crc32(raw.data))
    elif poses:
        topic.add(raw.log_time, stamp_of(message))
        for pose in poses:
            if not pose.child or not pose.frame or pose.child == pose.frame:
                continue  # which tf2 ignores as well
            stream = transforms.setdefault(pose.child, Stream(f"transforms of {pose.child}", is_transform=True))
            stream.is_static |= raw.channel.topic.endswith("tf_static")
            stream.is_foxglove |= raw.channel.is_foxglove
            stream.topics.add(raw.channel.topic)
            stream.add(raw.log_time, pose.stamp, pose)
