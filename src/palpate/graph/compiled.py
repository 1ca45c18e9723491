"""Numba, set up once: functions are compiled at their first call and their machine code is kept in Numba's cache.

Numba looks only at a function's own file to see whether its machine code is out of date. After a change to a function
that compiled functions in other files call, delete the folders `__pycache__`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Integers = NDArray[np.int64]
Records = Any
"""An array of a structured type, or one element of it, whose fields compiled code reads and sets by name."""
F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function with Numba at its first call, or load it from Numba's cache."""
    return _compiled(function)


def compiled_to_sum(function: F) -> F:
    """Compile likewise a function whose sums may be taken in any order, and so several terms at a time."""
    return _compiled(function, fastmath={"reassoc"})


def is_cached(function: Any) -> bool:
    """Return True where machine code of a compiled function is in the cache."""
    return any(Path(function.stats.cache_path).glob("*.nbi"))


def _compiled(function: F, **options: Any) -> F:
    # Division by zero gives inf as in NumPy; a check would cost time in every loop.
    try:
        return numba.njit(cache=True, error_model="numpy", **options)(function)  # pyright: ignore[reportReturnType]
    except RuntimeError:  # no folder for a cache can be written
        return numba.njit(error_model="numpy", **options)(function)  # pyright: ignore[reportReturnType]
