"""Unpacking what a bag keeps packed, within bounds that no header of it can move."""

import bz2
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
def unpacked_files(files: list[Path]) -> Iterator[list[Path]]:
    """Files packed by Zstandard as plain ones in a temporary folder, their names without the last suffix.

    Raises FileError where they hold more than `limits.BAG`, all together, or are damaged.
    """
    import zstandard

    size = 0
    with tempfile.TemporaryDirectory() as folder:
        plain = [Path(folder) / path.stem for path in files]
        for path, copy in zip(files, plain, strict=True):
            decompressor = zstandard.ZstdDecompressor(max_window_size=WINDOW)
            try:
                with path.open("rb") as file, copy.open("wb") as whole:
                    reader = decompressor.stream_reader(file, read_across_frames=True)
                    while part := reader.read(PART):
                        size += len(part)
                        BAG.check(size, f"{path}: holds messages")
                        whole.write(part)
            except (OSError, zstandard.ZstdError) as error:
                raise FileError(f"{path}: is truncated or damaged ({error})") from error
        yield plain
