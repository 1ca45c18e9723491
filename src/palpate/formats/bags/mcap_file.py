"""Reading MCAP from its front to its end, so that one whose writer was killed is read as far as it goes."""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import FileError
from palpate.formats.bags.raw import Channel, CutShort, RawMessage

if TYPE_CHECKING:
    from mcap.records import Chunk, McapRecord

MAGIC = b"\x89MCAP0\r\n"

LARGEST_CHUNK = 2**30
"""[bytes] that a chunk may say it decompresses to; writers make chunks of some megabytes."""


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
            channel = channels[record.channel_id]
            if record.log_time >= 2**63:
                raise FileError(
                    f"{path}: {channel.topic}: a message was recorded at {record.log_time} ns, past any clock"
                )
            yield RawMessage(channel, record.log_time, record.data)


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

    with path.open("rb") as file:
        # No record is larger than the file, whatever its length says.
        reader = StreamReader(file, emit_chunks=True, record_size_limit=path.stat().st_size)
        whole = len(MAGIC)
        try:
            for record in reader.records:
                if isinstance(record, Chunk):
                    yield from _whole_chunk(record)
                else:
                    yield record
                whole = file.tell()
        except Exception as error:  # damaged bytes can make anything of lengths, text and compressed data
            file.seek(whole)
            if int.from_bytes(file.read(9)[1:], "little") > path.stat().st_size - whole - 9:
                file.seek(whole)
                yield from _start_of_chunk(file.read())
            raise CutShort(f"{path}: is cut off or damaged after {whole} bytes") from error


def _whole_chunk(chunk: "Chunk") -> list["McapRecord"]:
    from mcap.exceptions import McapError
    from mcap.stream_reader import breakup_chunk

    if chunk.uncompressed_size > LARGEST_CHUNK:
        raise McapError(f"a chunk says that it holds {chunk.uncompressed_size} bytes")
    return breakup_chunk(chunk, validate_crc=True)


def _start_of_chunk(tail: bytes) -> Iterator["McapRecord"]:
    """The whole records in the last bytes of a file that ends within a chunk; none if it does not."""
    import lz4.frame
    import zstandard
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    if not tail or tail[0] != Opcode.CHUNK:
        return
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(tail[9:])))
        if chunk.uncompressed_size > LARGEST_CHUNK:
            return
        if chunk.compression == "zstd":
            plain = zstandard.ZstdDecompressor().decompressobj().decompress(chunk.data)
        elif chunk.compression == "lz4":
            plain = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data)
        else:
            plain = chunk.data
        yield from StreamReader(BytesIO(plain), skip_magic=True, record_size_limit=len(plain)).records
    except Exception:  # as above; what was whole has been yielded
        return
