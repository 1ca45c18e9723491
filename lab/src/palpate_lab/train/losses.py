"""Losses of a touch network's outputs: the negative log likelihoods of what the samples say.

Each function takes an output (B, its size), the samples that a batch is drawn from, the chosen ones in groups
(contacts, frames), and the batch; it returns losses by name.
"""

import numpy as np
import torch
from torch import Tensor, nn

from palpate.models.pushing.contact_geometry import HALF_RIGHT_ANGLE
from palpate.models.pushing.variables import CORNER_BIAS, TURN_OFFSET
from palpate_lab.train.augment import Batch
from palpate_lab.train.fit import gaussian_nll, offset_nll
from palpate_lab.train.samples import Indices, Samples


def direction_losses(output: Tensor, samples: Samples, chosen: Indices, seen: Batch) -> dict[str, Tensor]:
    """Return the loss of contact directions (B, 2), a mean [rad] and a log variance."""
    label = seen.direction(samples.direction[chosen])
    return {"direction": gaussian_nll(output[:, 0] - label.ravel(), output[:, 1])}


def place_losses(output: Tensor, samples: Samples, chosen: Indices, seen: Batch) -> dict[str, Tensor]:
    """Return the loss of places on a flat pad (B, 2), a mean [cm] and a log variance."""
    label = 1e2 * seen.place(samples.place[chosen])
    return {"place": gaussian_nll(output[:, 0] - label.ravel(), output[:, 1])}


def turn_losses(output: Tensor, samples: Samples, chosen: Indices, seen: Batch) -> dict[str, Tensor]:
    """Return the loss of turns (B, 2), a mean [rad] and a log variance; each contact has an unknown offset."""
    yaw = np.unwrap(samples.yaw[chosen], axis=1)
    turn = output.unflatten(0, chosen.shape)
    error = seen.signed(yaw - yaw[:, :1]) - turn[..., 0]
    return {"turn": offset_nll(error, turn[..., 1], TURN_OFFSET.prior[1])}


def corner_losses(output: Tensor, samples: Samples, chosen: Indices, seen: Batch) -> dict[str, Tensor]:
    """Return the losses of corners (B, 4): angle, log variance, slope over the corner's angle, and logit of a corner.

    Frames near a corner, whose angle is infinite in `Samples.corner`, count in neither.
    """
    corner = samples.corner[chosen]
    on_corner = np.isfinite(corner)
    off_corner = np.isnan(corner)
    angle, log_variance, slope, logit = output.unflatten(0, chosen.shape).unbind(-1)
    label = seen.signed(np.where(on_corner, corner, 0.0))
    steeper = torch.from_numpy((samples.cone[chosen] - HALF_RIGHT_ANGLE).astype(np.float32))
    error = label - angle - slope * steeper
    is_corner = torch.from_numpy(on_corner)
    is_known = torch.from_numpy(on_corner | off_corner)
    return {
        "corner": offset_nll(error, log_variance, CORNER_BIAS.prior[1], is_corner),
        "is_corner": nn.functional.binary_cross_entropy_with_logits(logit[is_known], is_corner[is_known].float()),
    }


OUTPUT_LOSSES = {
    "direction": direction_losses,
    "place": place_losses,
    "turn": turn_losses,
    "corner": corner_losses,
}
"""Losses of each output of a touch network."""
