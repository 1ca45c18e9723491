"""Gradient descent with an early stop and a checkpoint to continue from; and the losses it minimises."""

import io
import logging
import math
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from palpate.errors import EstimationError, FileError
from palpate.files import whole_file

logger = logging.getLogger(__name__)

Losses = Mapping[str, Tensor]
PACED = 20
"""Steps after which it is known how long all of them take."""


@dataclass(frozen=True)
class FitSettings:
    """Length and rate of a descent."""

    steps: int
    """Most steps."""
    rate: float = 3e-3
    """Largest learning rate; it rises at the beginning and falls to zero at the end."""
    check: int = 100
    """Steps between two evaluations on the held-out recordings."""
    patience: int = 15
    """Evaluations without a better loss before the descent stops: the loss varies while the rate is large."""


def fit(
    name: str,
    network: nn.Module,
    draw: Callable[[np.random.Generator], Any],
    losses: Callable[[Any], Losses],
    held_out: Callable[[], Losses],
    settings: FitSettings,
    seed: int,
    folder: Path,
    progress: Callable[[int, str], None] | None = None,
) -> None:
    """Minimise the sum of losses; the network keeps the weights with the smallest sum on the held-out recordings.

    `draw` draws a batch, `losses` returns the losses on it, `held_out` those on recordings not trained on. `folder`
    takes the checkpoint `<name>.pt`, from which an interrupted run continues. Raises EstimationError where a loss is
    not finite, and FileError on a checkpoint of another run.
    """
    optimiser = torch.optim.AdamW(network.parameters(), lr=settings.rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.rate, total_steps=settings.steps)
    parts = {"network": network, "optimiser": optimiser, "schedule": schedule}
    checkpoint = folder / f"{name}.pt"
    progressed: dict[str, Any] = {"step": 0, "best": math.inf, "waited": 0}
    begun_with = {"seed": seed, "steps": settings.steps}
    if checkpoint.exists():
        progressed = _load(checkpoint, begun_with, parts)
    note = ""  # losses at the last check
    for step in range(progressed["step"], settings.steps):
        if progressed["waited"] >= settings.patience:
            break
        network.train()
        # Each step has its own generator, so that a continued run draws the same batches.
        step_losses = losses(draw(np.random.default_rng([seed, step])))
        _check_finite(f"training of {name} at step {step}", step_losses)
        optimiser.zero_grad()
        torch.stack(list(step_losses.values())).sum().backward()
        nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        if progress:
            progress(step + 1, note)
        if (step + 1) % settings.check and step + 1 < settings.steps:
            continue
        network.eval()
        with torch.no_grad():
            checked = held_out()
        _check_finite(f"training of {name} at step {step}, on the held-out recordings", checked)
        total = sum(map(float, checked.values()))
        progressed["waited"] += 1
        if total < progressed["best"]:
            progressed |= {"best": total, "waited": 0, "best_state": deepcopy(network.state_dict())}
        progressed["step"] = step + 1
        data = io.BytesIO()  # in memory first: on a full disk torch raises an error that does not say so
        torch.save(progressed | begun_with | {key: part.state_dict() for key, part in parts.items()}, data)
        with whole_file(checkpoint, overwrite=True) as part:
            part.write_bytes(data.getvalue())
        note = ", ".join(f"{key} {float(value):.3g}" for key, value in checked.items())
    network.load_state_dict(progressed["best_state"])
    network.eval()


def with_pace(progress: Callable[..., None], total: int) -> Callable[..., None]:
    """Return a progress that says once, after some steps, how long all of them take, if that is over a minute."""
    began: list[tuple[int, float]] = []

    def tell(done: int, note: str = "") -> None:
        progress(done, note)
        began.append((done, monotonic()))
        if len(began) == PACED:
            first, start = began[0]
            minutes = (monotonic() - start) / (done - first) * (total - done) / 60.0
            if minutes > 1.0:
                logger.warning("%d steps take some %.0f minutes; Ctrl-C stops, --resume goes on", total, minutes)

    return tell


def gaussian_nll(error: Tensor, log_variance: Tensor) -> Tensor:
    """Negative log-likelihood of errors under Gaussians, the mean over all."""
    return 0.5 * (error**2 * torch.exp(-log_variance) + log_variance + math.log(2.0 * math.pi)).mean()


def offset_nll(error: Tensor, log_variance: Tensor, offset: float, among: Tensor | None = None) -> Tensor:
    """Negative log-likelihood per frame of errors (G, F) [rad] that share an unknown offset in each group.

    Gaussians with the offset, whose standard deviation is `offset` [rad], integrated out: the variance of a
    `measurements.Turn` or `measurements.ContactCorner`. `among` (G, F) are the frames that count.
    """
    among = torch.ones_like(error) if among is None else among
    weight = torch.exp(-log_variance) * among
    prior = offset**-2.0
    total = weight.sum(dim=1) + prior
    square = (weight * error**2).sum(dim=1) - (weight * error).sum(dim=1) ** 2 / total
    joint = square + (log_variance * among).sum(dim=1) + torch.log(total / prior)
    return 0.5 * (joint.sum() / among.sum().clamp(min=1) + math.log(2.0 * math.pi))


def _check_finite(what: str, losses: Losses) -> None:
    if not all(torch.isfinite(value).all() for value in losses.values()):
        found = ", ".join(f"{key} {float(value.detach()):g}" for key, value in losses.items())
        raise EstimationError(f"{what}: {found}; losses must be finite")


def _load(checkpoint: Path, begun_with: Mapping[str, int], parts: Mapping[str, Any]) -> dict[str, Any]:
    try:
        saved = torch.load(checkpoint, weights_only=True)
        found = {name: saved[name] for name in begun_with}
        if found == begun_with:
            for name, part in parts.items():
                part.load_state_dict(saved[name])
    except Exception as error:  # torch raises many kinds, from zip files to unpickling and weights that do not fit
        raise FileError(f"{checkpoint}: is not a checkpoint that can be continued ({error})") from error
    for name, wanted in begun_with.items():
        if found[name] != wanted:
            raise FileError(f"{checkpoint}: was begun with {name} {found[name]}, and cannot continue with {wanted}")
    return saved
