"""What training makes small, the networks, and the descent."""

import csv
from typing import Any

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal, norm
from torch import nn

from palpate.errors import EstimationError, FileError
from palpate.lab.train.fit import FitSettings, fit
from palpate.lab.train.losses import gaussian_nll, offset_nll
from palpate.lab.train.networks import (
    DESCRIPTOR,
    MAP,
    Decoder,
    KeypointEncoder,
    PairNetwork,
    TouchNetwork,
    blobs,
    gaussian,
    imprint,
    keypoint,
)
from palpate.lab.train.scores import log_likelihood
from palpate.touch.model import KINDS


def drawn(*size: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*size, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


# --- losses ---


def test_gaussian_nll_is_that_of_scipy():
    error, log_variance = drawn(50), 2.0 * drawn(50, seed=1)
    wanted = -norm.logpdf(error.numpy(), scale=np.exp(0.5 * log_variance.numpy())).mean()
    assert float(gaussian_nll(error, log_variance)) == pytest.approx(wanted)
    assert log_likelihood(error.numpy(), log_variance.exp().numpy()) == pytest.approx(-wanted)
    assert log_likelihood(error.numpy(), 0.3) == pytest.approx(norm.logpdf(error.numpy(), scale=0.3**0.5).mean())


@pytest.mark.parametrize("frames", [2, 3, 8])
def test_offset_nll_is_that_of_differences(frames):
    # An offset with a flat prior is what differences of frames do not see: their density is the integral over it.
    error, log_variance = drawn(5, frames), 2.0 * drawn(5, frames, seed=1)
    differencing: Any = np.diff(np.eye(frames), axis=0)
    densities = [
        multivariate_normal(cov=differencing @ np.diag(s) @ differencing.T).logpdf(differencing @ e)
        for e, s in zip(error.numpy(), np.exp(log_variance.numpy()), strict=True)
    ]
    assert float(offset_nll(error, log_variance)) == pytest.approx(-np.mean(densities) / (frames - 1))


def test_offset_nll_does_not_see_an_offset():
    error, log_variance = drawn(5, 6), drawn(5, 6, seed=1)
    shifted = error + drawn(5, 1, seed=2)
    assert float(offset_nll(shifted, log_variance)) == pytest.approx(float(offset_nll(error, log_variance)))
    bent = error + 0.1 * torch.arange(6)
    assert abs(float(offset_nll(bent, log_variance) - offset_nll(error, log_variance))) > 1e-3


# --- networks ---


def test_keypoint_finds_a_blob():
    # Columns are first: a blob in column 12 and row 3 of 16 cells, whose middles are at (2 i + 1) / 16 - 1.
    column, row = np.meshgrid(np.arange(16), np.arange(16))
    activation = torch.from_numpy(np.exp(-((column - 12.0) ** 2 + (row - 3.0) ** 2) / 2.0))[None, None]
    np.testing.assert_allclose(keypoint(activation)[0, 0], [25 / 16 - 1, 7 / 16 - 1], atol=2e-3)
    assert keypoint(torch.ones(2, 3, 8, 16)).abs().max() < 1e-6  # the middle is 0
    alone = torch.zeros(1, 1, 8, 4)
    alone[..., 7, 0] = 1.0  # the last row of 8, the first column of 4
    np.testing.assert_allclose(keypoint(alone)[0, 0], [1 / 4 - 1, 15 / 8 - 1], atol=1e-5)


def test_blobs_are_the_inverse():
    places = 0.8 * torch.rand(20, 3, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64) - 0.4
    maps = blobs(places)
    assert maps.shape == (20, 3, *MAP)
    np.testing.assert_allclose(keypoint(maps), places, atol=0.01)  # a cell is 0.06 wide and 0.25 high
    # Its spread is a tenth of the image either way: 0.2, where the image is 2 wide and 2 high.
    fine = blobs(torch.zeros(1, 1, 2, dtype=torch.float64), (100, 200))[0, 0]
    for axis, count in ((0, 200), (1, 100)):
        at = (torch.arange(count) + 0.5) * (2.0 / count) - 1.0
        weight = fine.sum(dim=axis) / fine.sum()
        assert float((weight * at**2).sum()) == pytest.approx(0.2**2, rel=1e-3)
    assert float(fine.max()) == pytest.approx(1.0, abs=0.01)


def test_an_imprint_is_without_what_is_faint_around_it():
    difference = torch.full((1, 3, 32, 128), 0.05)
    difference[0, :, 10:20, 40:80] = -1.0
    seen = imprint(difference)
    # In the middle of the imprint all around has a strength of 1: 5^4 = 625 of 626 are left; far from it 1 of 257.
    assert seen[0, 1, 15, 60] == pytest.approx(-625 / 626)
    assert seen[0, 1, 2, 10] == pytest.approx(0.05 / 257, rel=1e-4)
    assert seen[0, 1, 0, 0] == pytest.approx(0.05 / 257, rel=1e-4)  # at a border, only what there is counts
    # One row off it, a third of the rows and all columns around are imprint: the mean is (1 + 2 * 0.05) / 3.
    fourth = ((1.1 / 3) / 0.2) ** 4
    assert seen[0, 1, 9, 60] == pytest.approx(0.05 * fourth / (1 + fourth))


def test_exchanging_images_changes_the_sign_of_what_the_pair_network_tells():
    torch.manual_seed(0)
    network = PairNetwork().double()
    earlier, later = drawn(30, DESCRIPTOR), drawn(30, DESCRIPTOR, seed=1)
    there, back = network(earlier, later), network(later, earlier)
    assert there[:, 0].abs().max() > 1e-3
    torch.testing.assert_close(there[:, 0], -back[:, 0])
    torch.testing.assert_close(there[:, 1], back[:, 1])
    assert there[:, 1].std() > 1e-3
    assert not network(earlier, earlier)[:, 0].any()


def test_predicted_deviations_stay_within_their_limits():
    said = torch.tensor([[0.3, -1e9], [7.0, 1e9], [-2.0, 0.0], [0.0, -4.9]])
    found = gaussian(said)
    torch.testing.assert_close(found[:, 0], said[:, 0])
    # Logarithms of standard deviations: from -6 to 1, and -2.5 in the middle, which 0 says.
    assert (0.5 * found[:3, 1]).tolist() == pytest.approx([-6.0, 1.0, -2.5])
    # Between them nothing is cut off: what is said always matters.
    free = torch.linspace(-20.0, 10.0, 50, dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(gaussian(torch.stack([free, free], dim=1))[:, 1].sum(), free)
    assert (slope > 0.0).all()


def test_networks_have_the_shapes_they_say():
    difference = torch.randn(2, 3, 32, 128)
    torch.manual_seed(0)
    point, logits, activation = KeypointEncoder().eval().parts(difference)
    assert (point.shape, logits.shape, activation.shape) == ((2, 2), (2, len(KINDS)), (2, 1, *MAP))
    assert (activation > 0.0).all() and (point.abs() < 1.0).all()
    torch.testing.assert_close(point, keypoint(activation)[:, 0])
    assert Decoder()(activation).shape == difference.shape
    assert [part.shape for part in TouchNetwork().eval()(difference)] == [(2, 2), (2, 2), (2, DESCRIPTOR)]


def test_the_classifier_does_not_shape_the_key_point():
    encoder = KeypointEncoder()
    logits = encoder(torch.randn(2, 3, 32, 128))[1]
    logits.sum().backward()
    assert all(weight.grad is None for weight in (*encoder.encoder.parameters(), *encoder.heat.parameters()))
    assert all(weight.grad is not None for weight in encoder.classifier.parameters())


# --- the descent ---


class CutOffError(Exception):
    pass


def points(rng: np.random.Generator) -> tuple[Any, torch.Tensor]:
    chosen = rng.integers(100, size=16)
    return chosen, torch.from_numpy(rng.normal(size=(16, 2)).astype(np.float32))


def line(seed: int = 0) -> nn.Module:
    torch.manual_seed(seed)
    return nn.Sequential(nn.Linear(2, 4), nn.BatchNorm1d(4), nn.Linear(4, 1))


def descend(network: nn.Module, folder: Any, stop: int | None = None, seed: int = 3, **changes: Any) -> list[int]:
    """Fit y = 3 a - b; raise CutOffError at a step; return the steps at which progress was shown."""
    shown: list[int] = []
    steps = iter(range(10**6))

    def losses(batch: tuple[Any, torch.Tensor]) -> dict[str, torch.Tensor]:
        if next(steps) == stop:
            raise CutOffError
        _, x = batch
        error = network(x)[:, 0] - 3.0 * x[:, 0] + x[:, 1]
        return {"square": (error**2).mean(), "size": 0.01 * error.abs().mean()}

    settings = FitSettings(**({"steps": 60, "check": 10, "rate": 0.05} | changes))
    fit(
        "line",
        network,
        points,
        losses,
        lambda: losses(points(np.random.default_rng(9))),
        settings,
        seed,
        folder,
        lambda step, said: shown.append(step),
    )
    return shown


def state(network: nn.Module) -> dict[str, torch.Tensor]:
    return {key: value.clone() for key, value in network.state_dict().items()}


def assert_same(found: dict[str, torch.Tensor], wanted: dict[str, torch.Tensor]) -> None:
    torch.testing.assert_close(found, wanted, rtol=0.0, atol=0.0)


def rows(path: Any) -> list[list[str]]:
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_a_descent_that_was_cut_off_ends_where_another_ends(tmp_path):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir()
    parts.mkdir()
    wanted = line()
    assert descend(wanted, whole) == [10, 20, 30, 40, 50, 60]
    with pytest.raises(CutOffError):
        descend(line(), parts, stop=37)  # 30 steps and 3 looks are the 33 first, so the checkpoint is of step 30
    found = line(seed=8)  # its weights are those of the checkpoint
    assert descend(found, parts) == [40, 50, 60]
    assert_same(state(found), state(wanted))
    assert rows(parts / "line.csv") == rows(whole / "line.csv")
    assert descend(found, parts) == []  # there is nothing left to do
    assert_same(state(found), state(wanted))
    assert not found.training
    assert sorted(path.name for path in parts.iterdir()) == ["line.csv", "line.pt"]


def test_the_log_has_a_row_for_each_look(tmp_path):
    descend(line(), tmp_path, steps=25)
    head, *body = rows(tmp_path / "line.csv")
    assert head == ["step", "batch_square", "batch_size", "held_out_square", "held_out_size"]
    assert [row[0] for row in body] == ["10", "20", "25"]  # the last one, whole tens or not
    values = np.array(body, float)
    assert values[-1, 3] < values[0, 3]


def test_an_early_stop_keeps_the_best(tmp_path):
    network = nn.Linear(1, 1)
    script, kept = iter([3.0, 1.0, 2.0, 1.0, 1.5]), []

    def held_out() -> dict[str, torch.Tensor]:
        kept.append(state(network))
        return {"scripted": torch.tensor(next(script))}

    def losses(batch: Any) -> dict[str, torch.Tensor]:
        return {"square": ((network(torch.ones(1, 1)) - 5.0) ** 2).mean()}

    settings = FitSettings(steps=100, check=2, patience=3)
    fit("early", network, points, losses, held_out, settings, 0, tmp_path)
    # 3 looks without less than 1 after the second: steps 6, 8 and 10.
    assert len(kept) == 5 and rows(tmp_path / "early.csv")[-1][0] == "10"
    assert_same(state(network), kept[1])
    assert not torch.equal(kept[1]["weight"], kept[-1]["weight"])
    # Going on does not go on: it had stopped.
    fit("early", network, points, losses, held_out, settings, 0, tmp_path)
    assert len(kept) == 5
    assert_same(state(network), kept[1])


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_loss_that_is_not_finite_stops(tmp_path, wrong):
    network, before = nn.Linear(1, 1), []

    def losses(batch: Any) -> dict[str, torch.Tensor]:
        before.append(state(network))
        square = ((network(torch.ones(1, 1)) - 5.0) ** 2).mean()
        return {"good": square, "bad": square * (wrong if len(before) == 8 else 1.0)}

    with pytest.raises(EstimationError, match=rf"training of odd at step 7: good [\d.]+, bad {wrong}; .*odd-failed.pt"):
        fit("odd", network, points, losses, lambda: {}, FitSettings(steps=20), 5, tmp_path)
    saved = torch.load(tmp_path / "odd-failed.pt", weights_only=True)
    chosen, seen = points(np.random.default_rng([5, 7]))
    assert saved["step"] == 7 and saved["chosen"].tolist() == chosen.tolist()
    assert torch.equal(saved["batch"], seen)
    assert_same(saved["network"], before[-1])
    assert_same(state(network), before[-1])


def test_a_checkpoint_of_something_else(tmp_path):
    descend(line(), tmp_path, steps=10)
    with pytest.raises(FileError, match=r"line.pt: was begun with seed 3, going on with seed 4 would mix the two"):
        descend(line(), tmp_path, seed=4)
    with pytest.raises(FileError, match=r"line.pt: was begun with steps 10, going on with steps 60 would mix the two"):
        descend(line(), tmp_path)
    with pytest.raises(FileError, match=r"line.pt: is not a checkpoint that can be gone on from"):
        descend(nn.Sequential(nn.Linear(2, 1)), tmp_path)
    (tmp_path / "line.pt").write_bytes((tmp_path / "line.pt").read_bytes()[:500])
    with pytest.raises(FileError, match=r"line.pt: is not a checkpoint that can be gone on from"):
        descend(line(), tmp_path)
