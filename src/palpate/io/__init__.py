"""Files of palpate and of others, one row of FORMATS each, found by their content.

Each module documents the frames and units of its files.
"""

from collections.abc import Callable
from pathlib import Path

from palpate.errors import FileError
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
"""What tells a format, in this order, and reads it; None where a file alone is no recording."""


def detect_format(path: Path | str) -> str | None:
    """Return the name of the file's format, or None if it is not known. Raises FileError if there is no file."""
    path = existing_bag(path)
    return next((name for name, (is_one, _) in FORMATS.items() if is_one(path)), None)


def load_recording(path: Path | str, orientation: str = "") -> Recording:
    """Read a recording of any known format; `orientation` says how its images lie. Raises FileError."""
    path = existing_bag(path)
    if (name := detect_format(path)) is None:
        raise FileError(f"{path}: is in no known format; known are palpate's, ROS bags, and MIT's and CMU's pushes")
    if (read := FORMATS[name][1]) is None:
        raise FileError(f"{path}: is a bag without an outline of the object: give --shape, in Python palpate.read_bag")
    with in_file(path):
        return read(path).oriented(orientation)
