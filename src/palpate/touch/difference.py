"""What the networks see: how an image differs from the untouched gel."""

import numpy as np
from numpy.typing import NDArray

from palpate.touch.cells import area_means, light_of, lit

Difference = NDArray[np.float32]

ROWS, COLUMNS = 32, 128
"""Size of what the networks see. An upright object makes patches that stand along the rows, and what they tell of its
yaw lies across the columns, down to the shading beside a corner's line of a millimetre: so the columns are finer.
"""

_COARSE = 32  # columns that are enough to tell the light by
_LEVELS = 32.0  # grey levels that make 1, about as much as a firm contact adds


def reduced(image: NDArray[np.uint8] | Difference) -> NDArray[np.float32]:
    """Return an image or a background's mean (height, width, 3) as (ROWS, COLUMNS, 3) [grey levels]."""
    means = area_means(image, ROWS, COLUMNS)
    return np.rint(means) if image.dtype == np.uint8 else means  # as OpenCV would, with whom the networks were trained


def difference(image: NDArray[np.uint8], reduced_mean: NDArray[np.float32]) -> Difference:
    """Return how an image (height, width, 3) differs from the reduced mean of the background: (ROWS, COLUMNS, 3)."""
    return (reduced(image) - reduced_mean) / np.float32(_LEVELS)


def difference_in_light(image: NDArray[np.uint8], reduced_mean: NDArray[np.float32]) -> Difference:
    """Return the same as `difference`, with the untouched gel in the light of the image, which may have changed."""
    seen = reduced(image)
    cells, untouched = (area_means(each, ROWS, _COARSE) for each in (seen, reduced_mean))
    return (seen - lit(reduced_mean, light_of(cells, untouched))) / np.float32(_LEVELS)
