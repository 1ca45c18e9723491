"""How well estimates and their covariances together tell the truth, in one number.

The score of a pose is the negative log likelihood of the true one under the Gaussian that is reported,
`(NEES + log det covariance) / 2` up to a constant. It is proper: it is least where the estimate is right and the
covariance is that of its errors. Being off costs, and so does being vague or too sure of oneself.

A frame that is 100 standard deviations off would outweigh a thousand good ones, so NEES is damped to
`a log(1 + NEES / b)`, as in Student's law: it costs about as much at first and hardly more later, so that one push that
is lost for good, which no setting would have saved, does not rule the rest. With Student's own a = b + 3 the best
standard deviation of Gaussian errors would be 7 % too small; the a below keeps it where it belongs.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.pipeline.metrics import nees

Array = NDArray[np.float64]

DAMPING = 10.0
"""NEES b around which it is damped: 2 % of Gaussian errors are beyond it."""
SLOPE = 14.43338537605379
"""a, such that the mean of a NEES / (b + NEES) is 3 for Gaussian errors, as that of NEES is: then no other scale of
their covariance is better. It is 3 / (1 - b + b sqrt(pi b / 2) erfcx(sqrt(b / 2)))."""


def negative_log_likelihood(pose: ArrayLike, covariance: ArrayLike, truth: ArrayLike) -> Array:
    """Damped negative log likelihood (N,) of true poses (N, 3) [m, m, rad], without its constant.

    The covariance (N, 3, 3) is that of the right tangent space at the pose (N, 3). NaN where the truth is, infinite
    where the covariance is singular.
    """
    known = np.isfinite(np.asarray(truth, dtype=np.float64)).all(axis=-1)
    log_determinant = np.linalg.slogdet(np.asarray(covariance, dtype=np.float64))[1]
    score = 0.5 * (damped(nees(pose, covariance, truth)) + log_determinant)
    return np.where(known & np.isnan(score), np.inf, score)


def damped(squared: ArrayLike) -> Array:
    """What a normalised squared error (...) costs, `a log(1 + NEES / b)`."""
    return SLOPE * np.log1p(np.asarray(squared, dtype=np.float64) / DAMPING)
