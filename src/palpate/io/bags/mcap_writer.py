"""Writing MCAP with ROS 2 messages, which Foxglove, Rerun and `ros2 bag` open."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import new_file, whole_file
from palpate.io.bags.containers import check_installed
from palpate.io.bags.growing_index import keep_index_on_disk
from palpate.io.bags.message_sink import MessageSink
from palpate.io.bags.messages import ros_types

Array = NDArray[np.float64]

LATEST = 2.0**31
"""[s] A stamp has no later time, and none below 0."""


class MessageWriter(MessageSink):
    """Puts messages and attachments into an MCAP that is open."""

    def __init__(self, writer: Any) -> None:
        """Take the `mcap` writer."""
        self._writer = writer
        self._store = ros_types("cdr")
        self._channels: dict[str, int] = {}

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file; it stands at this place among the messages."""
        self._writer.add_attachment(0, 0, name, media_type, data)

    def add(self, topic: str, type_: str, time: int, **fields: Any) -> None:
        """Add a message of a type, such as geometry_msgs/msg/Pose, recorded and sent at a time [ns]."""
        if topic not in self._channels:
            text = self._store.generate_msgdef(type_, ros_version=2)[0].encode()
            schema = self._writer.register_schema(type_, "ros2msg", text)
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
        data = self._store.serialize_cdr(self.make(type_, **fields), type_)
        self._writer.add_message(self._channels[topic], time, bytes(data), time)

    def flush(self) -> None:
        """Hand all that was added to the operating system, which keeps it if this process is killed."""
        self._writer.flush()

    def make(self, type_: str, **fields: Any) -> Any:
        """A message, or a part of one."""
        return self._store.types[type_](**fields)


@contextmanager
def new_mcap(path: Path | str, overwrite: bool = False) -> Iterator[MessageWriter]:
    """A new MCAP to put messages into, written whole or not at all; an existing one is replaced only if `overwrite`."""
    check_installed()
    from mcap.writer import Writer

    with whole_file(path, overwrite) as temporary, temporary.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="palpate")
        yield MessageWriter(writer)
        writer.finish()


def scratch_mcap() -> MessageWriter:
    """A writer whose messages go nowhere: the first of each type takes long, and can be written here."""
    check_installed()
    from mcap.writer import Writer

    return MessageWriter(Writer(BytesIO()))


@contextmanager
def growing_mcap(path: Path | str, overwrite: bool = False) -> Iterator[MessageWriter]:
    """A new MCAP that is at its place from the beginning; what was flushed is there if the process is killed.

    Each flush ends a chunk; Rerun reads nothing that is in none. Raises FileError where the file cannot be written, and
    where it exists unless `overwrite`.
    """
    check_installed()
    from mcap.writer import CompressionType, Writer

    path = new_file(path, overwrite)
    try:
        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.NONE)
            keep_index_on_disk(writer)
            writer.start(profile="ros2", library="palpate")
            try:
                yield MessageWriter(writer)
            finally:
                writer.finish()
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({error})") from error


def nanoseconds(path: Path | str, time: Array) -> list[int]:
    """Times (N,) [s] as stamps [ns]. Raises FileError where a stamp cannot be so early or late."""
    wrong = np.flatnonzero((time < 0.0) | (time >= LATEST))
    if len(wrong):
        raise FileError(
            f"{path}: frame {wrong[0]} is at {time[wrong[0]]:g} s, stamps of ROS messages go from 0 to {LATEST:g} s"
        )
    whole = np.floor(time)
    return (whole.astype(np.int64) * 10**9 + np.rint((time - whole) * 1e9).astype(np.int64)).tolist()
