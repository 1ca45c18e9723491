"""Types of arrays that all of palpate uses, and copies of the dataclasses that hold them."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
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


def changed(record: T, **fields: Any) -> T:
    """Return a copy of a frozen dataclass with other fields, in a third of the time of `dataclasses.replace`.

    Nothing is checked or computed as it is where one is made.
    """
    values = vars(record)
    assert fields.keys() <= values.keys(), f"{type(record).__name__} has no {fields.keys() - values.keys()}"
    copy = object.__new__(type(record))
    vars(copy).update(values, **fields)
    return copy
