"""The recordings of a folder, and the group that each belongs to."""

import re
from pathlib import Path, PurePosixPath

from palpate.errors import FileError
from palpate.io import detect_format


def find_recordings(folder: Path, leave_out: Path | None = None) -> dict[str, Path]:
    """Return the recordings in a folder and its subfolders, sorted, by their paths relative to the folder.

    Hidden files are skipped, and so is all in the folder `leave_out`. Raises FileError if there is no recording.
    """
    if not folder.is_dir():
        raise FileError(f"{folder}: no such folder of recordings")
    recordings = {
        path.relative_to(folder).as_posix(): path
        for path in sorted(folder.rglob("*"))
        if path.is_file()
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
        and not (leave_out and path.resolve().is_relative_to(leave_out.resolve()))
        and _is_recording(path)
    }
    if not recordings:
        raise FileError(f"{folder}: holds no recordings, nor do its subfolders; palpate info names the formats")
    return recordings


def group_of(name: str) -> str:
    """Return the folder of a recording or, if it lies in the study's folder itself, its name without the number."""
    path = PurePosixPath(name)
    if len(path.parts) > 1:
        return path.parent.as_posix()
    stem = path.name.removesuffix(".gz").rpartition(".")[0] or path.name
    return re.sub(r"[\W\d_]+$", "", stem) or stem


def _is_recording(path: Path) -> bool:
    try:
        return detect_format(path) is not None or path.name.lower().endswith(".mcap")
    except FileError:  # empty or damaged
        return path.name.lower().endswith((".mcap", ".json", ".json.gz"))
