"""What training makes small."""

import math

import torch
from torch import Tensor


def gaussian_nll(error: Tensor, log_variance: Tensor) -> Tensor:
    """Negative log-likelihood of errors [rad] under Gaussians, the mean over all; 2 pi is left in."""
    return 0.5 * (error**2 * torch.exp(-log_variance) + log_variance + math.log(2.0 * math.pi)).mean()


def offset_nll(error: Tensor, log_variance: Tensor) -> Tensor:
    """Negative log-likelihood, for each frame, of errors (G, F) [rad] that share an unknown offset in each group.

    Gaussians with the offset integrated out under a flat prior: what `measurements.Turn` means by its variance.
    """
    weight = torch.exp(-log_variance)
    total = weight.sum(dim=1)
    offset = (weight * error).sum(dim=1) / total
    square = (weight * (error - offset[:, None]) ** 2).sum(dim=1)
    frames = error.shape[1]
    joint = square + log_variance.sum(dim=1) + torch.log(total) + (frames - 1) * math.log(2.0 * math.pi)
    return 0.5 * joint.mean() / (frames - 1)
