"""Real, motion-captured pushes with the true relative yaw as touch. No limit depends on a file's name."""

from pathlib import Path

import numpy as np
import pytest

from palpate import io as formats
from palpate.config import STICKING, TrackerSettings
from palpate.geometry import se2
from palpate.pipeline.check_recording import inspect_recording
from palpate.pipeline.track import Run, track
from palpate.types.recording import Recording

LIMIT_MM, LIMIT_DEG = 6.0, 3.0  # beyond it an estimate is off
ORACLE, ALONE = TrackerSettings("oracle"), TrackerSettings("oracle", hypotheses=1)
ORACLE_STICKING = TrackerSettings("oracle", noise=STICKING, hypotheses=1)
DOUBTFUL = {"ambiguous", "displaced", "strained", "uncertain"}


def final(run: Run) -> tuple[float, float]:
    """Final errors [mm], [deg]."""
    return run.summary["final_translation_error_mm"], run.summary["final_rotation_error_deg"]


def nees(run: Run) -> np.ndarray:
    """Squared errors (N,) in the reported covariance, where ground truth is known."""
    assert run.recording.object_pose is not None and run.online.covariance is not None
    off = se2.log(se2.between(run.online.pose, run.recording.object_pose))
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(run.online.covariance), off)
    return squares[np.isfinite(squares)]


def knocked(recording: Recording) -> bool:
    """Whether someone's hand turns the object, by more than 5 degrees in five frames: pushing turns it by 2 at most."""
    assert recording.object_pose is not None
    yaw = recording.object_pose[:, 2]
    turned = np.angle(np.exp(1j * (yaw[5:] - yaw[:-5])))
    return bool(np.nanmax(np.abs(turned)) > np.radians(5.0))


@pytest.fixture(scope="module")
def recordings(shared_data: Path) -> list[Recording]:
    """All MIT runs."""
    found = [formats.load_recording(path) for path in sorted((shared_data / "mit_point_push").glob("*.json.gz"))]
    assert len(found) == 11
    return found


@pytest.fixture(scope="module")
def mit(recordings: list[Recording]) -> list[Run]:
    """All MIT runs, tracked."""
    return [track(recording, ORACLE) for recording in recordings]


@pytest.fixture(scope="module")
def sticking(recordings: list[Recording]) -> list[Run]:
    """The unbroken ones, tracked as contacts that stick."""
    return [track(recording, ORACLE_STICKING) for recording in recordings if inspect_recording(recording).unbroken]


def test_unbroken_mit_pushes_without_a_knock(mit):
    runs = [run for run in mit if inspect_recording(run.recording).unbroken and not knocked(run.recording)]
    errors = np.array([final(run) for run in runs])
    assert len(errors) >= 3
    assert (np.median(errors, axis=0) <= [2.5, 0.5]).all()
    assert (errors.max(axis=0) <= [LIMIT_MM, LIMIT_DEG]).all()


def test_unbroken_mit_pushes_that_are_taken_to_stick(sticking):
    # A knock looks like a slide that touch, which says yaw alone, cannot measure. Where sliding is ruled out, the
    # contact is where it was.
    errors = np.array([final(run) for run in sticking])
    assert len(errors) >= 5
    assert sum(knocked(run.recording) for run in sticking) >= 3
    assert (np.median(errors, axis=0) <= [2.5, 0.5]).all()
    assert (errors.max(axis=0) <= [LIMIT_MM, LIMIT_DEG]).all()


@pytest.fixture(scope="module")
def hit(mit: list[Run]) -> list[tuple[Run, Run]]:
    """Those in which a hand turns the object, tracked as shipped and with one hypothesis."""
    return [(run, track(run.recording, ALONE)) for run in mit if knocked(run.recording)]


def test_a_knocked_object_is_found_again(hit):
    assert len(hit) >= 6
    several, one = (np.array([final(run) for run in runs]) for runs in zip(*hit, strict=True))
    # Ends of 1, 2, 2, 2, 6 and 52 mm with several hypotheses, 1, 32, 99, 100, 100 and 105 mm with one. Pushes that end
    # soon after a hand has turned the object leave up to 20 degrees open.
    assert (several[:, 0] < 10.0).sum() >= len(hit) - 1
    assert np.median(several[:, 0]) < 6.0 and np.median(several[:, 1]) < 4.0
    assert np.median(several[:, 0]) < 0.2 * np.median(one[:, 0])


def test_the_truth_is_inside_what_is_said_after_a_knock(hit):
    inside = [[np.mean(nees(run) < 7.8) for run in pair] for pair in hit]
    several, one = np.transpose(inside)
    # 0.80 to 0.85 in one or two of them, another one when poses are jittered by 20 micrometres.
    assert several.min() > 0.7 and np.mean(several) > 0.88 and np.median(several) > 0.9
    assert np.median(one) < 0.7  # or this test says nothing
    # 99 %, but for one run that ends a second after a knock along its face, 52 mm off
    assert sum(nees(run)[-1] < 11.3 for run, _ in hit) >= len(hit) - 1


def test_an_estimate_that_is_off_says_so(mit):
    off = [run for run in mit if final(run)[0] > LIMIT_MM or final(run)[1] > LIMIT_DEG]
    assert len(off) > 1  # or this test says nothing
    # But for one in which a knock along the face in the last second has not shown yet.
    assert sum(bool(set(run.online.status[-10:]) & DOUBTFUL) for run in off if run.online.status) >= len(off) - 1


def test_no_real_push_is_indeterminate_and_every_covariance_is_one(mit, sticking):
    for run in [*mit, *sticking]:
        assert run.online.status is not None
        assert run.online.covariance is not None
        assert "indeterminate" not in run.online.status
        np.testing.assert_array_equal(run.online.covariance, run.online.covariance.transpose(0, 2, 1))
        assert np.linalg.eigvalsh(run.online.covariance).min() > 0.0
        assert len(run.smoothed) == len(run.recording)


def test_two_fingered_cmu_pushes(shared_data):
    paths = sorted((shared_data / "cmu_two_finger").glob("*.txt"))
    for path in (paths[0], paths[-1]):
        run = track(formats.load_recording(path), ORACLE)
        translation, rotation = final(run)
        assert translation < LIMIT_MM
        assert rotation < 4.0  # one finger may be off the side, so that two do not hold the yaw as firmly as it seems
        assert run.summary["in_95_final"]
