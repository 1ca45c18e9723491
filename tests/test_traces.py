"""A dozen traces of all kinds against those in the repository; `scripts/traces.py check` compares all."""

import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "scripts"))
traces: Any = importlib.import_module("traces")

FAST = (
    *("set-up-rectangle-edges-4", "shoved-ellipse-3", "unseen-hexagon-edges", "mini-ellipse", "two-fingers-ellipse"),
    *("unknown-ellipse", "camera-rectangle-edges", "bag-rectangle-edges", "mirrored-rectangle-edges"),
    *("batch-rectangle-edges", "one-answer-ellipse", "own-touch-rectangle-edges", "fault-image-black-for-5-frames"),
)
"""Fast ones of all kinds, which hardly grow what rounding makes of poses and images."""


@pytest.mark.parametrize("name", FAST)
def test_estimates_are_what_they_were(name):
    again = traces.checked(name)
    assert not again.is_off, f"\n{traces.HEAD}\n{again.line(name)}"


def test_all_traces_are_stored_and_small():
    paths = list(traces.TRACES.glob("*.npz"))
    assert {path.stem for path in paths} == set(traces.CASES)
    assert sum(path.stat().st_size for path in paths) < 3_000_000


def test_what_counts_as_a_difference():
    answers = np.array([[0.0, 0.0, 0.0, 1.0], [0.1, 0.2, 3.14, 0.5], [0.3, 0.2, 0.0, 0.5]])
    stored = {
        "pose": answers[:2, :3],
        "covariance": np.tile([1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-4], (2, 1)),
        "status": np.array([1, 0]),
        "names": np.array(["ambiguous", "tracking"]),
        "count": np.array([1, 2]),
        "answers": answers,
    }

    def off(tolerance: float = 1e-6, **changes: Any) -> list[bool]:
        return traces.difference(stored | changes, stored, tolerance).off.tolist()

    swapped, neither = answers[[0, 2, 1]], [False, False]
    assert off() == off(0.0) == off(answers=swapped) == neither
    assert off(0.0, answers=swapped) == [False, True]
    assert off(pose=stored["pose"] + [[0.0, 0.0, 2.0 * np.pi], [0.0, 5e-7, 0.0]]) == neither
    assert off(pose=stored["pose"] + [[0.0, 0.0, 0.0], [0.0, 2e-6, 0.0]]) == [False, True]
    assert off(covariance=stored["covariance"] * [[1.00005], [1.0002]]) == [False, True]
    assert off(status=np.array([0, 0])) == [True, False]
    assert off(count=np.array([2, 1])) == [True, True]
