"""Trajectories as text: TUM files, and `estimates.csv` with covariance, status and its reason.

TUM has lines `t x y z qx qy qz qw` [s, m], here of poses in the plane. `estimates.csv` has one estimate a row in full
double precision, SI units and radians; the covariance is that of the tangent vector at the estimate (right, body
frame), and contact is 1 or 0.
"""

import csv
from pathlib import Path

import numpy as np

from palpate.checks import checked_times
from palpate.errors import FileError
from palpate.files import in_file, numbers_of, read_table, whole_file
from palpate.types.estimate import Trajectory

COVARIANCE = ("xx", "xy", "xtheta", "yy", "ytheta", "thetatheta")
COLUMNS = ("time", "x", "y", "theta", *COVARIANCE, "contact", "status")
UPPER = np.triu_indices(3)


def write_tum(data: Trajectory, path: Path) -> None:
    """Write poses with 9 decimals. Raises FileError if the file exists."""
    zero, half = np.zeros(len(data)), data.pose[:, 2] / 2
    table = np.column_stack([data.time, data.pose[:, :2], zero, zero, zero, np.sin(half), np.cos(half)])
    with whole_file(path) as temporary:
        np.savetxt(temporary, table, fmt="%.9f")


def write_estimates_csv(data: Trajectory, path: Path) -> None:
    """Write estimates with covariance, contact, status and reason. Raises FileError if the file exists."""
    assert data.covariance is not None and data.contact is not None and data.status is not None
    reasons = data.reason or ("",) * len(data)
    table = np.column_stack([data.time, data.pose, data.covariance[:, UPPER[0], UPPER[1]]])
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*COLUMNS, "reason"])
        for row, contact, *words in zip(table.tolist(), data.contact, data.status, reasons, strict=True):
            writer.writerow([*map(repr, row), int(contact), *words])


def read_estimates_csv(path: Path) -> Trajectory:
    """Read estimates. Raises FileError that names the line."""
    lines, rows = read_table(path, COLUMNS, optional="reason"), []
    if not lines:
        raise FileError(f"{path}: holds no estimates")
    for number, line in lines:
        if (row := numbers_of(line[:11])) is None or line[10] not in ("0", "1"):
            raise FileError(
                f"{path}: line {number}: found {','.join(line)[:80]!r}, expected a time, a pose, the six terms of a "
                "covariance, contact 1 or 0, and a status"
            )
        rows.append(row)
    table, covariance = np.array(rows), np.zeros((len(rows), 3, 3))
    covariance[:, UPPER[0], UPPER[1]] = covariance[:, UPPER[1], UPPER[0]] = table[:, 4:10]
    with in_file(path):
        status, reason = zip(*(line[11:] for _, line in lines), strict=True)
        return Trajectory(checked_times(table[:, 0]), table[:, 1:4], covariance, table[:, 10] == 1, status, reason)
