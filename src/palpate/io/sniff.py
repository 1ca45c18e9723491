"""Telling what a text file is from its first characters, without reading it."""

import gzip
import zlib
from pathlib import Path

START = 4096

NUMBER = r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?"
"""A decimal number, as a regular expression that has one way only to match it: the time is linear."""


def text_start(path: Path) -> str:
    """Up to 4096 characters from the start of a text file, gzipped or plain; "" if it is anything else."""
    try:
        with Path(path).open("rb") as file:
            gzipped = file.read(2) == b"\x1f\x8b"
        with gzip.open(path) if gzipped else Path(path).open("rb") as file:
            data = file.read(START)
    except (OSError, EOFError, zlib.error):
        return ""
    if b"\x00" in data:
        return ""
    # The cut may go through a character: what is left of it does not matter.
    text = data.decode("utf-8", errors="replace")
    return "" if "\ufffd" in text[:-4] else text
