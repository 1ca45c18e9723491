"""Files of palpate and of others, one module a format, found by their content.

A format module has DESCRIPTION, detect(path) and read(path); write(data, path, overwrite) where files are
written, and lost(data) where a file cannot hold all. Each module documents the frames and units of its files. Readers
in other packages register an entry point of the group `palpate.io`, a module with the same names; they are asked last.
"""

from dataclasses import replace
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from palpate.errors import FileError, PalpateError, SettingError, one_line
from palpate.io.rosbag_reader import existing_bag
from palpate.types.estimate import Trajectory
from palpate.types.recording import Recording

MODULES = {
    "palpate": "recording_mcap",
    "estimates-mcap": "estimates_mcap",
    "mit-push": "mit_push",
    "cmu-two-finger": "cmu_two_finger",
    "theseus-json": "theseus_json",
    "tum": "tum",
    "estimates-csv": "estimates_csv",
    "bag": "rosbag_reader",
}
"""The module of each format, by its name; detection asks them in this order."""

EXTENSIONS = {".mcap": "palpate", ".tum": "tum", ".csv": "estimates-csv"}
"""The format that a file to be written gets, by its extension."""

HOLDS = {"palpate": Recording, "estimates-mcap": Trajectory, "estimates-csv": Trajectory}
"""The data that a format can hold, where it is not both."""

GROUP = "palpate.io"


def detect_format(path: Path | str) -> str | None:
    """Return the name of the file's format, or None if it is not known. Raises FileError if there is no file."""
    path = existing_bag(path)
    return next((name for name in MODULES if _module(name).detect(path)), None) or own_format(path)


def read(path: Path | str, format: str | None = None) -> Recording | Trajectory:
    """Read a file of any known format; `format` names it where the content does not tell. Raises FileError."""
    path = existing_bag(path)
    name = format or detect_format(path)
    if name is not None:
        return _read_own(name, path) if name in _own_readers() else _module(name).read(path)
    with path.open("rb") as file:
        if file.read(8) == b"\x89HDF\r\n\x1a\n":
            raise FileError(f"{path}: is HDF5; recordings are MCAP now: python scripts/convert_h5.py {path}")
    known = "; ".join([*(f"{name}: {_module(name).DESCRIPTION}" for name in MODULES), *_own_readers()])
    raise FileError(f"{path}: is in no known format; known are {known}")


def load_recording(path: Path | str) -> Recording:
    """Read a recording of any known format. Raises FileError also if the file holds a trajectory only."""
    data = read(path)
    if not isinstance(data, Recording):
        raise FileError(f"{path}: holds a trajectory, not a recording: there are no sensor poses in it")
    return data


def write(data: Recording | Trajectory, path: Path | str, format: str | None = None, overwrite: bool = False) -> None:
    """Write a file in the named format, or in that of its extension. Raises FileError and SettingError."""
    _writer(data, path, format).write(data, Path(path), overwrite)


def lost(data: Recording | Trajectory, path: Path | str, format: str | None = None) -> list[str]:
    """Return the names of what the format that `write` would take cannot hold; nothing for most."""
    module = _writer(data, path, format)
    return module.lost(data) if hasattr(module, "lost") else []


def own_format(path: Path) -> str | None:
    """Return the name of another package's reader that takes a file, None if none does. Raises FileError."""
    return next((name for name in _own_readers() if _ask(name, "detect", path)), None)


def _writer(data: Recording | Trajectory, path: Path | str, format: str | None) -> Any:
    path = Path(path)
    name = format or EXTENSIONS.get(path.suffix.lower())
    if name is None:
        allowed = ", ".join(EXTENSIONS)
        raise SettingError(f"{path}: extension {path.suffix!r} is of no format, allowed are {allowed}")
    if format is None and name == "palpate" and isinstance(data, Trajectory):
        name = "estimates-mcap"
    module = _module(name)
    if not hasattr(module, "write"):
        raise SettingError(f"{path}: {name} files can be read but not written")
    if not isinstance(data, holds := HOLDS.get(name, object)):
        kinds = (holds.__name__.lower(), type(data).__name__.lower())
        raise SettingError(f"{path}: a file of {name} holds a {kinds[0]}, not a {kinds[1]}")
    return module


def _module(name: str) -> Any:
    if name not in MODULES:
        raise SettingError(f"format {name!r} is not known, allowed are {', '.join((*MODULES, *_own_readers()))}")
    return import_module(f"palpate.io.{MODULES[name]}")


def _own_readers() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP) if entry.name not in MODULES}


def _ask(name: str, question: str, path: Path) -> Any:
    """Call detect or read of another package's reader. Raises FileError on whatever it raises."""
    entry = _own_readers()[name]
    try:
        return getattr(entry.load(), question)(path)
    except PalpateError as error:
        raise FileError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error
    except Exception as error:  # the code of another package
        code = f"entry point {name!r} of {GROUP} ({entry.value})"
        raise FileError(f"{path}: {code} ended with {type(error).__name__}: {one_line(error)}") from error


def _read_own(name: str, path: Path) -> Recording | Trajectory:
    found = _ask(name, "read", path)
    if not isinstance(found, Recording | Trajectory):
        kind = type(found).__name__
        raise FileError(f"{path}: {name!r} read a {kind}, expected a palpate.Recording or a palpate.Trajectory")
    return replace(found, file=path) if isinstance(found, Recording) and found.file is None else found
