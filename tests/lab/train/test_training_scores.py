"""The paper's models of relative pose, and how far what a model tells is to be believed."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from palpate.lab.train import heads, results
from palpate.lab.train.scores import COVERAGE, coverage, spread_of, without_offset

# --- the paper's models ---


def pairs(features: int, count: int = 3000, seed: int = 0) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(seed)
    return *rng.normal(size=(2, count, features)), np.eye(3)[rng.integers(3, size=count)]


def test_linear_recovers_the_weights_of_each_kind():
    wanted = np.array([[0.3, -0.1], [0.0, 0.5], [-0.2, 0.2]])
    earlier, later, kinds = pairs(2)
    sine = np.array([wanted[kind.argmax()] @ (b - a) for a, b, kind in zip(earlier, later, kinds, strict=True)])
    found = heads.fit_linear(earlier, later, kinds, sine + np.random.default_rng(1).normal(0.0, 0.01, len(sine)))
    np.testing.assert_allclose(found, wanted, atol=2e-3)
    np.testing.assert_allclose(heads.linear(wanted, earlier, later, kinds), sine)
    # What is half one kind and half another is told the mean of both.
    half = heads.linear(wanted, np.zeros((1, 2)), np.ones((1, 2)), np.array([[0.5, 0.5, 0.0]]))
    assert half == pytest.approx(0.5 * (0.2 + 0.5))


def test_nonlinear_learns_what_linear_cannot(monkeypatch):
    monkeypatch.setattr(heads, "_STEPS", 400)
    monkeypatch.setattr(heads, "_BATCH", 256)
    monkeypatch.setattr(heads, "_RATE", 1e-2)

    def truth(earlier: Any, later: Any, kinds: Any) -> Any:
        # Antisymmetric, without a linear part in two kinds of three, whose signs differ.
        return (later[:, 0] ** 2 - earlier[:, 0] ** 2) * (kinds @ np.array([0.3, -0.3, 0.0])) + 5.0 * kinds[:, 2] * (
            later[:, 1] - earlier[:, 1]
        )

    given, fresh = pairs(2), pairs(2, seed=1)
    scale = np.array([[10.0, 0.01]])  # units differ
    given, fresh = ((a * scale, b * scale, kinds) for a, b, kinds in (given, fresh))

    def normal(of: Any) -> Any:
        return truth(of[0] / scale, of[1] / scale, of[2])

    nonlinear = heads.fit_nonlinear(*given, normal(given), seed=0)
    weights = heads.fit_linear(*given, normal(given))
    of_linear = np.mean((heads.linear(weights, *fresh) - normal(fresh)) ** 2)
    of_nonlinear = np.mean((nonlinear(*fresh) - normal(fresh)) ** 2)
    assert of_nonlinear < 0.1 * of_linear
    earlier, later, kinds = fresh
    np.testing.assert_allclose(nonlinear(later, earlier, kinds), -nonlinear(earlier, later, kinds), atol=1e-5)
    again = heads.fit_nonlinear(*given, normal(given), seed=0)
    np.testing.assert_array_equal(again(*fresh), nonlinear(*fresh))


# --- scores ---

COUNT = 60_000
EPISODE = np.repeat(np.arange(COUNT // 300), 300)


def test_white_noise_is_to_be_believed_as_it_is():
    rng = np.random.default_rng(0)
    variance = rng.uniform(0.1, 3.0, COUNT)
    error = rng.normal(0.0, np.sqrt(variance))
    found = spread_of(error, variance, EPISODE)
    assert found.scale == pytest.approx(1.0, abs=0.03)
    assert found.together == pytest.approx(1.0, abs=0.05)
    # Variances that are a quarter of what they should be.
    found = spread_of(error, variance / 4.0, EPISODE)
    assert found.scale == pytest.approx(4.0, abs=0.12)
    assert found.together == pytest.approx(1.0, abs=0.05)
    assert found.factor == found.scale * found.together


@pytest.mark.parametrize("r", [0.3, 0.5])
def test_errors_that_last_are_worth_less(r):
    # x_t = r x_t-1 + w has correlations r^k, whose sum over all k is (1 + r) / (1 - r); here anew in each contact.
    rng = np.random.default_rng(1)
    error = rng.normal(size=(COUNT // 300, 300))
    error[:, 1:] *= np.sqrt(1.0 - r**2)
    for t in range(1, 300):
        error[:, t] += r * error[:, t - 1]
    found = spread_of(error.ravel(), np.ones(COUNT), EPISODE)
    assert found.scale == pytest.approx(1.0, abs=0.05)
    assert found.together == pytest.approx((1.0 + r) / (1.0 - r), rel=0.1)
    # Frames of no two of which are of the same contact say nothing of that.
    assert spread_of(error.ravel(), np.ones(COUNT), np.arange(COUNT)).together == 1.0


def test_errors_of_another_contact_do_not_last():
    # Each contact has an error of its own, 60 frames long; across contacts it alternates.
    error = np.repeat(np.resize([1.0, -1.0], COUNT // 60), 60)
    found = spread_of(error, np.ones(COUNT), np.repeat(np.arange(COUNT // 60), 60))
    assert found.together == pytest.approx(1.0 + 2.0 * 10)  # as far as errors are counted as going together


def test_coverage_of_a_gaussian():
    error = norm.ppf((np.arange(10_000) + 0.5) / 10_000)
    for share, found in coverage(3.0 * error, np.full(10_000, 9.0)).items():
        assert found == pytest.approx(share, abs=2e-4)
        assert norm.cdf(COVERAGE[share]) - norm.cdf(-COVERAGE[share]) == pytest.approx(share, abs=1e-4)
    # Twice the deviation: P(|x| < 2 * 0.9945) and P(|x| < 3.92).
    found = coverage(error, np.full(10_000, 4.0))
    assert found == pytest.approx({0.68: 0.9533, 0.95: 0.99991}, abs=2e-4)


def test_an_offset_is_taken_out_of_each_contact():
    error, variance = np.array([1.0, 4.0, 7.0, 9.0]), np.array([1.0, 0.5, 2.0, 2.0])
    # (1 / 1 + 4 / 0.5) / (1 / 1 + 1 / 0.5) = 9 / 3 = 3, and (7 + 9) / 2 = 8.
    found = without_offset(error, variance, np.array([0, 0, 2, 2]))
    np.testing.assert_allclose(found, [-2.0, 1.0, -1.0, 1.0])


def test_what_simulation_makes_easy_is_believed_no_more_for_that(monkeypatch: pytest.MonkeyPatch):
    error = np.random.default_rng(0).normal(size=COUNT)
    told = {"direction": (0.5 * error, np.ones(COUNT)), "turn": (2.0 * error, np.ones(COUNT))}
    told["pair"] = (0.5 * error, np.ones(COUNT))
    monkeypatch.setattr(results, "prediction_errors", lambda *_: told)
    monkeypatch.setattr(results, "_pairs", lambda _: (None, None, np.array([0.0, 0.2, -0.2])))
    models: Any = SimpleNamespace(tell={"linear learnt": lambda *_: np.zeros(3)})
    samples: Any = SimpleNamespace(episode=EPISODE)
    found = results.measure_spread(samples, samples, models, samples)
    assert found["direction"].scale == found["pair"].scale == 1.0  # and not a quarter
    assert found["turn"].scale == pytest.approx(4.0, rel=0.05)
    assert found["linear"].scale == pytest.approx(2.0 / 3.0 * np.sin(0.2) ** 2)  # measured, not told: as it is
