"""What a run knows beyond poses, as two files: `answers.csv` and `friction.csv`, numbers in full double precision.

`answers.csv` holds all poses that may be the object's, the best first, at each frame at which there are several: one a
row, with its covariance in the tangent space at it (right, body frame). `friction.csv` holds the Coulomb friction
between sensor and object as learnt up to each frame, with its standard deviation.
"""

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import read_csv, whole_file
from palpate.io.estimates_csv import COVARIANCE, UPPER
from palpate.printable import one_line
from palpate.types.answer import Answer, Answers

Array = NDArray[np.float64]

_ANSWERS = ("time", "weight", "x", "y", "theta", *COVARIANCE)
_FRICTION = ("time", "friction", "deviation")


def write_answers(time: Array, answers: Answers, path: Path) -> None:
    """Write the answers at times (N,) [s], none where there is one only."""
    rows = (
        (when, one.weight, *one.pose, *one.covariance[UPPER])
        for when, several in zip(time, answers, strict=True)
        for one in several
    )
    _write(path, _ANSWERS, rows)


def read_answers(path: Path, time: Array) -> Answers:
    """Return the answers at times (N,) [s], which are those of the run's estimates. Raises FileError."""
    found: dict[float, list[Answer]] = {float(when): [] for when in time}
    for number, row in enumerate(_read(path, _ANSWERS), 2):
        if row[0] not in found:
            raise FileError(f"{path}: line {number}: time is {row[0]:.17g} s, at which there is no estimate")
        covariance = np.zeros((3, 3))
        covariance[UPPER] = covariance.T[UPPER] = row[5:]
        found[row[0]].append(Answer(row[2:5], covariance, float(row[1])))
    return tuple(tuple(several) for several in found.values())


def write_friction(time: Array, friction: Array, path: Path) -> None:
    """Write friction and its standard deviation (N, 2) at times (N,) [s]."""
    _write(path, _FRICTION, np.column_stack((time, friction)))


def read_friction(path: Path, time: Array) -> Array:
    """Return friction and its standard deviation (N, 2) at times (N,) [s], those of the estimates. Raises FileError."""
    rows = _read(path, _FRICTION)
    if not np.array_equal(rows[:, 0], time):
        raise FileError(f"{path}: has {len(rows)} times that are not those of the run's {len(time)} estimates")
    return rows[:, 1:]


def _write(path: Path, columns: tuple[str, ...], rows: Iterable[Iterable[float]]) -> None:
    """Write rows as they come: there may be many more answers than frames."""
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([repr(float(value)) for value in row] for row in rows)


def _read(path: Path, columns: tuple[str, ...]) -> Array:
    lines = read_csv(path)
    if not lines or tuple(lines[0]) != columns:
        raise FileError(f"{path}: line 1: expected the header {','.join(columns)}")
    rows = []
    for number, line in enumerate(lines[1:], 2):
        if len(line) != len(columns):
            raise FileError(f"{path}: line {number}: found {len(line)} fields, expected {len(columns)}")
        try:
            rows.append([float(value) for value in line])
        except ValueError as error:
            raise FileError(f"{path}: line {number}: {one_line(error)}") from error
    return np.array(rows, dtype=np.float64).reshape(-1, len(columns))
