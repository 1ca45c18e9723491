"""Imprint: how far a tip has sunk in, by how much its image differs from the untouched gel."""

from typing import Any

import numpy as np

DEPTH_OF_DIFFERENCE = 3.8e-3
"""[m] Indentation of a DIGIT for a mean difference of 1. In simulation, from 0.2 to 4.6 mm, the logarithm of the
indentation scatters by 0.35 about a line of the logarithm of the difference."""
USUAL = 1e-3
"""[m] Indentation up to which the variable `depth` allows for it."""


def sunk(difference: Any) -> float:
    """Return the indentation beyond the usual one [m], by the difference (ROWS, COLUMNS, 3) of an image."""
    mean = float(np.abs(difference).max(axis=2).mean())
    return max(DEPTH_OF_DIFFERENCE * mean - USUAL, 0.0)
