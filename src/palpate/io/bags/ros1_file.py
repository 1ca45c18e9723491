"""Reading a ROS 1 bag from its front to its end, so that one whose recorder was killed is read as far as it goes.

The format is version 2.0: records of a header, which is a list of name=value, and data; chunks hold further records. A
recorder writes the index last, and the length of a chunk once the chunk is done: a record that follows an empty chunk
belongs into it.
"""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from palpate.errors import FileError
from palpate.io.bags.raw import Channel, CutShort, RawMessage
from palpate.io.bags.unpack import unpacked

FIRST_LINE = b"#ROSBAG V2.0"

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7


def ros1_messages(path: Path) -> Iterator[RawMessage]:
    """The messages of a bag, in the order in which they were written. Raises CutShort where it ends too early."""
    with path.open("rb") as file:
        file.readline()
        indexed = []
        try:
            yield from _messages(file, path.stat().st_size, {}, indexed)
        except FileError as error:
            raise FileError(f"{path}: {error}") from error
        except Exception as error:  # damaged bytes can make anything of lengths, names and compressed data
            raise CutShort(f"{path}: is cut off or damaged after {file.tell()} bytes") from error
        if not any(indexed):
            raise CutShort(f"{path}: ends without an index after {file.tell()} bytes")


def _messages(
    stream: BinaryIO, longest: int, channels: dict[int, Channel], indexed: list[bool], within: bool = False
) -> Iterator[RawMessage]:
    """The messages among the records of a bag or a chunk; ValueError where the last record is not whole.

    A chunk holds no chunks.

    No record is longer than `longest` [bytes]. Channels become known on the way; `indexed` gets whether the bag's
    header knows of an index.
    """
    while start := stream.read(4):
        fields = _fields(stream.read(min(_number(start), longest)))
        size = _number(stream.read(4))
        data = stream.read(min(size, longest))
        kind = _number(fields["op"])
        if kind == CHUNK and not within:
            plain = unpacked(fields["compression"].decode(), data)
            yield from _messages(BytesIO(plain), len(plain), channels, indexed, within=True)
        if len(data) < size:
            raise ValueError("the last record is not whole")
        if kind == CONNECTION:
            type_ = _fields(data)["type"].decode().replace("/", "/msg/")
            channels[_number(fields["conn"])] = Channel(fields["topic"].decode(), type_, "ros1")
        elif kind == MESSAGE:
            seconds, rest = _number(fields["time"][:4]), _number(fields["time"][4:8])
            yield RawMessage(channels[_number(fields["conn"])], seconds * 10**9 + rest, data)
        elif kind == BAG_HEADER:
            indexed.append(_number(fields["index_pos"]) > 0)
        elif kind not in (INDEX, CHUNK, CHUNK_INFO):
            raise ValueError(f"no record is of kind {kind}")


def _fields(data: bytes) -> dict[str, bytes]:
    """A header's values by name."""
    fields: dict[str, bytes] = {}
    start = 0
    while start < len(data):
        end = start + 4 + _number(data[start : start + 4])
        name, _, value = data[start + 4 : end].partition(b"=")
        fields[name.decode()] = value
        start = end
    return fields


def _number(data: bytes) -> int:
    if not data:
        raise ValueError("a number is missing")
    return int.from_bytes(data, "little")
