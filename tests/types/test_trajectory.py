"""Trajectory: what it refuses."""

import numpy as np
import pytest

from palpate import FileError, Trajectory


def test_fields_are_settled():
    made = Trajectory([0, 1], [[0, 0, 0], [1, 2, 3]], status=["a", "b"])  # type: ignore[arg-type]
    assert len(made) == 2
    assert made.time.dtype == made.pose.dtype == np.float64
    assert made.status == ("a", "b")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.zeros(0), "pose": np.zeros((0, 3))}, "time: found no poses"),
        ({"time": np.array([1.0, 0.0])}, "time: frame 1 runs backwards"),
        ({"pose": np.zeros((3, 3))}, r"pose: found shape \(3, 3\), expected \(2, 3\)"),
        ({"pose": np.full((2, 3), np.nan)}, r"pose: frame 0 is \[nan, nan, nan\]"),
        ({"covariance": np.zeros((2, 3))}, r"covariance: found shape \(2, 3\), expected \(2, 3, 3\)"),
        ({"covariance": np.full((2, 3, 3), np.nan)}, "covariance: frame 0 is"),
        ({"contact": np.zeros(2)}, "contact: found values of type float64"),
        ({"status": ("a",)}, "status: found 1 words for 2 times"),
    ],
)
def test_fields_that_do_not_fit_are_refused(changes, message):
    fields = {"time": np.array([0.0, 1.0]), "pose": np.zeros((2, 3))}
    with pytest.raises(FileError, match=message):
        Trajectory(**(fields | changes))
