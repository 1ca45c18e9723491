"""What reads HDF5 in a process of its own, for `hdf5.read_hdf5`; nothing else is to run it.

The HDF5 library can be crashed by a few changed bytes. Here it takes no other process along.

Says that it is ready. Asked by a line of JSON on standard input, {"path": ..., "bytes": N, "most": M, "words": ...,
"seconds": S, "rows": null}: a file, or N bytes that follow if there is no path, how many bytes its arrays may have,
what to say of that, and how long it may compute. Answers with a line, {"error": ...} or {"attributes": {...}, "arrays":
{...}}, followed by the bytes of the arrays one after the other. See `hdf5.Contents` for what they are. Of rows of bytes
in a file only their count is told; asked with "rows": {"name": ..., "start": ..., "stop": ...}, it answers {"lengths":
[...]} and the bytes of these.
"""

import io
import json
import math
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from palpate.limits import AT_ONCE

HEADROOM = 300 * 10**6
"""[bytes] of memory that the library may take besides what it reads."""
PARTS = 1000
"""Attributes, datasets and groups in a file."""


class Refused(Exception):
    """What a file is not read for; the message is for the user."""


def serve() -> None:
    """Answer until there is nothing more to answer."""
    asked, answer = sys.stdin.buffer, sys.stdout.buffer
    answer.write(b"ready\n")
    answer.flush()
    while line := asked.readline():
        question = json.loads(line)
        source: Any = question["path"] or io.BytesIO(asked.read(question["bytes"]))
        size = Path(source).stat().st_size if question["path"] else question["bytes"]
        _bound(2 * size + question["most"] + HEADROOM, question["seconds"])
        said, buffers = _answer(source, size, question)
        answer.write(json.dumps(said).encode() + b"\n")
        for buffer in buffers:
            answer.write(buffer)
        answer.flush()


def _answer(source: Any, size: int, question: dict[str, Any]) -> tuple[dict[str, Any], list[bytes]]:
    try:
        with h5py.File(source, "r") as file:
            if wanted := question["rows"]:
                dataset = dict(_datasets(file, ""))[wanted["name"]]
                rows = _rows(wanted["name"], dataset, size, range(wanted["start"], wanted["stop"]))
                return {"lengths": [len(row) for row in rows]}, rows
            return _everything(file, size, question)
    except Refused as error:
        return {"error": str(error)}, []
    except Exception as error:  # damaged bytes can make anything of what the library reads
        return {"error": f"is truncated or damaged ({' '.join(str(error).split())[:300]})"}, []


def _everything(file: Any, size: int, question: dict[str, Any]) -> tuple[dict[str, Any], list[bytes]]:
    arrays: dict[str, Any] = {}
    buffers: list[bytes] = []
    most = question["most"]
    for name, dataset in _datasets(file, ""):
        if h5py.check_vlen_dtype(dataset.dtype) == np.uint8 and dataset.ndim == 1:
            array = {"count": _count(name, dataset, size, most)}
            if not question["path"]:
                data = _rows(name, dataset, size, range(len(dataset)))
                array = {"lengths": [len(row) for row in data]}
                buffers += data
        else:
            array, data = _numbers(name, dataset, most, question["words"])
            most -= len(data)
            buffers.append(data)
        arrays[name] = array | {"attributes": _attributes(dataset)}
    return {"attributes": _attributes(file), "arrays": arrays}, buffers


def _datasets(group: Any, within: str) -> list[tuple[str, Any]]:
    """The datasets of a group and of the groups in it, by name. Nothing leads out of the file."""
    found: list[tuple[str, Any]] = []
    if len(group) > PARTS:
        raise Refused(f"{within or 'the file'}: has {len(group)} parts, allowed are {PARTS}")
    for name in group:
        place = f"{within}{name}"
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise Refused(f"{place}: is a link, which could lead out of the file; links are not followed")
        item = group[name]
        if isinstance(item, h5py.Group) and not within:
            found += _datasets(item, f"{place}/")
        elif not isinstance(item, h5py.Dataset):
            raise Refused(f"{place}: is neither a dataset nor a group of datasets")
        elif item.is_virtual or item.external:
            raise Refused(f"{place}: keeps its values in another file, which is not opened")
        else:
            found.append((place, item))
    return found


def _numbers(name: str, dataset: Any, most: int, words: str) -> tuple[dict[str, Any], bytes]:
    if dataset.dtype.kind not in "biuf":
        raise Refused(f"{name}: found values of type {dataset.dtype}, expected numbers or booleans")
    if dataset.nbytes > most:
        raise Refused(f"{name}: holds {dataset.nbytes / 1e6:.1f} MB; for all arrays {words}")
    values = dataset[()]
    return {"type": values.dtype.str, "shape": values.shape}, np.ascontiguousarray(values).tobytes()


def _count(name: str, dataset: Any, size: int, most: int) -> int:
    if 16 * len(dataset) > min(size, most):
        raise Refused(f"{name}: says that it has {len(dataset)} rows, more than a file of {size} bytes can hold")
    return len(dataset)


def _rows(name: str, dataset: Any, size: int, wanted: range) -> list[bytes]:
    """Rows of bytes, such as images; they are not packed, so all together are no larger than the file."""
    rows: list[bytes] = []
    left = size
    for start in range(wanted.start, wanted.stop, AT_ONCE):
        for row in dataset[start : min(start + AT_ONCE, wanted.stop)]:
            rows.append(np.asarray(row, np.uint8).tobytes())
            left -= len(rows[-1])
        if left < 0:
            raise Refused(f"{name}: says that its rows are longer than the file")
    return rows


def _attributes(node: Any) -> dict[str, Any]:
    """Words and numbers that are attached to a part of the file; anything else is told by its type."""
    if len(node.attrs) > PARTS:
        raise Refused(f"has {len(node.attrs)} attributes, allowed are {PARTS}")
    found: dict[str, Any] = {}
    for name in node.attrs:
        value = node.attrs[name]
        if isinstance(value, np.generic):
            value = value.item()
        found[name] = value if isinstance(value, str | int | float) else str(type(value))
    return found


def _bound(memory: int, seconds: int) -> None:
    """Let this process take so many bytes, and compute so many seconds, more than it has, where the system can tell."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + memory
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))
        until = math.ceil(time.process_time()) + seconds
        resource.setrlimit(resource.RLIMIT_CPU, (until, resource.getrlimit(resource.RLIMIT_CPU)[1]))
