"""The networks of a touch model, each with what it is to make small."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from palpate.lab.train.fit import FitSettings, fit
from palpate.lab.train.losses import gaussian_nll, offset_nll
from palpate.lab.train.networks import (
    WIDTH,
    Decoder,
    DirectionNetwork,
    KeypointEncoder,
    PairNetwork,
    TouchNetwork,
    blobs,
    imprint,
)
from palpate.lab.train.pairs import Seen, draw_groups, varied_batch
from palpate.lab.train.samples import Samples
from palpate.types.sensor import SensorProfile

Indices = NDArray[np.int_]
Progress = Callable[[int, str], None]

TOUCH, KEYPOINT = FitSettings(steps=4000), FitSettings(steps=1000)
_GROUPS, _FRAMES, _IMAGES = 24, 8, 128  # in a batch; the cost of a frame is its encoding, so each is in seven pairs
_PRESSES = 48  # in a batch, where there are only some hundred
_HELD_OUT = 4  # batches that the held-out recordings are judged by, always the same
_FOCUS = 1e-3  # weight of an activation that is spread out


class Keypoints(nn.Module):
    """The paper's auto-encoder: image to key point and back, and beside it the classifier of contacts."""

    def __init__(self, width: int = WIDTH) -> None:
        super().__init__()
        self.encoder, self.decoder = KeypointEncoder(width), Decoder()


class Touch(nn.Module):
    """What an image says, and what two say."""

    def __init__(self, tells_place: bool = False, width: int = WIDTH) -> None:
        super().__init__()
        self.image, self.pair = TouchNetwork(tells_place, width), PairNetwork()


def learn_keypoints(
    network: Keypoints,
    train: Samples,
    held_out: Samples,
    sensor: SensorProfile,
    seed: int,
    folder: Path,
    settings: FitSettings = KEYPOINT,
    progress: Progress | None = None,
) -> None:
    """Train the auto-encoder without labels, and its classifier with the kinds of contact.

    The light on its images is as it was: without labels, it takes for touch what changes most.
    """

    def draw(samples: Samples, rng: np.random.Generator) -> Indices:
        return rng.integers(len(samples), size=(_IMAGES, 1))

    def losses(samples: Samples, chosen: Indices, seen: Seen) -> dict[str, Tensor]:
        point, logits, activation = network.encoder.parts(seen.difference)
        restored = network.decoder(blobs(point[:, None]))
        return {
            "reconstruction": ((restored - imprint(seen.difference)) ** 2).mean(),
            "focus": _FOCUS * activation.mean(),
            "kind": nn.functional.cross_entropy(logits, torch.from_numpy(samples.kind[chosen.ravel()])),
        }

    _fit("keypoint", network, draw, losses, train, held_out, sensor, seed, folder, settings, progress, is_lit=False)


def learn_touch(
    network: Touch,
    train: Samples,
    held_out: Samples,
    sensor: SensorProfile,
    seed: int,
    folder: Path,
    settings: FitSettings = TOUCH,
    progress: Progress | None = None,
) -> None:
    """Train direction, turn and pairs together, each by the likelihood of the distribution that it predicts."""

    def draw(samples: Samples, rng: np.random.Generator) -> Indices:
        return draw_groups(samples, _GROUPS, _FRAMES, rng)

    def losses(samples: Samples, chosen: Indices, seen: Seen) -> dict[str, Tensor]:
        direction, turn, descriptor, *place = network.image(seen.difference)
        angle = seen.direction(samples.direction[chosen]).ravel()
        yaw = np.unwrap(samples.yaw[chosen], axis=1)
        yaw = seen.turn(yaw - yaw[:, :1])
        turn, descriptor = turn.unflatten(0, chosen.shape), descriptor.unflatten(0, chosen.shape)
        i, j = torch.triu_indices(_FRAMES, _FRAMES, 1)
        pair = network.pair(descriptor[:, i].flatten(0, 1), descriptor[:, j].flatten(0, 1))
        places = 1e2 * seen.place(samples.place[chosen]).ravel()
        return {
            **({"place": gaussian_nll(place[0][:, 0] - places, place[0][:, 1])} if place else {}),
            "direction": gaussian_nll(direction[:, 0] - angle, direction[:, 1]),
            "turn": offset_nll(yaw - turn[..., 0], turn[..., 1]),
            "pair": gaussian_nll(pair[:, 0] - (yaw[:, j] - yaw[:, i]).flatten(), pair[:, 1]),
        }

    _fit("touch", network, draw, losses, train, held_out, sensor, seed, folder, settings, progress)


def learn_direction(
    network: DirectionNetwork,
    train: Samples,
    held_out: Samples,
    sensor: SensorProfile,
    seed: int,
    folder: Path,
    settings: FitSettings,
    progress: Progress | None = None,
) -> None:
    """Train direction alone, on presses that have nothing to do with one another."""

    def draw(samples: Samples, rng: np.random.Generator) -> Indices:
        return rng.integers(len(samples), size=(_PRESSES, 1))

    def losses(samples: Samples, chosen: Indices, seen: Seen) -> dict[str, Tensor]:
        direction = network(seen.difference)
        angle = seen.direction(samples.direction[chosen]).ravel()
        return {"direction": gaussian_nll(direction[:, 0] - angle, direction[:, 1])}

    _fit("direction", network, draw, losses, train, held_out, sensor, seed, folder, settings, progress)


def _fit(
    name: str,
    network: nn.Module,
    draw: Callable[[Samples, np.random.Generator], Indices],
    losses: Callable[[Samples, Indices, Seen], dict[str, Tensor]],
    train: Samples,
    held_out: Samples,
    sensor: SensorProfile,
    seed: int,
    folder: Path,
    settings: FitSettings,
    progress: Progress | None,
    is_lit: bool = True,
) -> None:
    def drawn(rng: np.random.Generator) -> tuple[Indices, Seen]:
        chosen = draw(train, rng)
        return chosen, varied_batch(train, chosen, sensor, rng, is_lit)

    def judged() -> dict[str, Tensor]:
        rng = np.random.default_rng(0)
        drawn = [draw(held_out, rng) for _ in range(_HELD_OUT)]
        found = [losses(held_out, chosen, varied_batch(held_out, chosen, sensor, rng, is_lit)) for chosen in drawn]
        return {key: torch.stack([each[key] for each in found]).mean() for key in found[0]}

    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    fit(name, network, drawn, lambda batch: losses(train, *batch), judged, settings, seed, folder, progress)
