from dataclasses import replace

import numpy as np
import pytest

from palpate.geometry import se2
from palpate.pipeline import metrics
from palpate.types.trajectory import Trajectory

TRUTH = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [np.nan] * 3])
POSE = np.array([[0.003, 0.004, 0.1], [0.0, 0.0, -0.1], [0.0, 0.012, 0.2], [9.0, 9.0, 1.0]])


def test_translation_errors_are_distances():
    # 3-4-5 triangle; 12 mm along y; unknown truth.
    found = metrics.translation_errors(POSE, TRUTH)
    assert found == pytest.approx([0.005, 0.0, 0.012, np.nan], nan_ok=True)


def test_rotation_errors_go_the_short_way_round():
    pose = np.array([[0, 0, 3.1], [0, 0, -3.1], [0, 0, 0.2]])
    truth = np.array([[0, 0, -3.1], [0, 0, 3.1], [0, 0, -0.1]])
    # 3.1 - (-3.1) = 6.2, less a whole turn of 6.283185 = -0.083185.
    assert metrics.rotation_errors(pose, truth) == pytest.approx([-0.083185307, 0.083185307, 0.3])


def test_rms_leaves_out_what_is_not_known():
    # sqrt((3^2 + 4^2) / 2) = sqrt(12.5)
    assert metrics.rms([3.0, np.nan, -4.0]) == pytest.approx(np.sqrt(12.5))
    assert metrics.rms([np.nan]) is None


def test_nees_by_hand():
    # No rotation error: log is the offset in the estimate's frame. The estimate faces +y, so 2 mm along
    # world y are 2 mm along its x, where sigma is 1 mm: (2/1)^2 = 4; and 2 mm along world -x are 2 mm along
    # its y, where sigma is 4 mm: 0.25.
    quarter = np.pi / 2
    pose = np.array([[1.0, 2.0, quarter]] * 2)
    truth = np.array([[1.0, 2.002, quarter], [0.998, 2.0, quarter]])
    covariance = np.array([np.diag([1e-6, 16e-6, 1.0])] * 2)
    assert metrics.nees(pose, covariance, truth) == pytest.approx([4.0, 0.25])


def test_nees_uses_the_logarithm_not_the_difference():
    # d = (0.1, 0, pi/2) at the identity: exp gives x = 0.1 sin(pi/2)/(pi/2), y = 0.1 (1 - cos(pi/2))/(pi/2).
    arm = 0.1 / (np.pi / 2)
    truth = np.array([[arm, arm, np.pi / 2]])
    covariance = np.diag([0.1**2, 0.01**2, (np.pi / 4) ** 2])[None]
    # (0.1/0.1)^2 + 0 + 2^2 = 5
    assert metrics.nees(np.zeros((1, 3)), covariance, truth) == pytest.approx([5.0])


def test_mean_nees_of_matching_covariances_is_three():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3)) * 0.02
    pose = rng.normal(size=(4000, 3))
    truth = se2.compose(pose, se2.exp(rng.normal(size=(4000, 3)) @ root.T))
    found = metrics.nees(pose, np.broadcast_to(root @ root.T, (4000, 3, 3)), truth)
    # chi-square with 3 degrees of freedom: variance 6, so the mean of 4000 is within 4 sqrt(6/4000) = 0.155.
    assert np.mean(found) == pytest.approx(3.0, abs=0.155)


def test_nees_is_unknown_for_unknown_truth_and_singular_covariance():
    covariance = np.array([np.eye(3), np.zeros((3, 3))])
    truth = np.array([[np.nan] * 3, [0.0, 0.0, 0.0]])
    assert np.isnan(metrics.nees(np.zeros((2, 3)), covariance, truth)).all()


def test_percentiles():
    # Of 1 .. 101 the q-th percentile is 1 + q.
    found = metrics.percentiles(np.arange(1, 102))
    assert found == {"p50": 51.0, "p95": 96.0, "p99": 100.0, "max": 101.0}


def test_inside_95_is_a_nees_of_up_to_7_815():
    # 95 % of chi-square with 3 degrees of freedom lie below 7.8147.
    assert metrics.inside_95([7.814, 7.816, np.nan]).tolist() == [True, False, False]


def test_coverage_is_of_frames_since_the_first_contact():
    contact = np.array([False, False, True, True, True, False, False, False])
    squared = np.array([99.0, 99.0, 1.0, 9.0, np.nan, 2.0, 3.0, np.nan])
    # In contact one of two, at rest both, all in all three of four.
    assert metrics.coverage(contact, squared) == {
        "in_95_share": 0.75,
        "in_95_contact_share": 0.5,
        "in_95_rest_share": 1.0,
        "in_95_final": True,
    }
    squared[6] = 8.0
    found = metrics.coverage(contact, squared)
    assert (found["in_95_rest_share"], found["in_95_final"]) == (0.5, False)
    untouched = metrics.coverage(np.zeros(8, np.bool_), squared)
    assert set(untouched.values()) == {None}


def test_silently_wrong_is_far_off_and_outside_and_content():
    # Sigma of 2 mm and 1 degree. 12 mm are a NEES of 36, 8 mm one of 16, 6 degrees one of 36.
    mm, deg = [0.0, 12.0, 12.0, 8.0, 0.0, 12.0, 12.0], [0.0, 0.0, 0.0, 0.0, -6.0, 0.0, 0.0]
    pose = np.column_stack([np.array(mm) * 1e-3, np.zeros(7), np.radians(deg)])
    covariance = np.array([np.diag([4e-6, 4e-6, np.radians(1.0) ** 2])] * 7)
    covariance[6] *= 100.0  # which holds it
    status = ("tracking", "tracking", "strained", "tracking", "resting", "resting", "tracking")
    contact = np.array([False, True, True, True, False, False, True])
    trajectory = Trajectory(np.arange(7.0), pose, covariance, contact, status)
    how = {"tactile": "none", "smoother": "isam2", "wall_s": 1.0, "episodes": 2}
    found = metrics.summarise(trajectory, np.zeros((7, 3)), np.ones(7), **how)
    # Of the six since the first contact the 1st, 4th and 5th.
    assert found["silently_wrong_share"] == 0.5
    assert found["in_95_share"] == pytest.approx(1 / 6)
    assert found["silently_wrong_unfelt_share"] is None
    # Knocked at first in contact and then not: of the 4th and 5th nothing could tell.
    knocked = np.isin(np.arange(7), (3, 4))
    found = metrics.summarise(trajectory, np.zeros((7, 3)), np.ones(7), **how, knocked=knocked)
    assert (found["silently_wrong_share"], found["silently_wrong_unfelt_share"]) == (0.5, pytest.approx(1 / 3))
    mute = metrics.summarise(replace(trajectory, status=None), np.zeros((7, 3)), np.ones(7), **how)
    assert mute["silently_wrong_share"] is None
    unsure = metrics.summarise(replace(trajectory, covariance=None), np.zeros((7, 3)), np.ones(7), **how)
    assert unsure["silently_wrong_share"] is unsure["in_95_share"] is unsure["in_95_final"] is None


def test_ambiguous_is_a_share_of_the_frames_in_contact():
    contact = np.array([True, True, True, True, False])
    status = ("ambiguous", "tracking", "ambiguous", "ambiguous", "ambiguous")
    trajectory = Trajectory(np.arange(5.0), np.zeros((5, 3)), contact=contact, status=status)
    how = {"tactile": "none", "smoother": "isam2", "wall_s": 1.0, "episodes": 1}
    assert metrics.summarise(trajectory, None, np.ones(5), **how)["ambiguous_share"] == 0.75
    for lacking in ({"status": None}, {"contact": None}, {"contact": np.zeros(5, np.bool_)}):
        assert metrics.summarise(replace(trajectory, **lacking), None, np.ones(5), **how)["ambiguous_share"] is None


def summary(truth):
    trajectory = Trajectory(
        time=np.array([0.0, 0.1, 0.2, 0.3]),
        pose=POSE,
        covariance=np.array([np.eye(3)] * 4),
        contact=np.array([False, True, True, False]),
        status=("resting", "tracking", "tracking", "resting"),
    )
    step_ms = [1.0] * 4
    return metrics.summarise(trajectory, truth, step_ms, tactile="none", smoother="isam2", wall_s=1.5, episodes=1)


KEYS = [
    *("frames", "contact_frames", "episodes", "tactile", "smoother", "wall_s", "step_ms", "final_pose", "final_sigma"),
    *("translation_rmse_mm", "rotation_rmse_deg", "final_translation_error_mm", "final_rotation_error_deg"),
    *("nees_mean", "statuses", "yaw_shows", "scored_frames", "final_scored_time_s"),
    *("in_95_share", "in_95_contact_share", "in_95_rest_share", "in_95_final"),
    *("silently_wrong_share", "silently_wrong_unfelt_share", "ambiguous_share"),
    *("knocks", "knock_recovery_s", "knock_recovery_contact_s", "knock_contact_s", "knock_error_mm"),
]


def test_summary_scores_the_frames_with_truth():
    found = summary(TRUTH)
    assert list(found) == KEYS
    # sqrt((5^2 + 0 + 12^2) / 3) = sqrt(169 / 3)
    assert found["translation_rmse_mm"] == pytest.approx(np.sqrt(169 / 3))
    # sqrt((0.1^2 + 0.1^2 + 0.2^2) / 3) = sqrt(0.02) rad
    assert found["rotation_rmse_deg"] == pytest.approx(np.degrees(np.sqrt(0.02)))
    # The last frame has no truth; the one before is 12 mm and 0.2 rad off.
    assert found["final_translation_error_mm"] == pytest.approx(12.0)
    assert found["final_rotation_error_deg"] == pytest.approx(np.degrees(0.2))
    assert found["final_scored_time_s"] == 0.2
    # The identity's NEES are the squares of logarithms: exp(d) = truth seen from the estimate, whose turn they leave
    # as it is and whose length they stretch by (theta / 2) / sin(theta / 2).
    stretched = [(way * turn / 2 / np.sin(turn / 2)) ** 2 + turn**2 for way, turn in ((0.005, 0.1), (0.012, 0.2))]
    assert found["nees_mean"] == pytest.approx((stretched[0] + 0.1**2 + stretched[1]) / 3, rel=1e-9)
    assert found["final_pose"] == [9.0, 9.0, 1.0]
    assert found["final_sigma"] == pytest.approx([1.0, 1.0, 1.0])
    assert found["scored_frames"] == 3
    assert (found["frames"], found["contact_frames"], found["episodes"]) == (4, 2, 1)
    assert found["statuses"] == {"resting": 2, "tracking": 2}
    assert found["step_ms"] == {"p50": 1.0, "p95": 1.0, "p99": 1.0, "max": 1.0}


def test_summary_without_truth_has_no_scores():
    found = summary(None)
    assert list(found) == KEYS
    assert found["final_pose"] == [9.0, 9.0, 1.0]
    assert found["scored_frames"] == 0
    assert all(
        found[key] is None
        for key in KEYS
        if key.endswith(("_mm", "_deg", "_mean", "_time_s", "_share", "_final")) and key != "ambiguous_share"
    )


def test_deviations_are_a_length_and_an_angle():
    # sqrt(9e-6 + 16e-6) = 5 mm, whatever x and y have in common.
    distance, angle = metrics.deviations([[[9e-6, 1e-6, 0.0], [1e-6, 16e-6, 0.0], [0.0, 0.0, 0.04]]])
    assert (distance, angle) == (pytest.approx([5e-3]), pytest.approx([0.2]))
