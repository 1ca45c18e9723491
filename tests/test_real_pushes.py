"""Real, motion-captured pushes with the true relative yaw as touch. No limit depends on a file's name."""

from pathlib import Path

import numpy as np
import pytest

from palpate import formats
from palpate.evaluation.inspection import inspect_recording
from palpate.evaluation.run import Run, track
from palpate.tracker import TrackerSettings

LIMIT_MM, LIMIT_DEG = 6.0, 3.0  # beyond it an estimate is off
ORACLE = TrackerSettings("oracle")


def final(run: Run) -> tuple[float, float]:
    """Final errors [mm], [deg]."""
    return run.summary["final_translation_error_mm"], run.summary["final_rotation_error_deg"]


@pytest.fixture(scope="module")
def mit(shared_data: Path) -> list[tuple[Run, bool]]:
    """All MIT runs, tracked, and whether each is unbroken."""
    recordings = [formats.load_recording(path) for path in sorted((shared_data / "mit_point_push").glob("*.json.gz"))]
    assert len(recordings) == 11
    return [(track(recording, ORACLE), inspect_recording(recording).unbroken) for recording in recordings]


def test_unbroken_mit_pushes(mit):
    errors = np.array([final(run) for run, unbroken in mit if unbroken])
    assert len(errors) >= 5
    assert (np.median(errors, axis=0) <= [2.5, 0.5]).all()
    assert (errors.max(axis=0) <= [LIMIT_MM, LIMIT_DEG]).all()


def test_an_estimate_that_is_off_says_so(mit):
    off = [run for run, _ in mit if final(run)[0] > LIMIT_MM or final(run)[1] > LIMIT_DEG]
    assert off  # or this test says nothing
    for run in off:
        assert run.online.status is not None
        assert set(run.online.status[-10:]) & {"displaced", "strained", "uncertain"}, run.recording.file


def test_no_real_push_is_indeterminate_and_every_covariance_is_one(mit):
    for run, _ in mit:
        assert run.online.status is not None
        assert run.online.covariance is not None
        assert "indeterminate" not in run.online.status
        np.testing.assert_array_equal(run.online.covariance, run.online.covariance.transpose(0, 2, 1))
        assert np.linalg.eigvalsh(run.online.covariance).min() > 0.0
        assert len(run.smoothed) == len(run.recording)


def test_two_fingered_cmu_pushes(shared_data):
    paths = sorted((shared_data / "cmu_two_finger").glob("*.txt"))
    for path in (paths[0], paths[-1]):
        translation, rotation = final(track(formats.load_recording(path), ORACLE))
        assert translation < LIMIT_MM
        assert rotation < LIMIT_DEG
