"""Accuracy and calibration of a touch network on recordings that it was not trained on."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.geometry import se2
from palpate.models.pushing.contact_geometry import HALF_RIGHT_ANGLE
from palpate.touch.touch_model import LEAST_CORNER_LOG_ODDS, Spread
from palpate_lab.train.augment import batch
from palpate_lab.train.networks import Together, TouchNetwork
from palpate_lab.train.samples import Samples

Indices = NDArray[np.int_]
Errors = Mapping[str, tuple[Array, Array, Indices]]
"""Errors (N,), predicted variances (N,) and contacts (N,) of each output, in radians or metres."""

COVERAGE = {0.68: 0.9945, 0.95: 1.9600}
"""Shares of a Gaussian, and the standard deviations about its mean that hold them."""


def errors_of(network: TouchNetwork | Together, samples: Samples) -> Errors:
    """Return the errors of a network on samples; those of turns and corners without the offset of their contact.

    Those of corners are of the corners that it finds.
    """
    network.eval()
    with torch.no_grad():
        parts = [
            network(batch(samples, np.arange(begin, min(begin + 256, len(samples)))))
            for begin in range(0, len(samples), 256)
        ]
    outputs = [torch.cat(batches).numpy().astype(np.float64) for batches in zip(*parts, strict=True)]
    errors: dict[str, tuple[Array, Array, Indices]] = {}
    for name, output in zip(network.outputs, outputs, strict=True):
        mean = output[:, 0]
        variance = np.exp(output[:, 1])
        contact = samples.episode
        if name == "direction":
            errors[name] = se2.wrap(mean - samples.direction), variance, contact
        elif name == "place":  # of centimetres
            errors[name] = 1e-2 * mean - samples.place, 1e-4 * variance, contact
        elif name == "turn":
            errors[name] = without_offsets(mean - samples.yaw, variance, contact), variance, contact
        else:
            error = mean + output[:, 2] * (samples.cone - HALF_RIGHT_ANGLE) - samples.corner
            is_corner = np.isfinite(samples.corner) & (output[:, 3] > LEAST_CORNER_LOG_ODDS)
            error = without_offsets(error[is_corner], variance[is_corner], contact[is_corner])
            errors[name] = error, variance[is_corner], contact[is_corner]
    return errors


def without_offsets(error: Array, variance: Array, contact: Indices) -> Array:
    """Return errors (N,) [rad] less the weighted mean of their contact, which is an unknown offset."""
    error = error.copy()
    weight = 1.0 / variance
    for number in np.unique(contact):
        chosen = contact == number
        error[chosen] = np.unwrap(error[chosen])
        error[chosen] -= np.average(error[chosen], weights=weight[chosen])
    return error


def spread_of(error: Array, variance: Array, episode: Indices, lags: int = 10) -> Spread:
    """Return the calibration of predicted variances from errors (N,) in order of time.

    `scale` puts 68 and 95 % of the errors where they belong, as far as one number can. `together` sums the errors'
    correlations over `lags` frames: the variance of their mean relative to that of independent errors. Some errors last
    longer, and those of a unit's gel forever: counted in full, images would weigh so little that pushing, whose model
    is cruder, would dominate (yaw 2.6 instead of 1.6 degrees off in the median of 30 recordings).
    """
    normalised = np.abs(error) / np.sqrt(variance)
    ratios = [np.quantile(normalised, share) / deviations for share, deviations in COVERAGE.items()]
    signed = np.clip(error / np.sqrt(variance), -5.0, 5.0)  # one slip does not discredit all other frames
    power = float(np.mean(signed**2))
    together = 1.0
    for lag in range(1, lags + 1):
        same = episode[lag:] == episode[:-lag]
        if np.count_nonzero(same) < 10 * lags:
            break
        correlation = float(np.mean((signed[lag:] * signed[:-lag])[same])) / power
        if correlation < 0.0:
            break
        together += 2.0 * correlation
    return Spread(scale=float(ratios[0] * ratios[1]), together=together)


def measure_spread(errors: Errors) -> dict[str, Spread]:
    """Return the calibration of each output, from errors on held-out recordings.

    No variance is reduced: training images vary more than simulated ones do, and real ones vary as much.
    """
    spreads = {}
    for name, (error, variance, contact) in errors.items():
        spread = spread_of(error, variance, contact) if len(error) else Spread(1.0, 1.0)
        spreads[name] = replace(spread, scale=max(spread.scale, 1.0))
    return spreads


def coverage(error: Array, variance: Array) -> dict[float, float]:
    """Return for each share of COVERAGE the share of errors (N,) in that interval about the prediction."""
    normalised = np.abs(error) / np.sqrt(variance)
    return {share: float(np.mean(normalised <= deviations)) for share, deviations in COVERAGE.items()}


def judge(errors: Errors, spread: Mapping[str, Spread]) -> dict[str, Any]:
    """Return accuracy and calibration of each output, as plain data; places in millimetres, angles in degrees."""
    scores = {}
    for name, (error, variance, _) in errors.items():
        if not len(error):
            continue
        scaled = variance * spread[name].scale
        unit, per_unit = ("mm", 1e-3) if name == "place" else ("deg", np.radians(1.0))
        scores[name] = {
            "coverage": {f"{share:g}": part for share, part in coverage(error, scaled).items()},
            f"rms_{unit}": float(np.sqrt(np.mean(error**2)) / per_unit),
            f"median_{unit}": float(np.median(np.abs(error)) / per_unit),
        }
    return scores
