"""The touch network, the losses of training, and the descent."""

from typing import Any

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal, norm
from torch import nn

from palpate import EstimationError, FileError
from palpate_lab.train.fit import FitSettings, fit, gaussian_nll, offset_nll
from palpate_lab.train.networks import gaussian, imprint, keypoint


def drawn(*size: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*size, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_gaussian_nll_equals_scipy():
    error, log_variance = drawn(50), 2.0 * drawn(50, seed=1)
    wanted = -norm.logpdf(error.numpy(), scale=np.exp(0.5 * log_variance.numpy())).mean()
    assert float(gaussian_nll(error, log_variance)) == pytest.approx(wanted)


@pytest.mark.parametrize("frames", [2, 3, 8])
def test_offset_nll_is_the_density_of_frames_with_a_common_offset(frames):
    error, log_variance, among = drawn(5, frames), 2.0 * drawn(5, frames, seed=1), torch.ones(5, frames)
    among[2, 0] = 0.0
    wanted = 0.0
    for e, s, counts in zip(error.numpy(), np.exp(log_variance.numpy()), among.numpy() > 0.0, strict=True):
        covariance: Any = np.diag(s[counts]) + 0.3**2
        wanted -= multivariate_normal(cov=covariance).logpdf(e[counts])
    assert float(offset_nll(error, log_variance, 0.3, among)) == pytest.approx(wanted / float(among.sum()))
    # With a wide prior an offset changes nothing.
    found = offset_nll(error, log_variance, 1e4)
    assert float(offset_nll(error + drawn(5, 1, seed=2), log_variance, 1e4)) == pytest.approx(float(found), abs=1e-6)


def test_keypoint_is_the_centre_of_activation():
    # Columns are first: a blob in column 12 and row 3 of 16 cells, whose centres are at (2 i + 1) / 16 - 1.
    column, row = np.meshgrid(np.arange(16), np.arange(16))
    activation = torch.from_numpy(np.exp(-((column - 12.0) ** 2 + (row - 3.0) ** 2) / 2.0))[None, None]
    np.testing.assert_allclose(keypoint(activation)[0, 0], [25 / 16 - 1, 7 / 16 - 1], atol=2e-3)
    assert keypoint(torch.ones(2, 3, 8, 16)).abs().max() < 1e-6


def test_imprint_drops_faint_surroundings():
    difference = torch.full((1, 3, 32, 128), 0.05)
    difference[0, :, 10:20, 40:80] = -1.0
    seen = imprint(difference)
    # Amid the imprint the strength around is 1: 5^4 = 625 of 626 are left; far from it 1 of 257.
    assert seen[0, 1, 15, 60] == pytest.approx(-625 / 626)
    assert seen[0, 1, 2, 10] == pytest.approx(0.05 / 257, rel=1e-4)
    # One row off it, a third of the rows around are imprint: the mean is (1 + 2 * 0.05) / 3.
    fourth = ((1.1 / 3) / 0.2) ** 4
    assert seen[0, 1, 9, 60] == pytest.approx(0.05 * fourth / (1 + fourth))


def test_predicted_deviations_stay_within_limits():
    first = [[0.3, -1e9], [70.0, 1e9], [-2.0, 0.0]]
    second = [[0.0, 1e9, 40.0], [0.0, 0.0, 50.0], [0.0, -1e9, 60.0]]
    found, other = gaussian(torch.cat([torch.tensor(first), torch.tensor(second)], dim=1), [2, 3])
    assert (0.5 * found[:, 1]).tolist() == pytest.approx([-6.0, 1.0, -2.5])
    assert (0.5 * other[:, 1]).tolist() == pytest.approx([1.0, -2.5, -6.0])
    assert found[:, 0].tolist() == pytest.approx([0.3, 70.0, -2.0]) and other[:, 2].tolist() == [40.0, 50.0, 60.0]


def points(rng: np.random.Generator) -> torch.Tensor:
    return torch.from_numpy(rng.normal(size=(16, 2)).astype(np.float32))


def line(seed: int = 0) -> nn.Module:
    torch.manual_seed(seed)
    return nn.Sequential(nn.Linear(2, 4), nn.BatchNorm1d(4), nn.Linear(4, 1))


def descend(network: nn.Module, folder: Any, stop: int | None = None, seed: int = 3, **changes: Any) -> list[int]:
    """Fit y = 3 a - b; interrupt at a call of the losses; return the steps of which progress was shown."""
    shown: list[int] = []
    calls = iter(range(10**6))

    def losses(x: torch.Tensor) -> dict[str, torch.Tensor]:
        if next(calls) == stop:
            raise KeyboardInterrupt
        error = network(x)[:, 0] - 3.0 * x[:, 0] + x[:, 1]
        return {"square": (error**2).mean(), "size": 0.01 * error.abs().mean()}

    settings = FitSettings(**({"steps": 60, "check": 10, "rate": 0.05} | changes))
    held_out = points(np.random.default_rng(9))
    progress = lambda step, _: shown.append(step)  # noqa: E731
    fit("line", network, points, losses, lambda: losses(held_out), settings, seed, folder, progress)
    return shown


def same(found: nn.Module, wanted: nn.Module) -> bool:
    return all(
        torch.equal(a, b) for a, b in zip(found.state_dict().values(), wanted.state_dict().values(), strict=True)
    )


def test_an_interrupted_descent_ends_like_another(tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir()
    parts.mkdir()
    wanted, found = line(), line(seed=8)  # the checkpoint has the weights
    assert descend(wanted, whole) == list(range(1, 61))
    with pytest.raises(KeyboardInterrupt):
        descend(line(), parts, stop=37)  # 30 steps and 3 evaluations are the first 33, so the checkpoint is of step 30
    assert descend(found, parts) == list(range(31, 61))  # goes on where the checkpoint is
    assert same(found, wanted) and not found.training


def test_an_early_stop_keeps_the_best(tmp_path):
    network = nn.Linear(1, 1)
    script, kept = iter([3.0, 1.0, 2.0, 1.0, 1.5]), []

    def held_out() -> dict[str, torch.Tensor]:
        kept.append(float(network.weight.detach()))
        return {"scripted": torch.tensor(next(script))}

    losses = lambda _: {"square": ((network(torch.ones(1, 1)) - 5.0) ** 2).mean()}  # noqa: E731
    fit("early", network, points, losses, held_out, FitSettings(steps=100, check=2, patience=3), 0, tmp_path)
    assert len(kept) == 5 and float(network.weight.detach()) == kept[1] != kept[-1]


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_loss_that_is_not_finite_is_an_error(tmp_path, wrong):
    network = nn.Linear(1, 1)
    losses = lambda _: {"good": network(torch.ones(1, 1)).mean() ** 2, "bad": torch.tensor(wrong)}  # noqa: E731
    with pytest.raises(EstimationError, match=rf"training of odd at step 0: good [\d.e-]+, bad {wrong}; losses must"):
        fit("odd", network, points, losses, lambda: {}, FitSettings(steps=20), 5, tmp_path)


def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    descend(line(), tmp_path, steps=10)
    with pytest.raises(FileError, match=r"line.pt: was begun with seed 3, and cannot continue with 4"):
        descend(line(), tmp_path, steps=10, seed=4)
    with pytest.raises(FileError, match=r"line.pt: was begun with steps 10, and cannot continue with 60"):
        descend(line(), tmp_path)
    (tmp_path / "line.pt").write_bytes((tmp_path / "line.pt").read_bytes()[:500])
    with pytest.raises(FileError, match=r"line.pt: is not a checkpoint that can be continued"):
        descend(line(), tmp_path)
