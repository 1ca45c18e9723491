"""Reading MCAP from its front to its end, so that one whose writer was killed is read as far as it goes."""

import mmap
import zlib
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.errors import FileError
from palpate.io.bags.raw import Channel, CutShort, RawMessage
from palpate.io.bags.unpack import unpacked

if TYPE_CHECKING:
    from mcap.records import Chunk, McapRecord

MAGIC = b"\x89MCAP0\r\n"


def mcap_messages(path: Path) -> Iterator[RawMessage]:
    """The messages of an MCAP, in the order in which they were written. Raises CutShort where it ends too early."""
    from mcap import records

    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    for record in _records(path):
        if isinstance(record, records.Schema):
            schemas[record.id] = record.name
        elif isinstance(record, records.Channel):
            type_ = schemas.get(record.schema_id, "")
            if record.message_encoding == "ros1":
                type_ = type_.replace("/", "/msg/")
            channels[record.id] = Channel(record.topic, type_, record.message_encoding)
        elif isinstance(record, records.Message) and record.channel_id in channels:
            yield RawMessage(channels[record.channel_id], record.log_time, record.data)


def leading_attachments(path: Path) -> dict[str, bytes]:
    """The attachments that stand before the first message, by name."""
    from mcap import records

    found: dict[str, bytes] = {}
    try:
        for record in _records(path):
            if isinstance(record, records.Attachment):
                found[record.name] = record.data
            elif isinstance(record, records.Message):
                break
    except CutShort:
        pass
    return found


def _records(path: Path) -> Iterator["McapRecord"]:
    """All records, those in chunks one by one. Raises CutShort."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    # Mapped: reading from it gives no more bytes than there are, whatever a length says.
    with path.open("rb") as opened, mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as file:
        reader = StreamReader(_stream(file), emit_chunks=True, record_size_limit=path.stat().st_size)
        whole = len(MAGIC)
        try:
            for record in reader.records:
                if isinstance(record, Chunk):
                    yield from _in_chunk(record)
                else:
                    yield record
                whole = file.tell()
        except FileError as error:
            raise FileError(f"{path}: {error}") from error
        except Exception as error:  # damaged bytes can make anything of lengths, text and compressed data
            file.seek(whole)
            if int.from_bytes(file.read(9)[1:], "little") > path.stat().st_size - whole - 9:
                file.seek(whole)
                yield from _start_of_chunk(file.read())
            raise CutShort(f"{path}: is cut off or damaged after {whole} bytes") from error


def _in_chunk(chunk: "Chunk") -> Iterator["McapRecord"]:
    """The records in a whole chunk, one by one: there may be many more of them than it has bytes."""
    from mcap.exceptions import EndOfFile, McapError

    plain = unpacked(chunk.compression, chunk.data)
    if len(plain) != chunk.uncompressed_size or chunk.uncompressed_crc not in (0, zlib.crc32(plain)):
        raise McapError("a chunk is damaged")
    with suppress(EndOfFile):
        yield from _plain_records(plain)


def _start_of_chunk(tail: bytes) -> Iterator["McapRecord"]:
    """The whole records in the last bytes of a file that ends within a chunk; none if it does not."""
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Chunk

    if not tail or tail[0] != Opcode.CHUNK:
        return
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(tail[9:])))
        yield from _plain_records(unpacked(chunk.compression, chunk.data))
    except Exception:  # as above; what was whole has been yielded
        return


def _plain_records(plain: bytes) -> Iterator["McapRecord"]:
    """The records in unpacked bytes, after whose last one EndOfFile is raised; chunks in chunks stay packed."""
    from mcap.stream_reader import StreamReader

    return StreamReader(BytesIO(plain), skip_magic=True, emit_chunks=True, record_size_limit=len(plain)).records


def _stream(file: mmap.mmap) -> Any:
    """What `mcap` takes for a file; a map can be read from as one."""
    return file
