"""Formats of recordings, of palpate and of others: one row of FORMATS each, recognised by the content of a file.

Each module documents the frames and units of its files.
"""

from collections.abc import Callable
from pathlib import Path

from palpate.errors import FileError, kept_warnings
from palpate.files import in_file
from palpate.io.cmu_two_finger import is_cmu_log, read_cmu_log
from palpate.io.mit_push import is_mit_push, read_mit_push
from palpate.io.recording import Recording
from palpate.io.recording_mcap import is_recording, read_recording
from palpate.io.rosbag_reader import existing_bag, is_bag

FORMATS: dict[str, tuple[Callable[[Path], bool], Callable[[Path], Recording] | None]] = {
    "palpate": (is_recording, read_recording),
    "mit-push": (is_mit_push, read_mit_push),
    "cmu-two-finger": (is_cmu_log, read_cmu_log),
    "bag": (is_bag, None),
}
"""Of each format, in the order in which they are tried, the test for it and the reader; None if a file alone is no
recording."""


def detect_format(path: Path | str) -> str | None:
    """Return the name of the file's format, or None if it is not known. Raises FileError if there is no file."""
    path = existing_bag(path)
    return next((name for name, (is_of_format, _) in FORMATS.items() if is_of_format(path)), None)


def load_recording(path: Path | str, orientation: str = "") -> Recording:
    """Read a recording of any known format; `orientation` says how its images lie. Raises FileError."""
    path = existing_bag(path)
    name = detect_format(path)
    if name is None:
        raise FileError(
            f"{path}: is in no known format; known are palpate's, ROS bags, MIT's and CMU's pushes, and folders of "
            "LeRobot or of images with --poses TABLE; arrays are for palpate.Recording.from_arrays"
        )
    _, read = FORMATS[name]
    if read is None:
        raise FileError(f"{path}: is a bag without an outline of the object: give --shape, in Python palpate.read_bag")
    with in_file(path), kept_warnings() as warnings:
        recording = read(path).oriented(orientation)
    return recording.warned(warnings)
