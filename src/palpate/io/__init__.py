"""Files of palpate and of others, one row of FORMATS each, found by their content.

Each module documents the frames and units of its files.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from palpate.errors import FileError
from palpate.files import in_file
from palpate.io.cmu_two_finger import is_cmu_log, read_cmu_log
from palpate.io.mit_push import is_mit_push, read_mit_push
from palpate.io.recording_mcap import is_recording, read_recording
from palpate.io.rosbag_reader import existing_bag, is_bag
from palpate.types.recording import Recording


class Format(NamedTuple):
    """A format of recordings."""

    description: str
    detect: Callable[[Path], bool]
    read: Callable[[Path], Recording] | None
    """Reads a file; None where one alone is no recording."""


FORMATS = {
    "palpate": Format("palpate recording (.mcap)", is_recording, read_recording),
    "mit-push": Format("point pushes of a square, MIT cpush (.json, .json.gz)", is_mit_push, read_mit_push),
    "cmu-two-finger": Format("two-finger pushes, CMU PlanarManipulationToolBox (.txt)", is_cmu_log, read_cmu_log),
    "bag": Format("bag of ROS messages: MCAP, ROS 2 (.db3 or its folder), ROS 1 (.bag)", is_bag, None),
}
"""Formats by their names; detection asks them in this order."""


def detect_format(path: Path | str) -> str | None:
    """Return the name of the file's format, or None if it is not known. Raises FileError if there is no file."""
    path = existing_bag(path)
    return next((name for name, format in FORMATS.items() if format.detect(path)), None)


def load_recording(path: Path | str, orientation: str = "") -> Recording:
    """Read a recording of any known format; `orientation` says how its images lie. Raises FileError."""
    path = existing_bag(path)
    known = "; ".join(f"{name}: {format.description}" for name, format in FORMATS.items())
    if (name := detect_format(path)) is None:
        raise FileError(f"{path}: is in no known format; known are {known}")
    if (read := FORMATS[name].read) is None:
        raise FileError(
            f"{path}: is a bag of ROS messages without an outline of the object; palpate track and convert take it by "
            "--shape, in Python palpate.read_bag"
        )
    with in_file(path):
        return read(path).oriented(orientation)
