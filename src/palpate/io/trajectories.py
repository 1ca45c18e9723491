"""Trajectories as text: TUM files, and `estimates.csv` with covariance and status.

TUM has lines `t x y z qx qy qz qw` [s, m], here of poses in the plane. `estimates.csv` has one estimate a row in full
double precision, SI units and radians; the covariance is that of the tangent vector at the estimate (right, body
frame), and contact is 1, 0 or empty.
"""

import csv
from pathlib import Path

import numpy as np

from palpate.errors import FileError
from palpate.files import csv_rows, in_file, numbers_of, read_text, whole_file
from palpate.types.estimate import Trajectory
from palpate.types.recording import Recording

COVARIANCE = ("xx", "xy", "xtheta", "yy", "ytheta", "thetatheta")
COLUMNS = ("time", "x", "y", "theta", *COVARIANCE, "contact", "status")
UPPER = np.triu_indices(3)


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


def write_estimates_csv(data: Trajectory, path: Path) -> None:
    """Write estimates. Raises FileError if the file exists."""
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for index in range(len(data)):
            pose = [repr(float(value)) for value in (data.time[index], *data.pose[index])]
            terms = [""] * 6
            if data.covariance is not None:
                terms = [repr(float(value)) for value in data.covariance[index][UPPER]]
            contact = "" if data.contact is None else str(int(data.contact[index]))
            writer.writerow([*pose, *terms, contact, data.status[index] if data.status else ""])


def read_estimates_csv(path: Path) -> Trajectory:
    """Read estimates. Raises FileError that names the line."""
    header, *lines = csv_rows(read_text(path), path) or [[]]
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
