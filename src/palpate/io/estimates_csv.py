"""palpate's `estimates.csv`: one estimate a row, numbers in full double precision, SI units and radians.

The covariance is that of the tangent vector at the estimate (right, body frame). Contact is 1, 0 or empty.
"""

import csv
import io
from pathlib import Path

import numpy as np

from palpate.errors import FileError, one_line
from palpate.files import csv_rows, in_file, read_text, whole_file
from palpate.io.text_files import text_start
from palpate.types.estimate import Trajectory

DESCRIPTION = "palpate estimates with covariance (.csv)"

COVARIANCE = ("xx", "xy", "xtheta", "yy", "ytheta", "thetatheta")
COLUMNS = ("time", "x", "y", "theta", *COVARIANCE, "contact", "status")

UPPER = np.triu_indices(3)
CONTACT = {"1": True, "0": False, "": None}


def detect(path: Path) -> bool:
    """Return true if the file starts with the header of one of these."""
    return text_start(path).splitlines()[:1] == [",".join(COLUMNS)]


def read(path: Path) -> Trajectory:
    """Read the estimates. Raises FileError that names the line."""
    return trajectory_from_text(read_text(path), path)


def trajectory_from_text(text: str, path: Path) -> Trajectory:
    """Return the trajectory in the text of such a file; errors name `path`. Raises FileError."""
    lines = csv_rows(text, path)
    if not lines or tuple(lines[0]) != COLUMNS:
        raise FileError(f"{path}: line 1: expected the header {','.join(COLUMNS)}")
    rows = []
    for number, line in enumerate(lines[1:], 2):
        try:
            if len(line) != len(COLUMNS):
                raise ValueError(f"{len(line)} fields, expected {len(COLUMNS)}")
            if line[10] not in CONTACT:
                raise ValueError(f"contact {line[10]!r}, allowed is 1, 0 or nothing")
            filled = {value != "" for value in line[4:10]}
            if len(filled) > 1:
                raise ValueError("part of a covariance, expected six terms or none")
            terms = [float(value) for value in line[4:10]] if filled == {True} else None
            rows.append(([float(value) for value in line[:4]], terms, CONTACT[line[10]], line[11]))
        except ValueError as error:
            raise FileError(f"{path}: line {number}: {one_line(error)}") from error
    if not rows:
        raise FileError(f"{path}: holds no estimates")
    poses, terms, contact, status = zip(*rows, strict=True)
    for name, column in (("covariance", terms), ("contact", contact)):
        if len({value is None for value in column}) > 1:
            raise FileError(f"{path}: {name}: some rows have it and some have not, expected all or none")
    covariance = None
    if terms[0] is not None:
        covariance = np.zeros((len(rows), 3, 3))
        covariance[:, UPPER[0], UPPER[1]] = terms
        covariance[:, UPPER[1], UPPER[0]] = terms
    table = np.array(poses)
    with in_file(path):
        return Trajectory(
            time=table[:, 0],
            pose=table[:, 1:],
            covariance=covariance,
            contact=None if contact[0] is None else np.array(contact),
            status=tuple(status) if any(status) else None,
        )


def write(data: Trajectory, path: Path, overwrite: bool = False) -> None:
    """Write a trajectory. Raises FileError if the file exists and `overwrite` is not set."""
    with whole_file(path, overwrite) as temporary:
        temporary.write_text(trajectory_to_text(data), encoding="utf-8")


def trajectory_to_text(data: Trajectory) -> str:
    """Return the text of the file of a trajectory."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for index in range(len(data)):
        pose = [repr(float(value)) for value in (data.time[index], *data.pose[index])]
        terms = [""] * 6
        if data.covariance is not None:
            terms = [repr(float(value)) for value in data.covariance[index][UPPER]]
        contact = "" if data.contact is None else str(int(data.contact[index]))
        writer.writerow([*pose, *terms, contact, data.status[index] if data.status else ""])
    return text.getvalue()
