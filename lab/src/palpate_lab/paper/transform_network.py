"""Relative transform between two images (paper Sec. IV-A, transform prediction network), and Table II.

Features of both images, expanded by an outer product with the class vector, are mapped to the sine of the sensor's turn
on the object. The authors predict x, y, cosine and sine with weights (0, 0, 0, 1), so the sine is all that counts. The
loss is summed over both orders of a pair (Eq. 4); with the weights their mean over four outputs is half of the mean
square error of the sine, which Table II shows here as well.
"""

from collections.abc import Callable

import numpy as np
import torch
from torch import nn

from palpate.arrays import Array

Pairs = tuple[Array, Array, Array]
"""Features of the earlier and of the later images (P, F) each, and class probabilities (P, C)."""
Predict = Callable[[Pairs], Array]
"""Sine of the turn (P,) of pairs."""


def expanded(pairs: Pairs) -> Array:
    """Return the inputs (P, 2 F C + C) of the regression: features of both images and a bias, for each class."""
    earlier, later, classes = pairs
    inputs = np.column_stack([earlier, later, np.ones(len(earlier))])
    return (classes[:, :, None] * inputs[:, None, :]).reshape(len(inputs), -1)


def reversed_pairs(pairs: Pairs) -> Pairs:
    """Return the pairs with their images exchanged: the inverse transforms of Eq. 4."""
    return pairs[1], pairs[0], pairs[2]


def without_class(pairs: Pairs) -> Pairs:
    """Return the pairs as if all were of one class."""
    return pairs[0], pairs[1], np.ones((len(pairs[0]), 1))


def fit_linear(pairs: Pairs, sine: Array) -> Array:
    """Return the weights (2 F C + C,) of the linear network, by least squares over both orders."""
    inputs = np.concatenate([expanded(pairs), expanded(reversed_pairs(pairs))])
    square = inputs.T @ inputs / len(inputs)
    ridge = 1e-6 * np.trace(square) / len(square) * np.eye(len(square))
    return np.linalg.solve(square + ridge, inputs.T @ np.concatenate([sine, -sine]) / len(inputs))


def fit_nonlinear(pairs: Pairs, sine: Array, seed: int, steps: int) -> Predict:
    """Train the non-linear network: one hidden layer with ReLU, over both orders."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    both = np.concatenate([expanded(pairs), expanded(reversed_pairs(pairs))])
    scale = np.sqrt(np.mean(both**2, axis=0)) + 1e-9
    inputs = torch.from_numpy((both / scale).astype(np.float32))
    wanted = torch.from_numpy(np.concatenate([sine, -sine]).astype(np.float32))
    network = nn.Sequential(nn.Linear(inputs.shape[1], 32), nn.ReLU(), nn.Linear(32, 1))
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-3)
    for _ in range(steps):
        chosen = torch.from_numpy(rng.integers(len(inputs), size=256))
        loss = nn.functional.mse_loss(network(inputs[chosen])[:, 0], wanted[chosen])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()

    def predict(pairs: Pairs) -> Array:
        with torch.no_grad():
            return network(torch.from_numpy((expanded(pairs) / scale).astype(np.float32)))[:, 0].numpy().astype(float)

    return predict


def fit_all(engineered: Pairs, learnt: Pairs, sine: Array, seed: int, steps: int) -> dict[str, tuple[str, Predict]]:
    """Return the five models of Table II by name, each with the features that it takes, and one without class label."""
    weights = {"engineered": fit_linear(engineered, sine), "learnt": fit_linear(learnt, sine)}
    without = fit_linear(without_class(learnt), sine)
    return {
        "const": ("learnt", lambda pairs: np.zeros(len(pairs[0]))),  # the mean over both orders of all pairs
        "linear eng-feat": ("engineered", lambda pairs: expanded(pairs) @ weights["engineered"]),
        "linear learnt-feat": ("learnt", lambda pairs: expanded(pairs) @ weights["learnt"]),
        "linear learnt-feat, no class": ("learnt", lambda pairs: expanded(without_class(pairs)) @ without),
        "nonlinear eng-feat": ("engineered", fit_nonlinear(engineered, sine, seed, steps)),
        "nonlinear learnt-feat": ("learnt", fit_nonlinear(learnt, sine, seed, steps)),
    }


def validation_loss(predict: Predict, pairs: Pairs, sine: Array) -> float:
    """Return the loss of Table II: half of the mean square error of the sine, over both orders."""
    forward = predict(pairs) - sine
    backward = predict(reversed_pairs(pairs)) + sine
    return float(0.25 * (np.mean(forward**2) + np.mean(backward**2)))
