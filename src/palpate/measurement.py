"""What touch can say about one frame: made by `palpate.touch`, taken by `palpate.graph`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class RelativePoses:
    """Sensor-in-object poses of the current frame as seen from P earlier frames of the same contact (paper Eq. 6)."""

    back: NDArray[np.int_]
    """How many frames ago the earlier frame was, (P,) int, at least 1."""
    pose: NDArray[np.float64]
    """`g_earlier^-1 g_now`, (P, 3) [m, m, rad]."""
    covariance: NDArray[np.float64]
    """(P, 3, 3), in the tangent space at the pose, order x, y, theta; large in x and y where only yaw is told."""
