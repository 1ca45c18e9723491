"""A reader of files of your own: here logs of a robot that pushes a disc.

Two lines say what it is and name the columns, time_ms,x_mm,y_mm,yaw_deg,touching; then each time has a line of numbers.
"""

from pathlib import Path

import numpy as np

import palpate

DESCRIPTION = "log of my robot (.log)"
FIRST = "# my-robot log"


def detect(path: Path) -> bool:
    """Whether a file is one of these; it is asked of files that palpate does not know, so it has to be quick."""
    with path.open("rb") as file:
        return file.read(len(FIRST)) == FIRST.encode()


def read(path: Path) -> palpate.Recording:
    """What is in it, in metres and radians."""
    try:
        time, x, y, yaw, touching = np.loadtxt(path, delimiter=",", skiprows=2, ndmin=2).T
    except ValueError as error:
        raise palpate.FileError(f"{path}: expected lines of five numbers ({error})") from error
    return palpate.Recording.from_arrays(
        image_time=1e-3 * time,
        images=None,
        pose_time=1e-3 * time,
        poses=np.column_stack([1e-3 * x, 1e-3 * y, np.radians(yaw)]),
        shape=palpate.Disc(0.05),
        sensor="digit",
        contact=touching > 0,
        source=f"my robot, {path.name}",
    )
