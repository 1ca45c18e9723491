"""Files of palpate and of others, one module for each format, found by their content.

A format module has NAME, DESCRIPTION, detect(path) and read(path), and write(data, path, overwrite) where
that makes sense; lost(data) where it cannot hold all. What a file's frames and units are, each module says. Users may
bring readers of their own (`own_readers`), which are asked last.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

from palpate.errors import FileError, SettingError
from palpate.io.bags.containers import existing_bag
from palpate.io.own_readers import GROUP, own_format, own_reader
from palpate.io.palpate_h5 import is_hdf5
from palpate.own_code import own_code
from palpate.types.recording import Recording
from palpate.types.trajectory import Trajectory

MODULES = {
    "palpate": "palpate_h5",
    "mit-push": "mit_push",
    "cmu-two-finger": "cmu_two_finger",
    "theseus-json": "theseus_json",
    "tum": "tum",
    "estimates-csv": "estimates_csv",
    "bag": "bag",
}
"""The module of each format, by its name; detection asks them in this order."""

EXTENSIONS = {
    ".h5": "palpate",
    ".hdf5": "palpate",
    ".json": "theseus-json",
    ".tum": "tum",
    ".csv": "estimates-csv",
    ".mcap": "bag",
}
"""The format that a file to be written gets, by its extension."""


def detect_format(path: Path | str) -> str | None:
    """The name of the file's format, or None if it is not known. Raises FileError if there is no file."""
    path = existing_bag(path)
    return next((name for name in MODULES if _module(name).detect(path)), None) or own_format(path)


def read(path: Path | str, format: str | None = None) -> Recording | Trajectory:
    """Read a file of any known format; `format` names it if it is not to be told from the content."""
    path = existing_bag(path)
    name = format or detect_format(path)
    if name is None:
        if is_hdf5(path):
            # It could be a palpate recording that is damaged or of another kind: its reader says which.
            name = "palpate"
        else:
            raise FileError(f"{path}: is in no known format; known are {_known()}")
    return _module(name).read(path)


def load_recording(path: Path | str) -> Recording:
    """Read a recording of any known format. Raises FileError also if the file holds a trajectory only."""
    data = read(path)
    if not isinstance(data, Recording):
        raise FileError(f"{path}: holds a trajectory, not a recording: there are no sensor poses in it")
    return data


def write(data: Recording | Trajectory, path: Path | str, format: str | None = None, overwrite: bool = False) -> None:
    """Write a file in the named format, or in the one its extension stands for."""
    _writer(path, format).write(data, Path(path), overwrite)


def lost(data: Recording | Trajectory, path: Path | str, format: str | None = None) -> list[str]:
    """What of the data the format that `write` would take cannot hold, in words; nothing for most."""
    module = _writer(path, format)
    return module.lost(data) if hasattr(module, "lost") else []


def _writer(path: Path | str, format: str | None) -> Any:
    """The module of the named format, or of the one that the extension stands for."""
    path = Path(path)
    name = format or EXTENSIONS.get(path.suffix.lower())
    if name is None:
        allowed = ", ".join(EXTENSIONS)
        raise SettingError(f"{path}: extension {path.suffix!r} stands for no format, allowed are {allowed}")
    module = _module(name)
    if not hasattr(module, "write"):
        raise SettingError(f"{path}: {name} files can be read but not written")
    return module


def _module(name: str) -> Any:
    if name in own_code(GROUP) and name not in MODULES:
        return own_reader(name)
    if name not in MODULES:
        raise SettingError(f"format {name!r} is not known, allowed are {', '.join((*MODULES, *own_code(GROUP)))}")
    return import_module(f"palpate.io.{MODULES[name]}")


def _known() -> str:
    return "; ".join(f"{name}: {_module(name).DESCRIPTION}" for name in (*MODULES, *own_code(GROUP)))
