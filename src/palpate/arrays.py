"""Types of arrays that all rooms use."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Image = NDArray[np.uint8]
"""Pixels (height, width, 3), RGB."""
Levels = NDArray[np.float32]
"""Pixels or means of several (rows, columns, 3), RGB [grey levels]."""
Times = NDArray[np.int64]
"""[ns]"""
