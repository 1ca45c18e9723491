"""Contact episodes of a recording, numbered as in the published system."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def episode_numbers(contact: ArrayLike) -> NDArray[np.int64]:
    """Number the contact episodes 0, 1, ... of flags (N,); -1 outside contact.

    As in the published system, an episode ends after more than 10 frames without contact and counts from 5
    frames of contact on.
    """
    flags = np.asarray(contact, np.bool_)
    touching = np.flatnonzero(flags)
    starts = np.diff(touching, prepend=-(10**9)) > 11
    run = np.cumsum(starts) - 1
    counts = np.bincount(run) >= 5 if len(run) else np.zeros(0, np.bool_)
    number = np.where(counts, np.cumsum(counts) - 1, -1)
    episode = np.full(flags.shape, -1, np.int64)
    episode[touching] = number[run]
    return episode
