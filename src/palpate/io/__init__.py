"""Files of palpate and of others, one row of FORMATS each, found by their content.

Each module documents the frames and units of its files.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from palpate.errors import FileError, SettingError
from palpate.io.cmu_two_finger import is_cmu_log, read_cmu_log
from palpate.io.estimates_mcap import is_estimates_mcap, read_estimates_mcap, write_estimates_mcap
from palpate.io.mit_push import is_mit_push, read_mit_push
from palpate.io.recording_mcap import is_recording, read_recording, write_recording
from palpate.io.rosbag_reader import existing_bag, is_bag, refuse_bag
from palpate.io.theseus_json import is_theseus_json, read_theseus_json
from palpate.io.trajectories import (
    is_estimates_csv,
    is_tum,
    read_estimates_csv,
    read_tum,
    write_estimates_csv,
    write_tum,
)
from palpate.types.estimate import Trajectory
from palpate.types.recording import Recording


class Format(NamedTuple):
    """A format that is read."""

    description: str
    detect: Callable[[Path], bool]
    read: Callable[[Path], Recording | Trajectory]


FORMATS = {
    "palpate": Format("palpate recording (.mcap)", is_recording, read_recording),
    "estimates-mcap": Format("palpate estimates (.mcap)", is_estimates_mcap, read_estimates_mcap),
    "mit-push": Format("point pushes of a square, MIT cpush (.json, .json.gz)", is_mit_push, read_mit_push),
    "cmu-two-finger": Format("two-finger pushes, CMU PlanarManipulationToolBox (.txt)", is_cmu_log, read_cmu_log),
    "theseus-json": Format("DIGIT pushes of the Theseus example (.json)", is_theseus_json, read_theseus_json),
    "tum": Format("TUM trajectory (.tum, .txt)", is_tum, read_tum),
    "estimates-csv": Format("palpate estimates with covariance (.csv)", is_estimates_csv, read_estimates_csv),
    "bag": Format("bag of ROS messages: MCAP, ROS 2 (.db3 or its folder), ROS 1 (.bag)", is_bag, refuse_bag),
}
"""Formats by their names; detection asks them in this order."""


def detect_format(path: Path | str) -> str | None:
    """Return the name of the file's format, or None if it is not known. Raises FileError if there is no file."""
    path = existing_bag(path)
    return next((name for name, format in FORMATS.items() if format.detect(path)), None)


def read(path: Path | str) -> Recording | Trajectory:
    """Read a file of any known format. Raises FileError."""
    path = existing_bag(path)
    if (name := detect_format(path)) is not None:
        return FORMATS[name].read(path)
    if path.suffix.lower() in (".h5", ".hdf5"):
        raise FileError(
            f"{path}: is HDF5, in which earlier versions kept recordings; make it anew as MCAP, from its bag or arrays "
            "or by palpate simulate with the same seed"
        )
    known = "; ".join(f"{name}: {format.description}" for name, format in FORMATS.items())
    raise FileError(f"{path}: is in no known format; known are {known}")


def load_recording(path: Path | str) -> Recording:
    """Read a recording of any known format. Raises FileError also if the file holds a trajectory only."""
    data = read(path)
    if not isinstance(data, Recording):
        raise FileError(f"{path}: holds a trajectory, not a recording: there are no sensor poses in it")
    return data


def write(data: Recording | Trajectory, path: Path | str, overwrite: bool = False) -> None:
    """Write a recording (.mcap, or its ground truth as .tum) or a trajectory (.mcap, .tum, .csv).

    Raises FileError and SettingError.
    """
    path = Path(path)
    match path.suffix.lower(), data:
        case ".mcap", Recording():
            write_recording(data, path, overwrite)
        case ".mcap", Trajectory():
            write_estimates_mcap(data, path, overwrite)
        case ".tum", _:
            write_tum(data, path, overwrite)
        case ".csv", Trajectory():
            write_estimates_csv(data, path, overwrite)
        case ".csv", _:
            raise SettingError(f"{path}: a .csv holds a trajectory, not a recording")
        case _:
            raise SettingError(f"{path}: extension {path.suffix!r} is of no format, allowed are .mcap, .tum, .csv")
