"""Unpacking what a bag keeps packed, within bounds that no header of it can move."""

import bz2
from collections.abc import Iterable
from io import BytesIO
from itertools import islice
from pathlib import Path

from palpate.errors import FileError
from palpate.limits import BAG, CHUNK

PART = 2**18
"""[bytes] that are unpacked at once."""
WINDOW = 2**27
"""[bytes] The most memory that Zstandard may use, whatever it says that it needs."""


def unpacked(compression: str, data: bytes) -> bytes:
    """What a chunk, or a message, holds, as far as its bytes go.

    Raises FileError where it is more than `limits.CHUNK`, and what its library raises on damaged bytes.
    """
    most = CHUNK.value + 1
    if compression == "zstd":
        import zstandard

        reader = zstandard.ZstdDecompressor(max_window_size=WINDOW).stream_reader(BytesIO(data))
        # In parts, for it takes the memory that is asked for at once.
        plain = b"".join(islice(iter(lambda: reader.read(PART), b""), most // PART + 1))
    elif compression == "lz4":
        import lz4.frame

        plain = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most)
    elif compression == "bz2":
        plain = bz2.BZ2Decompressor().decompress(data, max_length=most)
    else:
        plain = data
    CHUNK.check(len(plain), "holds a chunk")
    return plain


def check_unpacked(files: Iterable[Path]) -> None:
    """FileError where files packed by Zstandard hold more than `limits.BAG`, all together, or are damaged."""
    import zstandard

    size = 0
    for path in files:
        try:
            with path.open("rb") as file:
                reader = zstandard.ZstdDecompressor(max_window_size=WINDOW).stream_reader(file, read_across_frames=True)
                while part := reader.read(PART):
                    size += len(part)
                    BAG.check(size, f"{path}: holds messages")
        except (OSError, zstandard.ZstdError) as error:
            raise FileError(f"{path}: is truncated or damaged ({error})") from error
