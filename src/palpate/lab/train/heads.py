"""The paper's models of relative pose, on features of two images: constant, linear, nonlinear (Table II).

All tell the sine of the yaw by which the sensor turned, conditioned on the kind of contact by an outer product. The
paper sums the loss over both orders of a pair; here exchanging the images changes the sign of what is told, which is
where that loss leads, and which makes the constant model's mean zero.
"""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

Array = NDArray[np.float64]

_RIDGE = 1e-4  # times the mean square of the inputs
_HIDDEN, _STEPS, _BATCH, _RATE = 32, 3000, 1024, 1e-3


def fit_linear(earlier: Array, later: Array, kinds: Array, sine: Array) -> Array:
    """Return weights (C, F) of features (P, F) of both images, conditioned on kinds (P, C), by least squares."""
    inputs = _conditioned(later - earlier, kinds)
    square = inputs.T @ inputs / len(inputs)
    ridge = _RIDGE * np.trace(square) / len(square) * np.eye(len(square))
    weights = np.linalg.solve(square + ridge, inputs.T @ sine / len(inputs))
    return weights.reshape(kinds.shape[1], earlier.shape[1])


def linear(weights: Array, earlier: Array, later: Array, kinds: Array) -> Array:
    """Return the sine (P,) that weights (C, F) tell."""
    return np.sum((later - earlier) * (kinds @ weights), axis=1)


def fit_nonlinear(
    earlier: Array, later: Array, kinds: Array, sine: Array, seed: int
) -> Callable[[Array, Array, Array], Array]:
    """Return a function of features (P, F) of both images and kinds (P, C) that tells the sine: one hidden layer."""
    rng = np.random.default_rng(seed)
    torch.manual_seed(seed)
    mean = earlier.mean(axis=0)
    deviation = earlier.std(axis=0) + 1e-9
    width = 2 * earlier.shape[1] * kinds.shape[1]
    layers = nn.Sequential(nn.Linear(width, _HIDDEN), nn.ReLU(), nn.Linear(_HIDDEN, 1))

    def told(earlier: Array, later: Array, kinds: Array) -> torch.Tensor:
        first, second = (earlier - mean) / deviation, (later - mean) / deviation
        there, back = (
            torch.from_numpy(_conditioned(np.concatenate(order, axis=1), kinds).astype(np.float32))
            for order in ((first, second), (second, first))
        )
        return (layers(there) - layers(back))[:, 0]

    optimiser = torch.optim.Adam(layers.parameters(), lr=_RATE)
    for _ in range(_STEPS):
        chosen = rng.integers(len(sine), size=_BATCH)
        wanted = torch.from_numpy(sine[chosen].astype(np.float32))
        loss = ((told(earlier[chosen], later[chosen], kinds[chosen]) - wanted) ** 2).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()

    def nonlinear(earlier: Array, later: Array, kinds: Array) -> Array:
        with torch.no_grad():
            return told(earlier, later, kinds).numpy().astype(np.float64)

    return nonlinear


def _conditioned(features: Array, kinds: Array) -> Array:
    """Outer product of features (P, F) and kinds (P, C): (P, C F)."""
    return (kinds[:, :, None] * features[:, None, :]).reshape(len(features), -1)
