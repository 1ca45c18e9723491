"""MCAP files: their records from front to back, also of a file that is cut off, and writers of ROS 2 messages."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import new_file, whole_file
from palpate.io.ros_messages import Channel, MessageSink, RawMessage, ros_types

if TYPE_CHECKING:
    from mcap.records import McapRecord


class CutShort(Exception):
    """A file ends too early or is damaged from some place on; everything before that was read."""


class MessageWriter(MessageSink):
    """Puts messages into an MCAP that is open."""

    def __init__(self, writer: Any) -> None:
        """Take the writer of `mcap`."""
        self.writer = writer
        self._channels: dict[str, int] = {}

    def add(self, topic: str, type_: str, time: int, **fields: Any) -> None:
        """Add a message that was recorded and sent at a time [ns]."""
        store = ros_types("cdr")
        if topic not in self._channels:
            text = store.generate_msgdef(type_, ros_version=2)[0].encode()
            schema = self.writer.register_schema(type_, "ros2msg", text)
            self._channels[topic] = self.writer.register_channel(topic, "cdr", schema)
        data = bytes(store.serialize_cdr(self.make(type_, **fields), type_))
        self.writer.add_message(self._channels[topic], time, data, time)

    def make(self, type_: str, **fields: Any) -> Any:
        """Return a message, or a part of one."""
        return ros_types("cdr").types[type_](**fields)


@contextmanager
def new_mcap(path: Path | str, overwrite: bool = False, growing: bool = False) -> Iterator[MessageWriter]:
    """Open a new MCAP that is written whole or not at all; an existing one is replaced only if `overwrite`.

    One that is `growing` is at its place from the start; all but its last few kB stay if the process is killed.
    """
    from mcap.writer import CompressionType, Writer

    with nullcontext(new_file(path, overwrite)) if growing else whole_file(path, overwrite) as place:
        try:
            with place.open("wb") as file:
                # Images are compressed already; data checksums find a damaged record anywhere.
                writer = Writer(file, compression=CompressionType.NONE, use_chunking=not growing, enable_data_crcs=True)
                writer.start(profile="ros2", library="palpate")
                try:
                    yield MessageWriter(writer)
                finally:
                    writer.finish()
        except OSError as error:
            raise FileError(f"{path}: cannot be written ({error})") from error


def nanoseconds(path: Path | str, time: NDArray[np.float64]) -> list[int]:
    """Return times (N,) [s] as stamps [ns], counted from the first if that is below 0.

    Raises FileError where ROS has no such stamp.
    """
    latest, time = 2.0**31, time - min(time[0], 0.0)
    if len(wrong := np.flatnonzero((time < 0.0) | (time >= latest))):
        found = f"frame {wrong[0]} is at {time[wrong[0]]:g} s"
        raise FileError(f"{path}: {found}, stamps of ROS messages go from 0 to {latest:g} s")
    whole = np.floor(time)
    return (whole.astype(np.int64) * 10**9 + np.rint((time - whole) * 1e9).astype(np.int64)).tolist()


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
