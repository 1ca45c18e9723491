"""What touch can say about one frame: made by `palpate.touch`, taken by `palpate.graph`."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RelativePoses:
    """Sensor-in-object poses of the current frame as seen from P earlier frames of the same contact (paper Eq. 6)."""

    back: np.ndarray
    """How many frames ago the earlier frame was, (P,) int, at least 1."""
    pose: np.ndarray
    """`g_earlier^-1 g_now`, (P, 3) [m, m, rad]."""
    covariance: np.ndarray
    """Covariance in the tangent space at the pose, (P, 3, 3), order x, y, theta. A yaw-only measurement has large x, y variances."""
