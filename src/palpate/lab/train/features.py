"""What the networks and the engineered features say of samples, and the models of relative pose fitted to that."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from palpate.lab.train import heads
from palpate.lab.train.learn import Keypoints, Touch
from palpate.lab.train.pairs import batch, draw_pairs, turned
from palpate.lab.train.samples import Samples
from palpate.touch.model import KINDS

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

PAIRS = 100_000
"""Pairs that models of relative pose are fitted to."""
_BATCH = 256


@dataclass(frozen=True, eq=False)
class Features:
    """What is seen in samples, N of them."""

    keypoint: Array
    """Column and row of the key point, (N, 2), -1 to 1."""
    kinds: Array
    """How likely each of KINDS is, (N, C)."""
    ellipse: Array
    """Engineered features, (N, 6), see `touch.ellipse`; where no patch is found, the mean of the others."""
    direction: Array
    """Angle on the tip, mean and variance, (N, 2) [rad], [rad^2]."""
    turn: Array
    """Yaw up to an offset, mean and variance, (N, 2) [rad], [rad^2]."""
    descriptor: NDArray[np.float32]
    """(N, D)"""
    place: Array | None = None
    """Where along y a flat pad is touched, mean and variance, (N, 2) [m], [m^2]; None of a round tip."""


def features_of(samples: Samples, keypoints: Keypoints, touch: Touch) -> Features:
    """Return the features of samples."""
    keypoints.eval()
    touch.eval()
    parts = []
    with torch.no_grad():
        for begin in range(0, len(samples), _BATCH):
            difference = batch(samples, np.arange(begin, min(begin + _BATCH, len(samples))))
            point, logits = keypoints.encoder(difference)
            parts.append((point, logits.softmax(dim=1), *touch.image(difference)))
    seen = (torch.cat(column).numpy() for column in zip(*parts, strict=True))
    point, kinds, direction, turn, descriptor, *place = seen
    there = ~np.isnan(samples.ellipse)
    mean = np.mean(samples.ellipse, axis=0, where=there) if there.any() else 0.0
    ellipse = np.where(there, samples.ellipse, mean)
    return Features(
        point.astype(np.float64),
        kinds.astype(np.float64),
        ellipse,
        _with_variance(direction),
        _with_variance(turn),
        descriptor,
        _with_variance(place[0]) * (1e-2, 1e-4) if place else None,
    )


@dataclass(frozen=True, eq=False)
class PairModels:
    """The models of relative pose by name: each tells the sine of the turn (P,) of pairs of samples."""

    linear: Array
    """Weights of the linear model on key points, (C, 2)."""
    tell: dict[str, Callable[[Features, Indices, Indices], Array]]
    """All of them, in the order of the paper's Table II and then ours."""


def fit_pair_models(samples: Samples, seen: Features, touch: Touch, seed: int) -> PairModels:
    """Fit the paper's models to samples, and put ours beside them."""
    earlier, later = draw_pairs(samples, PAIRS, np.random.default_rng(seed))
    sine = np.sin(turned(samples, earlier, later))

    def of(seen: Features, name: str, i: Indices, j: Indices) -> tuple[Array, Array, Array]:
        features = getattr(seen, name)
        return features[i], features[j], 0.5 * (seen.kinds[i] + seen.kinds[j])

    tell: dict[str, Callable[[Features, Indices, Indices], Array]] = {"constant": lambda seen, i, j: np.zeros(len(i))}
    weights = {name: heads.fit_linear(*of(seen, name, earlier, later), sine) for name in ("ellipse", "keypoint")}
    nonlinear = {
        name: heads.fit_nonlinear(*of(seen, name, earlier, later), sine, seed) for name in ("ellipse", "keypoint")
    }
    for name, words in (("ellipse", "engineered"), ("keypoint", "learnt")):
        tell[f"linear {words}"] = lambda seen, i, j, name=name: heads.linear(weights[name], *of(seen, name, i, j))
        tell[f"nonlinear {words}"] = lambda seen, i, j, name=name: nonlinear[name](*of(seen, name, i, j))
    tell["descriptor pair"] = lambda seen, i, j: np.sin(told_by_pair(touch, seen, i, j)[0])
    tell["image turn"] = lambda seen, i, j: np.sin(seen.turn[j, 0] - seen.turn[i, 0])
    return PairModels(weights["keypoint"], tell)


def told_by_pair(touch: Touch, seen: Features, earlier: Indices, later: Indices) -> tuple[Array, Array]:
    """Return the turns (P,) [rad] that the pair network tells of samples, and their variances (P,) [rad^2]."""
    with torch.no_grad():
        told = touch.pair(torch.from_numpy(seen.descriptor[earlier]), torch.from_numpy(seen.descriptor[later]))
    both = _with_variance(told.numpy())
    return both[:, 0], both[:, 1]


def kind_of_pairs(samples: Samples, earlier: Indices, later: Indices) -> dict[str, NDArray[np.bool_]]:
    """Return for each kind, and for "combined", which pairs are of it with both their images."""
    chosen = {kind: (samples.kind[earlier] == i) & (samples.kind[later] == i) for i, kind in enumerate(KINDS)}
    return {**chosen, "combined": np.ones(len(earlier), dtype=bool)}


def _with_variance(told: NDArray[np.float32]) -> Array:
    return np.stack([told[:, 0], np.exp(told[:, 1].astype(np.float64))], axis=1).astype(np.float64)
