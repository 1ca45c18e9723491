"""Networks as ONNX files, what is held out, and the calibration of predicted variances."""

from typing import Any

import numpy as np
import onnx
import pytest
import torch
from scipy.stats import norm
from test_augment import samples

from palpate import EstimationError
from palpate.touch.touch_model import COLUMNS, OUTPUTS, ROWS, session
from palpate_lab.train.networks import WIDTH, Together, TouchNetwork, exported, restore
from palpate_lab.train.scores import coverage, measure_spread, spread_of, without_offsets
from palpate_lab.train.train import TrainSettings, split

COUNT = 60_000
EPISODE = np.repeat(np.arange(COUNT // 300), 300)


def test_the_file_gives_the_network_s_outputs():
    torch.manual_seed(0)
    network = TouchNetwork(OUTPUTS[0]).eval()
    for each in network.modules():
        if isinstance(each, torch.nn.BatchNorm2d):
            each.running_mean.normal_()  # type: ignore[union-attr]
    file = exported(network)
    assert b"networks.py" not in file and b"site-packages" not in file
    seen = torch.randn(1, 3, ROWS, COLUMNS)
    again = TouchNetwork(OUTPUTS[0]).eval()
    restore(again, file)
    with torch.no_grad():
        wanted, restored = ([each.numpy() for each in one(seen)] for one in (network, again))
    found: Any = session(file).run(None, {"difference": seen.numpy()})
    for from_file, again_, direct in zip(found, restored, wanted, strict=True):
        np.testing.assert_allclose(from_file, direct, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(again_, direct, rtol=1e-5, atol=1e-5)
    wider = onnx.load_from_string(file)
    first = next(each for each in wider.graph.initializer if each.name == "encoder.layers.0.weight")
    first.CopyFrom(onnx.numpy_helper.from_array(np.zeros((WIDTH + 8, 3, 7, 7), np.float32), first.name))
    with pytest.raises(EstimationError, match="has no weights encoder"):
        restore(again, wider.SerializeToString())


def test_networks_together_give_the_mixture_of_what_they_predict():
    torch.manual_seed(0)
    each = [TouchNetwork(OUTPUTS[2]).eval() for _ in range(3)]
    seen = 3.0 * torch.randn(1, 3, ROWS, COLUMNS)
    with torch.no_grad():
        mean, variance = np.array([[out[0, 0], out[0, 1].exp()] for (out,) in (one(seen) for one in each)]).T
    ((found,),) = session(exported(Together(each))).run(None, {"difference": seen.numpy()})  # type: ignore[misc]
    np.testing.assert_allclose(found, [mean.mean(), np.log(variance.mean() + mean.var())], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("recordings_of", "held"), [(np.repeat(np.arange(20), 3), 3), (np.repeat(np.arange(5), 12), 9)]
)
def test_recordings_or_contacts_are_held_out_whole(recordings_of, held):
    given = samples([15] * 60, recordings=recordings_of)
    kept, out = split(given, 0.15, np.random.default_rng(0), TrainSettings())
    by = "recording" if len(set(recordings_of)) >= 10 else "episode"
    assert not set(getattr(kept, by)) & set(getattr(out, by)) and len(set(getattr(out, by))) == held
    both = np.concatenate([part.difference[:, 0, 0, 0] for part in (kept, out)])
    np.testing.assert_array_equal(np.sort(both), np.arange(len(given)))


@pytest.mark.parametrize("told", [1.0, 0.25])
def test_white_noise_is_calibrated(told):
    rng = np.random.default_rng(0)
    variance = rng.uniform(0.1, 3.0, COUNT)
    found = spread_of(rng.normal(0.0, np.sqrt(variance)), told * variance, EPISODE)
    assert found.scale == pytest.approx(1.0 / told, rel=0.03) and found.together == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("r", [0.3, 0.5])
def test_correlated_errors_count_for_less(r):
    # x_t = r x_t-1 + w has correlations r^k, whose sum over all k is (1 + r) / (1 - r); here anew in each contact.
    error = np.random.default_rng(1).normal(size=(COUNT // 300, 300))
    error[:, 1:] *= np.sqrt(1.0 - r**2)
    for t in range(1, 300):
        error[:, t] += r * error[:, t - 1]
    found = spread_of(error.ravel(), np.ones(COUNT), EPISODE)
    assert found.scale == pytest.approx(1.0, abs=0.05)
    assert found.together == pytest.approx((1.0 + r) / (1.0 - r), rel=0.1)


def test_no_variance_is_reduced():
    error, one = np.random.default_rng(0).normal(size=COUNT), np.ones(COUNT)
    found = measure_spread({"direction": (0.5 * error, one, EPISODE), "turn": (2.0 * error, one, EPISODE)})
    assert found["direction"].scale == 1.0 and found["turn"].scale == pytest.approx(4.0, rel=0.05)


def test_coverage_of_a_gaussian():
    error = norm.ppf((np.arange(10_000) + 0.5) / 10_000)
    assert coverage(3.0 * error, np.full(10_000, 9.0)) == pytest.approx({0.68: 0.68, 0.95: 0.95}, abs=2e-4)


def test_turns_have_no_offset():
    # (1 / 1 + 4 / 0.5) / (1 / 1 + 1 / 0.5) = 3; of the other contact, past half a turn, (3 + 2 pi - 3) / 2.
    contact = np.array([4, 4, 7, 7])
    found = without_offsets(np.array([1.0, 2.5, 3.0, -3.0]), np.array([1.0, 0.5, 2.0, 2.0]), contact)
    half = np.pi - 3.0
    np.testing.assert_allclose(found, [1.0 - 2.0, 2.5 - 2.0, -half, half])
