"""The start of a text file, by which formats are recognised."""

import gzip
import zlib
from pathlib import Path

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
"""A decimal number, as a regular expression that matches in linear time."""


def text_start(path: Path, length: int = 4096) -> str:
    """Return the start of a text file, gzipped or plain; "" if it is anything else."""
    try:
        with Path(path).open("rb") as file:
            is_gzipped = file.read(2) == b"\x1f\x8b"
        with gzip.open(path) if is_gzipped else Path(path).open("rb") as file:
            data = file.read(length)
    except (OSError, EOFError, zlib.error):
        return ""
    # The cut may go through a character: its rest does not matter.
    text = data.decode("utf-8", errors="replace")
    return "" if "\x00" in text or "\ufffd" in text[:-4] else text
