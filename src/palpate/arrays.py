"""Types of arrays that all of palpate uses."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
Records = Any
"""Array of a structured type, or one element of it, whose fields compiled code reads and sets by name."""
Image = NDArray[np.uint8]
"""Pixels (height, width, 3), RGB."""
Levels = NDArray[np.float32]
"""Pixels, or means over several (rows, columns, 3), RGB [grey levels]."""
Times = NDArray[np.int64]
"""[ns]"""
