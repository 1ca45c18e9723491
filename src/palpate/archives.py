"""Reading arrays from an `.npz` file: nothing in it is believed before it is checked, and no code is run."""

import math
import re
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import existing_file
from palpate.limits import ARRAYS
from palpate.printable import one_line

HEADER = re.compile(
    r"\{'descr': '([<>|][biufSU]\d{1,9})', 'fortran_order': (True|False), 'shape': \(([\d, ]{0,200})\), \}\s*"
)
"""What NumPy writes before an array of plain numbers or characters. Its own reader parses it as Python."""


def read_arrays(path: Path | str) -> dict[str, NDArray[Any]]:
    """The arrays of an `.npz` file by name. Raises FileError where it is none, is damaged or is too large."""
    path = existing_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            ARRAYS.check(sum(member.file_size for member in members), "holds arrays")
            return {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}
    except FileError as error:
        raise FileError(f"{path}: {error}") from error
    # What damaged bytes lead to in zipfile, zlib and NumPy.
    except (OSError, EOFError, ValueError, TypeError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise FileError(f"{path}: is no .npz, or is truncated or damaged ({one_line(error)})") from error


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):  # others unpack without bounds
        raise ValueError(f"{member.filename} is packed as no .npz is")
    with archive.open(member) as file:
        header = HEADER.fullmatch(_header(file))
        if header is None:
            raise ValueError(f"{member.filename} is no array of numbers")
        kind = np.dtype(header[1])
        shape = tuple(int(length) for length in header[3].split(",") if length.strip())
        data = file.read()
    if len(data) != math.prod(shape) * kind.itemsize:
        raise ValueError(f"{member.filename} has {len(data)} bytes for {kind} of shape {shape}")
    return np.frombuffer(data, kind).reshape(shape, order="F" if header[2] == "True" else "C")


def _header(file: IO[bytes]) -> str:
    """The text before the numbers of an array in NumPy's format; see `numpy.lib.format`."""
    start = file.read(8)
    if start[:6] != b"\x93NUMPY":
        raise ValueError("a part is no array")
    return file.read(int.from_bytes(file.read(2 if start[6:7] == b"\x01" else 4), "little")).decode("latin-1")
