"""Trajectories as text: TUM files, and `estimates.csv` with covariance and status.

TUM has lines `t x y z qx qy qz qw` [s, m], here of poses in the plane. `estimates.csv` has one estimate a row in full
double precision, SI units and radians; the covariance is that of the tangent vector at the estimate (right, body
frame), and contact is 1, 0 or empty.
"""

import csv
import io
import math
from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.files import csv_rows, first_rows, in_file, number_rows, numbers_of, read_text, text_start, whole_file
from palpate.types.estimate import Trajectory
from palpate.types.recording import Recording

COVARIANCE = ("xx", "xy", "xtheta", "yy", "ytheta", "thetatheta")
COLUMNS = ("time", "x", "y", "theta", *COVARIANCE, "contact", "status")
UPPER = np.triu_indices(3)


def is_tum(path: Path) -> bool:
    """Return true if the first rows are poses."""
    rows = first_rows(path, 8)
    return bool(rows) and all(abs(math.hypot(*row[4:]) - 1.0) < 1e-3 for row in rows)


def read_tum(path: Path) -> Trajectory:
    """Read a trajectory. Raises FileError that names the line, also for a pose out of the plane."""
    rows = number_rows(path, 8)
    time, x, y, z, qx, qy, qz, qw = np.array(list(rows.values())).T
    is_unit = np.abs(np.hypot(*np.clip([qz, qw], -2.0, 2.0)) - 1.0) < 1e-3
    planar = is_unit & (np.abs([z, qx, qy]).max(axis=0) <= 1e-6)
    if not planar.all():
        line, row = list(rows.items())[int(np.argmin(planar))]
        raise FileError(
            f"{path}: line {line}: found {row}, expected t x y z qx qy qz qw of a pose in the plane: z, qx and qy up "
            "to 1e-06, and a quaternion of length 1"
        )
    # q and -q are one rotation: folding qw to positive keeps the angle in [-pi, pi].
    angle = 2.0 * np.arctan2(np.where(qw < 0, -qz, qz), np.abs(qw))
    with in_file(path):
        return Trajectory(time, np.column_stack([x, y, angle]))


def write_tum(data: Recording | Trajectory, path: Path, overwrite: bool = False) -> None:
    """Write poses of the object with 9 decimals: a trajectory, or the ground truth of a recording. Raises FileError."""
    time, pose = (data.time, data.object_pose) if isinstance(data, Recording) else (data.time, data.pose)
    if pose is None:
        raise FileError(f"{path}: the recording has no object poses to write")
    known = ~np.isnan(pose).any(axis=1)
    time, pose = time[known], pose[known]
    zero, half = np.zeros(len(time)), pose[:, 2] / 2
    table = np.column_stack([time, pose[:, :2], zero, zero, zero, np.sin(half), np.cos(half)])
    with whole_file(path, overwrite) as temporary:
        np.savetxt(temporary, table, fmt="%.9f")


def is_estimates_csv(path: Path) -> bool:
    """Return true if the file starts with the header of `estimates.csv`."""
    return text_start(path).splitlines()[:1] == [",".join(COLUMNS)]


def read_estimates_csv(path: Path) -> Trajectory:
    """Read estimates. Raises FileError that names the line."""
    return estimates_from_text(read_text(path), path)


def estimates_from_text(text: str, path: Path) -> Trajectory:
    """Return the estimates in the text of such a file; errors name `path`. Raises FileError."""
    header, *lines = csv_rows(text, path) or [[]]
    if tuple(header) != COLUMNS:
        raise FileError(f"{path}: line 1: expected the header {','.join(COLUMNS)}")
    if not lines:
        raise FileError(f"{path}: holds no estimates")
    filled = [word != "" for word in [*lines[0], *[""] * len(COLUMNS)]]
    width, flags = (10 if filled[4] else 4), (("0", "1") if filled[10] else ("",))
    rows = []
    for number, line in enumerate(lines, 2):
        row = numbers_of(line[:width])
        if len(line) != len(COLUMNS) or row is None or any(line[width:10]) or line[10] not in flags:
            raise FileError(
                f"{path}: line {number}: found {','.join(line)[:80]!r}, expected a time, a pose, the six terms of a "
                "covariance, contact 1 or 0, and a status; covariance or contact may be empty in all lines"
            )
        rows.append(row)
    table, covariance = np.array(rows), None
    if width == 10:
        covariance = np.zeros((len(rows), 3, 3))
        covariance[:, UPPER[0], UPPER[1]] = covariance[:, UPPER[1], UPPER[0]] = table[:, 4:]
    status = tuple(line[11] for line in lines)
    with in_file(path):
        return Trajectory(
            time=table[:, 0],
            pose=table[:, 1:4],
            covariance=covariance,
            contact=np.array([line[10] == "1" for line in lines]) if filled[10] else None,
            status=status if any(status) else None,
        )


def write_estimates_csv(data: Trajectory, path: Path, overwrite: bool = False) -> None:
    """Write a trajectory. Raises FileError if the file exists and `overwrite` is not set."""
    with whole_file(path, overwrite) as temporary:
        temporary.write_text(estimates_to_text(data), encoding="utf-8")


def estimates_to_text(data: Trajectory) -> str:
    """Return the text of `estimates.csv`."""
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
