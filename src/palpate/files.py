"""What readers and writers share: files that exist, files written whole, and checks of fields."""

import csv
import io
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.limits import FARTHEST, LONGEST, TEXT
from palpate.locks import held, part_of, remove_empty

# The kinds of NumPy types a field may come in, and what to call them in an error.
NUMBERS = ("fiu", "numbers")
INTEGERS = ("iu", "integers")
FLAGS = ("b", "booleans")


def existing_file(path: Path | str) -> Path:
    """`path`, if a file with content is there; FileError if not."""
    path = Path(path)
    try:
        if path.is_dir():
            raise FileError(f"{path}: is a folder, expected a file")
        if not path.exists():
            raise FileError(f"{path}: no such file")
        if path.stat().st_size == 0:
            raise FileError(f"{path}: is empty")
        with path.open("rb"):
            return path
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from error


def new_file(path: Path | str, overwrite: bool = False) -> Path:
    """`path`, if a file may be written there; FileError if not, as where one exists and `overwrite` is not set."""
    path = Path(path)
    if path.is_dir():
        raise FileError(f"{path}: is a folder, expected the name of a file to write")
    if not path.parent.is_dir():
        raise FileError(f"{path}: the folder {path.parent} does not exist")
    if path.exists() and not overwrite:
        raise FileError(f"{path}: already exists; overwrite=True replaces it")
    return path


@contextmanager
def whole_file(path: Path | str, overwrite: bool = False) -> Iterator[Path]:
    """A temporary path beside `path` to write to; renamed to `path` on success, removed on any failure.

    An existing file is replaced only if `overwrite`; a missing folder is an error, and so is another process that
    writes the same file.
    """
    path = new_file(path, overwrite)
    part = part_of(path)
    with held(part, path):
        try:
            yield part
            part.replace(path)
        except BaseException as error:
            part.unlink(missing_ok=True)
            if isinstance(error, OSError):
                raise FileError(f"{path}: cannot be written ({error})") from error
            raise


@contextmanager
def whole_folder(folder: Path, keep: str = "") -> Iterator[Path]:
    """A temporary folder beside `folder` to write to; takes its place on success, is removed on any failure.

    What stands at `folder` is replaced, so ask first, inside the block. Raises FileError, before the block, where
    another process writes the same folder. A file named `keep` beside the temporary folder is left where a process was
    killed or failed, and found by the next that says so.
    """
    if not folder.name:
        raise FileError(f"{folder}: is not the name of a new folder")
    part = part_of(folder)
    made = [each for each in folder.parents if not each.exists()]
    new, old = part / "new", part / "old"
    with held(part, folder, folder=True):
        try:
            if old.exists() and not folder.exists():  # a process was killed just before its last move below
                new.rename(folder)
            _clear(part, keep)
            new.mkdir()
            yield new
            if folder.exists():
                folder.rename(old)
            new.rename(folder)
            keep = ""
        except OSError as error:
            raise FileError(f"{folder}: cannot be written ({error})") from error
        finally:
            if old.exists() and not folder.exists():
                old.rename(folder)
            _clear(part, keep)
            remove_empty([part, *made])


def remove_left_of(folder: Path) -> None:
    """Remove what a killed process left beside a folder that is whole; FileError where another process writes it."""
    part = part_of(folder)
    if part.exists():
        with held(part, folder, folder=True):
            shutil.rmtree(part, ignore_errors=True)


def _clear(folder: Path, keep: str) -> None:
    """Remove all that is in a folder but the file named `keep`."""
    for left in folder.iterdir():
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        elif left.name != keep:
            left.unlink(missing_ok=True)


@contextmanager
def in_file(path: Path) -> Iterator[None]:
    """Name a file in the FileErrors of what was read from it, where they do not yet."""
    try:
        yield
    except FileError as error:
        raise FileError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error


def checked_array(name: str, value: Any, kind: tuple[str, str], shape: tuple[int | str, ...]) -> NDArray[Any]:
    """`value` as an array of the given kind and shape, "N" for any length; FileError if it is not."""
    kinds, words = kind
    if _holds_text(value):  # of which NumPy would make as many characters for each number as the longest text has
        raise FileError(f"{name}: found text, expected {words}")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise FileError(f"{name}: rows have different lengths, expected shape {_written(shape)}") from error
    fits = len(array.shape) == len(shape) and all(
        want in ("N", found) for found, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise FileError(f"{name}: found shape {_written(array.shape)}, expected {_written(shape)}")
    if array.dtype.kind not in kinds:
        raise FileError(f"{name}: found values of type {array.dtype}, expected {words}")
    return array


def check_rows(name: str, values: NDArray[Any], good: np.bool_ | NDArray[np.bool_], allowed: str) -> None:
    """FileError that names the first frame where `good` is false, what it holds and what is allowed."""
    if not np.all(good):
        index = int(np.argmin(good))
        raise FileError(f"{name}: frame {index} is {values[index].tolist()}, allowed is {allowed}")


def check_increasing(time: NDArray[np.float64]) -> None:
    """FileError unless times (N,) are finite and strictly increasing."""
    check_rows("time", time, np.isfinite(time), "a finite number")
    wrong = np.flatnonzero(np.diff(time) <= 0)
    if len(wrong):
        index = int(wrong[0]) + 1
        verb = "repeats" if time[index] == time[index - 1] else "runs backwards at"
        raise FileError(
            f"time: frame {index} {verb} {time[index]:.17g} s after {time[index - 1]:.17g} s, "
            "allowed are strictly increasing times"
        )
    # Not by a difference, which may be beyond all floating-point numbers.
    if len(time) and time[-1] > time[0] + LONGEST:
        raise FileError(f"time: runs from {time[0]:.17g} to {time[-1]:.17g} s, allowed are {LONGEST:g} s at most")


def is_near(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether each number is finite and such as a position or a length [m] can be."""
    return np.abs(values) <= FARTHEST


def read_text(path: Path | str) -> str:
    """The text of a UTF-8 file, or of a gzipped one; FileError if it is neither, or larger than `limits.TEXT`."""
    import gzip
    import zlib

    path = existing_file(path)
    most = TEXT.value
    try:
        with path.open("rb") as file:
            gzipped = file.read(2) == b"\x1f\x8b"
        with gzip.open(path) if gzipped else path.open("rb") as file:
            data = file.read(most + 1)
        text = data.decode("utf-8")
    except (OSError, EOFError, zlib.error) as error:
        raise FileError(f"{path}: is truncated or damaged ({error})") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: is not a text file") from error
    if len(data) > most:
        raise FileError(f"{path}: is a text of more than {most / TEXT.unit:g} MB, {TEXT.words}")
    return text


def read_csv(path: Path | str) -> list[list[str]]:
    """The rows of a CSV file, gzipped or plain; FileError if it is none."""
    return csv_rows(read_text(path), path)


def csv_rows(text: str, path: Path | str) -> list[list[str]]:
    """The rows of a CSV text; errors name `path`. Raises FileError."""
    try:
        return list(csv.reader(io.StringIO(text)))
    except csv.Error as error:
        raise FileError(f"{path}: is not a CSV table ({error})") from error


def read_json(path: Path | str) -> dict[str, Any]:
    """The JSON object of a file, gzipped or plain; FileError if it holds none."""
    return json_object(read_text(path), str(path))


def json_object(text: str | bytes, name: str) -> dict[str, Any]:
    """The JSON object that a text holds; errors name it `name`. Raises FileError if it holds none."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{name}: is not valid JSON ({error})") from error
    if not isinstance(value, dict):
        raise FileError(f"{name}: found a JSON {type(value).__name__}, expected an object")
    return value


def _holds_text(value: Any) -> bool:
    """Whether there is text among the values of a list, however deep."""
    values = [value]
    while values:
        each = values.pop()
        if isinstance(each, str | bytes):
            return True
        if isinstance(each, list | tuple):
            values.extend(each)
    return False


def _written(shape: tuple[int | str, ...]) -> str:
    return f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
