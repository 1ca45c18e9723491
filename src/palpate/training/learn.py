"""The networks of a touch model, each with what it is to make small."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from palpate.training.fit import FitSettings, fit
from palpate.training.losses import gaussian_nll, offset_nll
from palpate.training.networks import Decoder, KeypointEncoder, PairNetwork, TouchNetwork, blobs
from palpate.training.pairs import draw_groups, varied_batch
from palpate.training.samples import Samples

Indices = NDArray[np.int_]
Progress = Callable[[int, str], None]
Seen = tuple[Tensor, Tensor]
"""Differences (B, 3, 32, 128) and the sign of angles for each group of them; see `varied_batch`."""

TOUCH, KEYPOINT = FitSettings(steps=3000), FitSettings(steps=1000)
_GROUPS, _FRAMES, _IMAGES = 24, 8, 128  # in a batch; the cost of a frame is its encoding, so each is in seven pairs
_HELD_OUT = 4  # batches that the held-out recordings are judged by, always the same
_FOCUS = 1e-3  # weight of an activation that is spread out


class Keypoints(nn.Module):
    """The paper's auto-encoder: image to key point and back, and beside it the classifier of contacts."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder, self.decoder = KeypointEncoder(), Decoder()


class Touch(nn.Module):
    """What an image says, and what two say."""

    def __init__(self) -> None:
        super().__init__()
        self.image, self.pair = TouchNetwork(), PairNetwork()


def learn_keypoints(
    network: Keypoints,
    train: Samples,
    held_out: Samples,
    seed: int,
    folder: Path,
    settings: FitSettings = KEYPOINT,
    progress: Progress | None = None,
) -> None:
    """Train the auto-encoder without labels, and its classifier with the kinds of contact."""

    def draw(samples: Samples, rng: np.random.Generator) -> Indices:
        return rng.integers(len(samples), size=(_IMAGES, 1))

    def losses(samples: Samples, chosen: Indices, seen: Seen) -> dict[str, Tensor]:
        difference, _ = seen
        point, logits, activation = network.encoder.parts(difference)
        restored = network.decoder(blobs(point[:, None]))
        return {
            "reconstruction": ((restored - difference) ** 2).mean(),
            "focus": _FOCUS * activation.mean(),
            "kind": nn.functional.cross_entropy(logits, torch.from_numpy(samples.kind[chosen.ravel()])),
        }

    _fit("keypoint", network, draw, losses, train, held_out, seed, folder, settings, progress)


def learn_touch(
    network: Touch,
    train: Samples,
    held_out: Samples,
    seed: int,
    folder: Path,
    settings: FitSettings = TOUCH,
    progress: Progress | None = None,
) -> None:
    """Train direction, turn and pairs together, each by the likelihood of the distribution that it predicts."""

    def draw(samples: Samples, rng: np.random.Generator) -> Indices:
        return draw_groups(samples, _GROUPS, _FRAMES, rng)

    def losses(samples: Samples, chosen: Indices, seen: Seen) -> dict[str, Tensor]:
        difference, sign = seen
        direction, turn, descriptor = network.image(difference)
        angle = (sign[:, None] * torch.from_numpy(samples.direction[chosen].astype(np.float32))).ravel()
        yaw = np.unwrap(samples.yaw[chosen], axis=1)
        yaw = sign[:, None] * torch.from_numpy((yaw - yaw[:, :1]).astype(np.float32))
        turn, descriptor = turn.unflatten(0, chosen.shape), descriptor.unflatten(0, chosen.shape)
        i, j = torch.triu_indices(_FRAMES, _FRAMES, 1)
        pair = network.pair(descriptor[:, i].flatten(0, 1), descriptor[:, j].flatten(0, 1))
        return {
            "direction": gaussian_nll(direction[:, 0] - angle, direction[:, 1]),
            "turn": offset_nll(yaw - turn[..., 0], turn[..., 1]),
            "pair": gaussian_nll(pair[:, 0] - (yaw[:, j] - yaw[:, i]).flatten(), pair[:, 1]),
        }

    _fit("touch", network, draw, losses, train, held_out, seed, folder, settings, progress)


def _fit(
    name: str,
    network: nn.Module,
    draw: Callable[[Samples, np.random.Generator], Indices],
    losses: Callable[[Samples, Indices, Seen], dict[str, Tensor]],
    train: Samples,
    held_out: Samples,
    seed: int,
    folder: Path,
    settings: FitSettings,
    progress: Progress | None,
) -> None:
    def drawn(rng: np.random.Generator) -> tuple[Indices, Seen]:
        chosen = draw(train, rng)
        return chosen, varied_batch(train, chosen, rng)

    def judged() -> dict[str, Tensor]:
        rng = np.random.default_rng(0)
        drawn = [draw(held_out, rng) for _ in range(_HELD_OUT)]
        found = [losses(held_out, chosen, varied_batch(held_out, chosen, rng)) for chosen in drawn]
        return {key: torch.stack([each[key] for each in found]).mean() for key in found[0]}

    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    fit(name, network, drawn, lambda batch: losses(train, *batch), judged, settings, seed, folder, progress)
