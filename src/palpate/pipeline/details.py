"""Two files of a run beside its poses: `answers.csv` and `friction.csv`, numbers in full double precision.

`answers.csv` has all answers, the best first, at each frame with several: one a row, with its covariance in the tangent
space at it (right, body frame). `friction.csv` has the estimated friction between sensor and object at each frame.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.errors import FileError
from palpate.files import read_text
from palpate.io.trajectories import COVARIANCE, UPPER
from palpate.types.estimate import Answer, Answers

Array = NDArray[np.float64]

_ANSWERS = ("time", "weight", "x", "y", "theta", *COVARIANCE)
_FRICTION = ("time", "friction", "deviation")


def write_answers(time: Array, answers: Answers, path: Path) -> None:
    """Write the answers at times (N,) [s], nothing where there is only one."""
    rows = [
        (when, one.weight, *one.pose, *one.covariance[UPPER])
        for when, several in zip(time, answers, strict=True)
        for one in several
    ]
    _write(path, _ANSWERS, np.reshape(rows, (-1, len(_ANSWERS))))


def read_answers(path: Path, time: Array) -> Answers:
    """Return the answers at times (N,) [s], which are those of the run's estimates. Raises FileError."""
    found: dict[float, list[Answer]] = {float(when): [] for when in time}
    for row in _read(path, _ANSWERS):
        if row[0] not in found:
            raise FileError(f"{path}: has an answer at {row[0]:.17g} s, at which there is no estimate")
        covariance = np.zeros((3, 3))
        covariance[UPPER] = covariance.T[UPPER] = row[5:]
        found[row[0]].append(Answer(row[2:5], covariance, float(row[1])))
    return tuple(tuple(several) for several in found.values())


def write_friction(time: Array, friction: Array, path: Path) -> None:
    """Write friction and its standard deviation (N, 2) at times (N,) [s]."""
    _write(path, _FRICTION, np.column_stack((time, friction)))


def _write(path: Path, columns: tuple[str, ...], rows: Array) -> None:
    np.savetxt(path, rows, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")


def _read(path: Path, columns: tuple[str, ...]) -> Array:
    header, *lines = read_text(path).splitlines()
    if header != ",".join(columns):
        raise FileError(f"{path}: line 1: expected the header {','.join(columns)}")
    try:
        rows = np.array([line.split(",") for line in lines], np.float64)
        return rows.reshape(-1, len(columns)) if lines else np.empty((0, len(columns)))
    except ValueError as error:
        raise FileError(f"{path}: expected rows of {len(columns)} numbers ({error})") from error
