"""Reading HDF5 from anywhere: in a process of its own, which a damaged file may crash or hold up.

That process starts with the first file, which takes some tenths of a second, and serves all that follow. It opens
nothing but the file, and reads no more than the limits allow.
"""

import atexit
import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock, Timer
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.limits import ARRAYS, AT_ONCE, SECONDS
from palpate.types.stored_images import StoredImages

SIGNATURE = b"\x89HDF\r\n\x1a\n"
PATIENCE = 10
"""How many times the seconds that the library may compute it may take, on a disk that is slow or a busy machine."""
T = TypeVar("T")


@dataclass(frozen=True)
class Contents:
    """What an HDF5 file holds: the datasets in it and in its groups."""

    attributes: dict[str, Any]
    """Words and numbers that are attached to the file."""
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    """Datasets of numbers by name, those in a group with the group's name before a slash."""
    rows: dict[str, Sequence[bytes]] = field(default_factory=dict)
    """Datasets of rows of bytes by name; those of a file are read when they are asked for."""
    attached: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Attributes of each dataset."""


class Rows(StoredImages):
    """Rows of bytes in a file, such as images, read some at a time when they are asked for."""

    def __init__(self, path: Path, name: str, count: int) -> None:
        """Take the file, the name of the dataset in it and how many rows it has."""
        self._given = path.absolute(), name, count
        self._batch: tuple[int, tuple[bytes, ...]] = (-1, ())

    def __len__(self) -> int:
        return self._given[2]

    def read(self, index: int) -> bytes:
        """One row. Raises FileError, with the name of the file, where it is damaged there."""
        number, rows = self._batch
        if index // AT_ONCE != number:
            number = index // AT_ONCE
            try:
                rows = self._read(number * AT_ONCE, min((number + 1) * AT_ONCE, len(self)))
            except FileError:  # one of them is damaged; others are not
                return self._read(index, index + 1)[0]
            self._batch = number, rows
        return rows[index % AT_ONCE]

    def _read(self, start: int, stop: int) -> tuple[bytes, ...]:
        path, name, _ = self._given
        try:
            return _by_child(lambda child: _rows(child, path, name, start, stop))
        except FileError as error:
            raise FileError(f"{path}: {name} of frame {start}: {error}") from error

    def __reduce__(self) -> tuple[Any, ...]:
        return Rows, self._given


def read_hdf5(source: Path | bytes) -> Contents:
    """What a file or its bytes hold. Raises FileError, without the name of the file, where it cannot be read."""
    return _by_child(lambda child: _contents(child, source))


def _by_child(work: Callable[["subprocess.Popen[bytes]"], T]) -> T:
    """What the process that reads is asked for by `work`, which another does not interrupt."""
    with _lock:
        child = _running()
        waiting = Timer(PATIENCE * SECONDS.value, child.kill)
        waiting.start()
        try:
            return work(child)
        except FileError:
            raise
        except (OSError, EOFError, ValueError) as error:
            _stop()
            out_of_time = getattr(signal, "SIGXCPU", None)  # which Unix alone has
            too_long = waiting.finished.is_set() or -child.returncode == out_of_time
            why = f"took longer than {SECONDS.value} s, {SECONDS.words}" if too_long else "crashed"
            raise FileError(f"is truncated or damaged (the HDF5 library {why})") from error
        except BaseException:
            _stop()  # an answer that nobody has read to its end would be taken for the next one
            raise
        finally:
            waiting.cancel()


def _contents(child: "subprocess.Popen[bytes]", source: Path | bytes) -> Contents:
    said = _asked(child, source)
    found = Contents(said["attributes"])
    for name, array in said["arrays"].items():
        found.attached[name] = array["attributes"]
        if "lengths" in array:
            found.rows[name] = tuple(_exactly(child, length) for length in array["lengths"])
        elif "count" in array:
            assert isinstance(source, Path)
            found.rows[name] = Rows(source, name, array["count"])
        else:
            kind = np.dtype(array["type"])
            data = _exactly(child, math.prod(array["shape"]) * kind.itemsize)
            found.arrays[name] = np.frombuffer(data, kind).reshape(array["shape"]).copy()
    return found


def _rows(child: "subprocess.Popen[bytes]", path: Path, name: str, start: int, stop: int) -> tuple[bytes, ...]:
    said = _asked(child, path, {"name": name, "start": start, "stop": stop})
    return tuple(_exactly(child, length) for length in said["lengths"])


def _asked(child: "subprocess.Popen[bytes]", source: Path | bytes, rows: dict[str, Any] | None = None) -> Any:
    """The line that the process answers with."""
    assert child.stdin and child.stdout
    data = source if isinstance(source, bytes) else b""
    path = None if isinstance(source, bytes) else os.fspath(source.resolve())
    question = {"path": path, "bytes": len(data), "most": ARRAYS.value, "words": ARRAYS.words, "seconds": SECONDS.value}
    question["rows"] = rows
    child.stdin.write(json.dumps(question).encode() + b"\n" + data)
    child.stdin.flush()
    line = child.stdout.readline()
    if not line.endswith(b"\n"):
        raise EOFError("no answer")
    said = json.loads(line)
    if "error" in said:
        raise FileError(said["error"])
    return said


def _exactly(child: "subprocess.Popen[bytes]", size: int) -> bytes:
    assert child.stdout
    data = child.stdout.read(size)
    if len(data) < size:
        raise EOFError("half an answer")
    return data


_lock = Lock()
_children: dict[int, "subprocess.Popen[bytes]"] = {}
"""The process that reads for each process, by the latter's id: one that was forked starts one of its own."""


def _running() -> "subprocess.Popen[bytes]":
    child = _children.get(os.getpid())
    if child is None or child.poll() is not None:
        _stop()
        command = [sys.executable, "-c", "from palpate.io.hdf5_child import serve; serve()"]
        pipe = subprocess.PIPE
        child = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL)
        _children[os.getpid()] = child
        assert child.stdout
        child.stdout.readline()  # it is there; from now on the time counts
    return child


@atexit.register
def _stop() -> None:
    """End the process that reads, if there is one."""
    child = _children.pop(os.getpid(), None)
    if child is not None:
        child.kill()
        with suppress(BrokenPipeError), child:  # what it has not taken
            pass
