"""The score that tuning makes small."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2

from palpate.geometry import se2
from palpate.lab.tune.likelihood import DAMPING, SLOPE, damped, negative_log_likelihood


def test_the_score_by_hand():
    pose, covariance = np.zeros((3, 3)), np.diag([1e-6, 4e-6, 1e-4])
    truth = np.array([[0.0, 0.0, 0.0], [np.sqrt(10.0) * 1e-3, 0.0, 0.0], [np.nan] * 3])
    found = negative_log_likelihood(pose, np.broadcast_to(covariance, (3, 3, 3)), truth)
    # log det = log 4e-16 = -35.45507; NEES 0, and 10 = b, which costs a log 2 = 14.43339 * 0.693147 = 10.00446.
    np.testing.assert_allclose(found[:2], [-17.72753, -17.72753 + 5.00223], atol=1e-5)
    assert np.isnan(found[2])
    assert negative_log_likelihood(pose[:1], np.diag([1.0, 0.0, 1.0])[None], truth[:1]) == np.inf


def test_damping_is_as_much_in_the_mean_as_a_plain_square():
    mean = quad(lambda squared: SLOPE * squared / (DAMPING + squared) * chi2.pdf(squared, 3), 0, np.inf)[0]
    assert mean == pytest.approx(3.0, abs=1e-9)
    # It begins with a / b times the square; 100 standard deviations cost a log 1001 = 14.43339 * 6.908755.
    assert damped(1e-6) == pytest.approx(1.443339e-6)
    assert damped(100.0**2) == pytest.approx(99.71677)


def test_no_other_covariance_and_no_other_estimate_score_better():
    rng = np.random.default_rng(4)
    root = np.array([[1e-3, 0.0, 0.0], [-5e-4, 8e-4, 0.0], [3e-3, 1e-3, 1e-2]])
    covariance = root @ root.T
    truth = se2.exp(rng.normal(size=(100_000, 3)) @ root.T)
    pose = np.zeros((len(truth), 3))

    def score(change=np.eye(3), offset=(0.0, 0.0, 0.0)) -> float:  # noqa: B008
        told = change @ covariance @ change.T
        moved = se2.compose(pose, np.array(offset))
        return float(negative_log_likelihood(moved, np.broadcast_to(told, (len(pose), 3, 3)), truth).mean())

    right = score()
    for factor in (0.9, 0.95, 1.05, 1.1):
        assert score(np.eye(3) * factor) > right
        for axis in range(3):
            assert score(np.diag(np.where(np.arange(3) == axis, factor, 1.0))) > right
    for offset in np.diag([3e-4, 3e-4, 3e-3]):
        assert score(offset=tuple(offset)) > right and score(offset=tuple(-offset)) > right
