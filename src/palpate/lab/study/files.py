"""The recordings of a folder: which files are some, and what each is one of."""

import re
from pathlib import Path, PurePosixPath

from palpate.errors import FileError
from palpate.files import read_json
from palpate.io import detect_format, own_format

ALWAYS, JSON, TEXT = (".mcap",), (".json", ".json.gz"), (".txt",)
"""Endings of recordings. HDF5 files are always taken for one; of the others, those that look like one, and JSON that is
too damaged to tell. Other endings are left to readers of users' own."""
TRAJECTORIES = ("tum", "estimates-csv")
"""Formats without sensor poses."""


def find_recordings(folder: Path, leave_out: Path | None = None) -> dict[str, Path]:
    """Return the recordings in a folder and the folders in it, by their path as seen from it, sorted.

    `leave_out` is a folder that is not looked into; hidden files are not looked at either. Raises FileError where there
    is no such folder, or none in it.
    """
    if not folder.is_dir():
        raise FileError(f"{folder}: no such folder of recordings")
    left_out = None if leave_out is None else leave_out.resolve()
    found: dict[str, Path] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        hidden = any(part.startswith(".") for part in name.parts)
        if hidden or (left_out is not None and path.resolve().is_relative_to(left_out)):
            continue
        if path.is_file() and _is_recording(path):
            found[name.as_posix()] = path
    if not found:
        raise FileError(
            f"{folder}: holds no recordings, nor do folders in it; see palpate info for the formats it may be"
        )
    return found


def group_of(name: str) -> str:
    """Return the folder that a recording lies in or, right in the folder of the study, its name without the number."""
    path = PurePosixPath(name)
    if len(path.parts) > 1:
        return path.parent.as_posix()
    ending = next((end for end in (*ALWAYS, *JSON, *TEXT) if path.name.lower().endswith(end)), path.suffix)
    stem = path.name[: len(path.name) - len(ending)]
    return re.sub(r"[\W\d_]+$", "", stem) or stem


def _is_recording(path: Path) -> bool:
    name = path.name.lower()
    if name.endswith(ALWAYS):
        return True
    if not name.endswith(JSON + TEXT):
        return own_format(path) is not None
    try:
        format = detect_format(path)
        if format is None and name.endswith(JSON):
            read_json(path)
    except FileError:  # empty or damaged
        return name.endswith(JSON)
    return format is not None and format not in TRAJECTORIES
