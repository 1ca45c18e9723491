"""Where frames are missing, rather than late."""

import numpy as np
from numpy.typing import NDArray

_MISSING = 3.0  # median intervals from which frames are missing


def time_gaps(time: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the frames after which others are missing, from times (N,) [s]."""
    step = np.diff(time)
    return np.flatnonzero(step > _MISSING * np.median(step)) if len(step) else np.empty(0, np.intp)
