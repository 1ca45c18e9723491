"""Drawing what is learned from: groups of frames of one contact, pairs of them, and batches for the networks."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.training.samples import Samples

Indices = NDArray[np.int_]

CLOSEST, FARTHEST = 10, 50
"""Frames between the two of a pair (paper Sec. IV-A)."""
_GAIN, _TINT = (0.75, 1.3), 0.05  # by which brightness and colour of a unit's images may differ from those seen


def draw_groups(samples: Samples, count: int, size: int, rng: np.random.Generator) -> Indices:
    """Draw groups (count, size) of samples, each of one contact and no more than FARTHEST frames long, in any order.

    All kinds of contact that there are come equally often: true corners are rare, and the hardest to read.
    """
    first, last = _span(samples)
    kinds, kind, each = np.unique(samples.kind, return_inverse=True, return_counts=True)
    place = np.concatenate([[0], np.cumsum(each)[:-1]])[(chosen := rng.integers(len(kinds), size=count))]
    middle = np.argsort(kind, kind="stable")[place + (rng.random(count) * each[chosen]).astype(int)]
    begin = np.maximum(first[middle], middle - rng.integers(FARTHEST + 1, size=count))
    length = np.minimum(begin + FARTHEST, last[middle]) - begin + 1
    return begin[:, None] + (rng.random((count, size)) * length[:, None]).astype(int)


def draw_pairs(samples: Samples, count: int, rng: np.random.Generator) -> tuple[Indices, Indices]:
    """Draw pairs (count,) of samples of one contact, CLOSEST to FARTHEST frames apart, the earlier first.

    Raises SettingError where no contact is long enough.
    """
    _, last = _span(samples)
    earlier = np.flatnonzero(last - np.arange(len(samples)) >= CLOSEST)
    if not len(earlier):
        raise SettingError(f"too few pairs to learn from: no contact has frames {CLOSEST} apart")
    earlier = rng.choice(earlier, size=count)
    most = np.minimum(last[earlier] - earlier, FARTHEST)
    return earlier, earlier + rng.integers(CLOSEST, most + 1)


def turned(samples: Samples, earlier: Indices, later: Indices) -> NDArray[np.float64]:
    """Return by how much the sensor turned on the object between samples [rad]."""
    return se2.wrap(samples.yaw[later] - samples.yaw[earlier])


def batch(samples: Samples, chosen: Indices, rng: np.random.Generator | None = None) -> Tensor:
    """Return differences (B, 3, 32, 128) of chosen samples (B,); with an rng, as of units of other brightness."""
    difference = samples.difference[chosen].astype(np.float32)
    if rng is not None:
        gain = rng.uniform(*_GAIN, (len(chosen), 1, 1, 1)).astype(np.float32)
        tint = rng.normal(0.0, _TINT, (len(chosen), 1, 1, 3)).astype(np.float32)
        difference = difference * gain + tint
    return torch.from_numpy(difference).permute(0, 3, 1, 2)  # channels last in memory, which is faster here


def _span(samples: Samples) -> tuple[Indices, Indices]:
    """First and last sample (N,) of the contact that each sample belongs to."""
    starts = np.flatnonzero(np.diff(samples.episode, prepend=-1))
    ends = np.append(starts[1:], len(samples)) - 1
    contact = np.cumsum(np.isin(np.arange(len(samples)), starts)) - 1
    return starts[contact], ends[contact]
