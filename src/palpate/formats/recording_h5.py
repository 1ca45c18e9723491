"""palpate's own recording file, see palpate.recording."""

from pathlib import Path

from palpate.errors import SettingError
from palpate.recording import FORMAT, Recording, read_recording, write_recording
from palpate.trajectory import Trajectory

NAME = "palpate"
DESCRIPTION = "palpate recording, HDF5 (.h5)"


def detect(path: Path) -> bool:
    """Whether the file is HDF5 and says that it is one of these."""
    import h5py

    try:
        if not h5py.is_hdf5(path):
            return False
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("format", "") == FORMAT)
    except (OSError, RuntimeError, ValueError, KeyError):
        return False


def read(path: Path) -> Recording:
    """Read it. Raises FileError."""
    return read_recording(path)


def write(data: Recording | Trajectory, path: Path, overwrite: bool = False) -> None:
    """Write a recording. Raises FileError if the file exists and `overwrite` is not set."""
    if not isinstance(data, Recording):
        raise SettingError(f"{path}: a {NAME} file holds a recording, not a trajectory")
    write_recording(data, path, overwrite)
