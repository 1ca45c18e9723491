"""Files that are written whole or not at all, and reading of text files with one sentence on damage."""

import csv
import gzip
import json
import math
import os
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.errors import FileError, PalpateError

if TYPE_CHECKING:
    from numpy.typing import NDArray


def existing_file(path: Path | str) -> Path:
    """Return the path of a file that can be read and is not empty. Raises FileError."""
    path = Path(path)
    try:
        if path.is_dir():
            raise FileError(f"{path}: is a folder, expected a file")
        if not path.exists():
            raise FileError(f"{path}: no such file")
        if not path.is_file():
            raise FileError(f"{path}: is a pipe or a device, expected a file")
        if path.stat().st_size == 0:
            raise FileError(f"{path}: is empty")
        with path.open("rb") as file:
            first = file.read(23)
        if first == b"version https://git-lfs":
            raise FileError(f"{path}: is a Git LFS pointer in place of the file; `git lfs pull` gets the file")
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from error
    return path


def new_file(path: Path | str, overwrite: bool = False) -> Path:
    """Return the path if a file may be written there. Raises FileError, also if one exists unless `overwrite`."""
    path = Path(path)
    if path.is_dir():
        raise FileError(f"{path}: is a folder, expected the name of a file to write")
    if not path.parent.is_dir():
        raise FileError(f"{path}: the folder {path.parent} does not exist")
    if path.exists() and not overwrite:
        raise FileError(f"{path}: already exists; --force replaces it, in Python overwrite=True")
    return path


@contextmanager
def whole_file(path: Path | str, overwrite: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path` to write to; it becomes `path` on success and is removed on any failure."""
    path = new_file(path, overwrite)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({error})") from error
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def in_file(path: Path | str) -> Iterator[None]:
    """Name a file, or a part of one, in errors of the block, unless they begin with it; all become FileErrors."""
    try:
        yield
    except PalpateError as error:
        words = str(error).removeprefix(f"{path}: ").split()  # what a file holds may have line breaks
        raise FileError(f"{path}: {' '.join(words)}") from error


def begins_with(path: Path, first: bytes) -> bool:
    """Return true if there is a file at the path, no pipe, and it begins with these bytes."""
    with suppress(OSError):
        if path.is_file():  # a pipe would be waited for, and lose what is read
            with path.open("rb") as file:
                return file.read(len(first)) == first
    return False


def unpacked(path: Path, most: int = -1) -> bytes:
    """Return the first bytes of a file, plain or gzipped; all by default."""
    with gzip.open(path) if begins_with(path, b"\x1f\x8b") else path.open("rb") as file:
        return file.read(most)


def read_text(path: Path | str, most: int = 100_000_000) -> str:
    """Return the text of a UTF-8 or UTF-16 file, plain or gzipped. Raises FileError, also above `most` bytes."""
    path = existing_file(path)
    try:
        data = unpacked(path, most + 1)
        is_utf16 = data[:2] in (b"\xff\xfe", b"\xfe\xff")
        text = data.decode("utf-16" if is_utf16 else "utf-8-sig")  # both drop the byte order mark
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise FileError(f"{path}: is truncated or damaged ({error})") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: is not a text file in UTF-8 or UTF-16") from error
    if len(data) > most:
        raise FileError(f"{path}: is a text of more than {most / 1e6:g} MB")
    if "\0" in text:
        raise FileError(f"{path}: is not a text file in UTF-8, nor in UTF-16 with a byte order mark")
    return text


def text_start(path: Path) -> str:
    """Return the first 4096 bytes of a text file, gzipped or plain; "" if it cannot be read."""
    try:
        return unpacked(path, 4096).decode("utf-8-sig", errors="replace")
    except (OSError, EOFError, zlib.error):
        return ""


def counting_order(path: Path | str) -> list[int | str]:
    """Return a key that sorts names as people count: frame_2 before frame_10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", str(path))]


def numbers_of(words: Iterable[str]) -> list[float] | None:
    """Return words as numbers; None if any is not a finite number."""
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return None
    return numbers if all(map(math.isfinite, numbers)) else None


def table_rows(text: str, path: Path | str, sample: str = "") -> list[tuple[int, list[str]]]:
    """Return the rows of a table that are not blank, each with its line; errors name `path`. Raises FileError.

    Columns are separated by semicolons, tabs, commas or blanks, as the text or a sample of it shows. Numbers may have
    decimal commas; in a table whose columns are separated by commas, only in quotes.
    """
    lines = [line.strip(" ") for line in text.splitlines(keepends=True)]
    separator = next((mark for mark in ";\t," if mark in (sample or text)), " ")
    if separator == "," and not sample and all(_DECIMAL_COMMAS.fullmatch(line) for line in lines):
        separator = " "
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    rows: list[tuple[int, list[str]]] = []
    try:
        for row in reader:
            if any(map(str.strip, row)):
                rows.append((reader.line_num, [_with_decimal_point(cell.strip()) for cell in row]))
    except csv.Error as error:
        raise FileError(f"{path}: is no table ({error})") from error
    return rows


_DECIMAL_COMMAS = re.compile(r"[^,]*|\S*\d(\s+\S*\d)+\s*")
"""A line in which commas, if any, are decimal, as it has several numbers that blanks separate."""


def _with_decimal_point(cell: str) -> str:
    """Return a cell; if it is a number with a decimal comma, with a point."""
    return re.sub(r"^([-+]?\d*),(\d+([eE][-+]?\d+)?)$", r"\1.\2", cell)


def column_name(written: str) -> str:
    """Return a column's name in lower case, with underscores for blanks and brackets: angle_deg for Angle (deg).

    Signs are spelt: that of a degree as deg, and µ as u.
    """
    spelt = written.lower().replace("\N{GREEK SMALL LETTER MU}", "u").replace("\N{MICRO SIGN}", "u")
    spelt = re.sub("[\N{DEGREE SIGN}\N{MASCULINE ORDINAL INDICATOR}]", " deg ", spelt)
    return re.sub(r"[^a-z0-9]+", "_", spelt).strip("_")


def read_table(path: Path | str, needed: Sequence[str], optional: Sequence[str] = ()) -> list[tuple[int, list[str]]]:
    """Return these columns of a table, row by row with its line; cells of optional columns that are absent are "".

    Lines that begin with # are remarks, but for one that names the columns. Raises FileError if a needed column is
    missing, or if there is no optional column but an unknown one, which may be an optional one by another name.
    """
    text = re.sub(r"\Asep=.", "", read_text(path))  # as Excel writes
    text = "\n".join("" if _is_remark(line, needed) else line for line in text.splitlines())
    first_line = text.strip().partition("\n")[0]
    (_, header), *rows = table_rows(text, path, first_line) or [(1, [])]
    names = [column_name(cell) for cell in header]
    wanted = [*needed, *optional]
    has_others = not set(names) <= set(wanted)
    may_mean_optional = has_others and bool(optional) and set(names).isdisjoint(optional)
    if may_mean_optional or not set(needed) <= set(names) or len(set(names)) < len(names):
        expected = ", ".join(needed)
        if optional:
            expected += f" and {' or '.join(optional)}, which may be missing"
        raise FileError(f"{path}: found the columns {', '.join(header) or 'of no table'}; expected {expected}")
    for line, row in rows:
        if len(row) != len(header):
            raise FileError(
                f"{path}: line {line}: found {','.join(row)[:80]!r}, expected {len(header)} columns: "
                f"{', '.join(header)}"
            )
    columns = [names.index(name) if name in names else None for name in wanted]
    return [(line, ["" if column is None else row[column] for column in columns]) for line, row in rows]


def _is_remark(line: str, needed: Sequence[str]) -> bool:
    """Return true for a line that begins with # and does not name the needed columns."""
    names = {column_name(cell) for cell in re.split("[;,\t]", line)}
    return line.lstrip().startswith("#") and not set(needed) <= names


def json_object(text: str | bytes, name: str) -> dict[str, Any]:
    """Return the JSON object in a text, which errors call `name`. Raises FileError."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{name}: is not valid JSON ({error})") from error
    if not isinstance(value, dict):
        raise FileError(f"{name}: found a JSON {type(value).__name__}, expected an object")
    return value


def read_json(path: Path | str) -> dict[str, Any]:
    """Return the JSON object of a file. Raises FileError."""
    return json_object(read_text(path), str(path))


def write_json(path: Path | str, content: Any, overwrite: bool = True) -> None:
    """Write a JSON file, whole or not at all. Raises FileError if it exists and `overwrite` is not set."""
    with whole_file(path, overwrite) as part:
        part.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read_arrays(path: Path | str) -> "dict[str, NDArray[Any]]":
    """Return the arrays of a NumPy archive (.npz) by name. Raises FileError."""
    import numpy as np

    path = existing_file(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except Exception as error:  # damaged bytes can raise anything in NumPy
        raise FileError(f"{path}: is no .npz, or is truncated or damaged") from error
