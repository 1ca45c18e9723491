"""Functions that are compiled into those that call them."""

import sys
from collections.abc import Callable
from typing import Any


class Kernel:
    """A function that is compiled into those that call it; Python cannot call it."""

    def __init__(self, function: Callable[..., object], are_disjoint: bool, options: dict[str, Any]) -> None:
        self.function = function
        """The function in Python."""
        self.are_disjoint = are_disjoint
        """True if its arguments do not overlap in memory."""
        self.options = options
        """Options of Numba."""
        self.__module__ = function.__module__  # generated code imports it from there by its name
        self.__name__ = function.__name__

    def __reduce__(self) -> Any:
        """Return how a copy finds the same kernel: by its place, as all that a tracker holds are of a module."""
        return _kernel_of, (self.function.__module__, self.function.__name__)


def _kernel_of(module: str, name: str) -> Kernel:
    return getattr(sys.modules[module], name)
