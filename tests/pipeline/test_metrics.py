"""Scores of a trajectory, computed by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from palpate import Trajectory
from palpate.geometry import se2
from palpate.pipeline import metrics
from palpate.types.estimate import Answer

TRUTH = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [np.nan] * 3])
POSE = np.array([[0.003, 0.004, 0.1], [0.0, 0.0, -0.1], [0.0, 0.012, 0.2], [9.0, 9.0, 1.0]])


def test_errors():
    # 3-4-5 triangle; 12 mm along y; unknown truth.
    assert metrics.translation_errors(POSE, TRUTH) == pytest.approx([0.005, 0.0, 0.012, np.nan], nan_ok=True)
    pose, truth = np.zeros((2, 3, 3))
    pose[:, 2], truth[:, 2] = (3.1, -3.1, 0.2), (-3.1, 3.1, -0.1)
    # 3.1 - (-3.1) = 6.2, less a whole turn of 6.283185 = -0.083185.
    assert metrics.rotation_errors(pose, truth) == pytest.approx([-0.083185307, 0.083185307, 0.3])
    assert metrics.rms([3.0, np.nan, -4.0]) == pytest.approx(np.sqrt(12.5)) and metrics.rms([np.nan]) is None
    # Of 1 .. 101 the q-th percentile is 1 + q.
    assert metrics.percentiles(np.arange(1, 102)) == {"p50": 51.0, "p95": 96.0, "p99": 100.0, "max": 101.0}
    # sqrt(9e-6 + 16e-6) = 5 mm, whatever the correlation of x and y.
    distance, angle = metrics.deviations([[[9e-6, 1e-6, 0.0], [1e-6, 16e-6, 0.0], [0.0, 0.0, 0.04]]])
    assert (distance, angle) == (pytest.approx([5e-3]), pytest.approx([0.2]))


def test_nees_in_the_body_frame():
    # The estimate faces +y: 2 mm along world y are along its x, where sigma is 1 mm, (2/1)^2 = 4; and 2 mm along world
    # -x are along its y, where sigma is 4 mm, 0.25.
    quarter = np.pi / 2
    pose = np.array([[1.0, 2.0, quarter]] * 2)
    truth = np.array([[1.0, 2.002, quarter], [0.998, 2.0, quarter]])
    covariance = np.array([np.diag([1e-6, 16e-6, 1.0])] * 2)
    assert metrics.nees(pose, covariance, truth) == pytest.approx([4.0, 0.25])


def test_nees_of_the_logarithm():
    # d = (0.1, 0, pi/2) at the identity: exp gives x = 0.1 sin(pi/2)/(pi/2), y = 0.1 (1 - cos(pi/2))/(pi/2).
    arm = 0.1 / (np.pi / 2)
    covariance = np.diag([0.1**2, 0.01**2, (np.pi / 4) ** 2])[None]
    # (0.1/0.1)^2 + 0 + 2^2 = 5
    assert metrics.nees(np.zeros((1, 3)), covariance, [[arm, arm, np.pi / 2]]) == pytest.approx([5.0])


def test_nees_of_samples_and_of_unusable_covariances():
    rng = np.random.default_rng(1)
    root, pose = rng.normal(size=(3, 3)) * 0.02, rng.normal(size=(4000, 3))
    truth = se2.compose(pose, se2.exp(rng.normal(size=(4000, 3)) @ root.T))
    found = metrics.nees(pose, np.broadcast_to(root @ root.T, (4000, 3, 3)), truth)
    # chi-square with 3 degrees of freedom: variance 6, so the mean of 4000 is within 4 sqrt(6/4000) = 0.155.
    assert np.mean(found) == pytest.approx(3.0, abs=0.155)
    assert np.mean(metrics.inside_95(found)) == pytest.approx(0.95, abs=0.015)
    unknown = metrics.nees(np.zeros((2, 3)), np.array([np.eye(3), np.zeros((3, 3))]), np.array([[np.nan] * 3, [0] * 3]))
    assert np.isnan(unknown).all() and not metrics.inside_95(unknown).any()


def test_log_likelihood_and_crps_by_hand():
    # Sigma of 1 mm, 1 mm and 0.1 rad: log det = 2 log 1e-6 + log 1e-2. The first is 2 sigma off along x.
    covariance = np.array([np.diag([1e-6, 1e-6, 1e-2])] * 3)
    pose, truth = np.zeros((3, 3)), np.array([[2e-3, 0.0, 0.0], [0.0, 0.0, 0.0], [np.nan] * 3])
    squared = metrics.nees(pose, covariance, truth)
    at_mean = -0.5 * (2 * np.log(1e-6) + np.log(1e-2) + 3 * np.log(2 * np.pi))
    found = metrics.log_likelihood(squared, covariance)
    assert found == pytest.approx([at_mean - 2.0, at_mean, np.nan], nan_ok=True)
    # With all covariances times k the mean is at_mean - (1.5 log k + 1 / k), best where k = 2 / 3, the mean NEES / 3.
    factors = np.linspace(0.3, 1.5, 1201)
    best = np.max(at_mean - 1.5 * np.log(factors) - 1.0 / factors)
    assert np.mean(found[:2]) + metrics.gain_by_rescaling(squared[:2]) == pytest.approx(best, abs=1e-5)
    # CRPS by its definition, the integral of (Phi(x) - [x >= error])^2.
    x = np.linspace(-12.0, 12.0, 240_001)
    for error, deviation in ((0.0, 1.0), (1.5, 1.0), (-3.0, 0.5)):
        by_hand = np.trapezoid((norm.cdf(x / deviation) - (x >= error)) ** 2, x)
        assert metrics.crps(error, deviation) == pytest.approx(by_hand, abs=1e-3)


def test_silently_wrong_is_far_off_outside_and_without_doubt():
    # Sigma of 2 mm and 1 degree. 12 mm are a NEES of 36, 8 mm one of 16, 6 degrees one of 36.
    mm, deg = [0.0, 12.0, 12.0, 8.0, 0.0, 12.0, 12.0], [0.0, 0.0, 0.0, 0.0, -6.0, 0.0, 0.0]
    pose = np.column_stack([np.array(mm) * 1e-3, np.zeros(7), np.radians(deg)])
    covariance = np.array([np.diag([4e-6, 4e-6, np.radians(1.0) ** 2])] * 7)
    covariance[6] *= 100.0  # which contains it
    status = ("tracking", "tracking", "strained", "tracking", "resting", "resting", "tracking")
    contact = np.array([False, True, True, True, False, False, True])
    trajectory = Trajectory(np.arange(7.0), pose, covariance, contact, status, ("",) * 7)

    # Of the six since the first contact the 1st, 4th and 5th.
    found = metrics.summarise(trajectory, np.zeros((7, 3)), np.ones(7))
    assert (found["in_95_share"], found["in_95_contact_share"], found["in_95_rest_share"]) == (1 / 6, 1 / 4, 0.0)
    assert found["in_95_final"]
    # In contact NEES of 36, 36, 16 and 0.36 and sigma of sqrt(8) mm, once ten times that.
    assert found["sigma_mm"] == pytest.approx(np.sqrt(8.0))
    likely = -0.5 * (
        88.36 / 4 + np.log(16e-12 * np.radians(1.0) ** 2) + 0.25 * 3 * np.log(100.0) + 3 * np.log(2 * np.pi)
    )
    assert found["nats"] == pytest.approx(likely)
    assert found["silently_wrong_share"] == 0.5


def silently_wrong(pose: list[float], truth: list[float], **about: Any) -> bool:
    """Return whether one estimate, with sigma of 2 mm and 1 degree, is silently wrong."""
    covariance = np.diag([4e-6, 4e-6, np.radians(1.0) ** 2])
    one = Trajectory(np.zeros(1), np.array([pose]), covariance[None], np.ones(1, np.bool_), ("tracking",), ("",))
    return bool(metrics.summarise(one, np.array([truth]), np.ones(1), **about)["silently_wrong_share"])


def test_silently_wrong_is_judged_at_the_centroid_and_without_the_yaw_of_a_disc():
    # Turned by 4 degrees about a centroid 200 mm from the origin, which moves by 14 mm.
    turn, center = np.radians(4.0), [0.2, 0.0]
    turned = [0.2 - 0.2 * np.cos(turn), -0.2 * np.sin(turn), turn]
    assert silently_wrong(turned, [0.0] * 3) and not silently_wrong(turned, [0.0] * 3, center=center)
    assert silently_wrong([0.0, 0.0, turn], [0.0] * 3, center=center)
    for yaw_shows in (True, False):
        assert silently_wrong([0.0, 0.0, 1.0], [0.0] * 3, yaw_shows=yaw_shows) == yaw_shows
        assert silently_wrong([0.011, 0.0, 0.0], [0.0] * 3, yaw_shows=yaw_shows)


def test_a_yaw_that_may_be_any_is_unknown_in_words():
    assert metrics.pose_words((0.1, 0.0, 1.0), (1e-3, 1e-3, 0.1)).endswith("yaw 57.3 ± 5.7°")
    assert metrics.pose_words((0.1, 0.0, 1.0), (1e-3, 1e-3, 3360.0)).endswith("0.0 ± 1.0 mm, yaw unknown")


def test_ambiguous_is_a_share_of_the_frames_in_contact():
    contact = np.array([True, True, True, True, False])
    status = ("ambiguous", "tracking", "ambiguous", "ambiguous", "ambiguous")
    trajectory = Trajectory(np.arange(5.0), np.zeros((5, 3)), np.array([np.eye(3)] * 5), contact, status, ("",) * 5)
    for touched, share in ((contact, 0.75), (np.zeros(5, np.bool_), None)):
        given = replace(trajectory, contact=touched)
        assert metrics.summarise(given, np.zeros((5, 3)), np.ones(5))["ambiguous_share"] == share


def test_the_summary_scores_frames_with_truth():
    status = ("resting", "tracking", "tracking", "resting")
    contact = np.array([False, True, True, False])
    trajectory = Trajectory(np.arange(4) / 10, POSE, np.array([np.eye(3)] * 4), contact, status, ("",) * 4)
    found = metrics.summarise(trajectory, TRUTH, np.ones(4), tactile="none")
    assert found["translation_rmse_mm"] == pytest.approx(np.sqrt((5**2 + 0 + 12**2) / 3))
    assert found["rotation_rmse_deg"] == pytest.approx(np.degrees(np.sqrt((0.1**2 + 0.1**2 + 0.2**2) / 3)))
    # The last frame has no truth; the one before is 12 mm and 0.2 rad off.
    assert (found["final_translation_error_mm"], found["final_scored_time_s"]) == (pytest.approx(12.0), 0.2)
    assert found["final_rotation_error_deg"] == pytest.approx(np.degrees(0.2))
    assert (found["final_pose"], found["scored_frames"], found["contact_frames"]) == ([9.0, 9.0, 1.0], 3, 2)
    assert found["statuses"] == {"resting": 2, "tracking": 2}
    blind = metrics.summarise(trajectory, 0.0 * TRUTH[3:], np.ones(4), tactile="none")
    assert list(blind) == list(found) and (blind["scored_frames"], blind["tactile"]) == (0, "none")
    scores = [key for key in blind if key.endswith(("_mm", "_deg", "_mean", "_time_s", "_share", "_final"))]
    assert {blind[key] for key in scores if not key.startswith("ambiguous")} == {None}


def test_ambiguous_frames_by_the_origin_of_their_answers():
    kept, moved = Answer(POSE[0], np.eye(3), 0.5), Answer(POSE[1], np.eye(3), 0.2, "shove")
    mirror = Answer(POSE[1], np.eye(3), 0.1, "mirrored images")
    answers = ((kept, moved), (moved, kept), (kept, moved, moved, mirror), (), (kept, mirror))
    status = ("ambiguous", "ambiguous", "ambiguous", "tracking", "tracking")
    assert metrics.ambiguous_by_origin(status, answers) == {"shove": 1.0, "mirrored images": pytest.approx(1 / 3)}
    assert metrics.ambiguous_by_origin(status[3:], answers[3:]) == {}
