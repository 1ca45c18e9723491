"""Reading HDF5 from anywhere: in a process of its own, which a damaged file may crash or hold up.

That process starts with the first file, which takes some tenths of a second, and serves all that follow. It opens
nothing but the file, and reads no more than the limits allow.
"""

import atexit
import json
import math
import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock, Timer
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.limits import ARRAYS, SECONDS

SIGNATURE = b"\x89HDF\r\n\x1a\n"


@dataclass(frozen=True)
class Contents:
    """What an HDF5 file holds: the datasets in it and in its groups."""

    attributes: dict[str, Any]
    """Words and numbers that are attached to the file."""
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    """Datasets of numbers by name, those in a group with the group's name before a slash."""
    rows: dict[str, tuple[bytes, ...]] = field(default_factory=dict)
    """Datasets of rows of bytes by name."""
    attached: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Attributes of each dataset."""


def read_hdf5(source: Path | bytes) -> Contents:
    """What a file or its bytes hold. Raises FileError, without the name of the file, where it cannot be read."""
    with _lock:
        child = _running()
        waiting = Timer(SECONDS.value, child.kill)
        waiting.start()
        try:
            return _asked(child, source)
        except FileError:
            raise
        except (OSError, EOFError, ValueError) as error:
            _stop()
            why = f"took longer than {SECONDS.value} s, {SECONDS.words}" if waiting.finished.is_set() else "crashed"
            raise FileError(f"is truncated or damaged (the HDF5 library {why})") from error
        except BaseException:
            _stop()  # an answer that nobody has read to its end would be taken for the next one
            raise
        finally:
            waiting.cancel()


def _asked(child: "subprocess.Popen[bytes]", source: Path | bytes) -> Contents:
    assert child.stdin and child.stdout
    data = source if isinstance(source, bytes) else b""
    path = None if isinstance(source, bytes) else os.fspath(source.resolve())
    question = {"path": path, "bytes": len(data), "most": ARRAYS.value, "words": ARRAYS.words}
    child.stdin.write(json.dumps(question).encode() + b"\n" + data)
    child.stdin.flush()
    line = child.stdout.readline()
    if not line.endswith(b"\n"):
        raise EOFError("no answer")
    said = json.loads(line)
    if "error" in said:
        raise FileError(said["error"])
    found = Contents(said["attributes"])
    for name, array in said["arrays"].items():
        found.attached[name] = array["attributes"]
        if "lengths" in array:
            found.rows[name] = tuple(_exactly(child, length) for length in array["lengths"])
        else:
            kind = np.dtype(array["type"])
            data = _exactly(child, math.prod(array["shape"]) * kind.itemsize)
            found.arrays[name] = np.frombuffer(data, kind).reshape(array["shape"]).copy()
    return found


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
        command = [sys.executable, "-c", "from palpate.formats.hdf5_child import serve; serve()"]
        pipe = subprocess.PIPE
        child = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL)
        _children[os.getpid()] = child
    return child


@atexit.register
def _stop() -> None:
    """End the process that reads, if there is one."""
    child = _children.pop(os.getpid(), None)
    if child is not None:
        child.kill()
        with suppress(BrokenPipeError), child:  # what it has not taken
            pass
