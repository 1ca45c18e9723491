"""Functions as machine code, from the same lines of Python whether it is built ahead of time or at the first use.

A `compiled` function is called from Python. Its code is a small library that needs neither Numba nor Python: it comes
with palpate, or Numba makes it when it is first needed, and it is kept; see `compiled.library` and `compiled.build`.
Functions that only these call are `kernel`s: part of the code of their callers.
"""

import struct
from collections.abc import Callable
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np

from palpate.compiled.kernels import Kernel

F = TypeVar("F", bound=Callable[..., object])
# In NumPy's structure of an array, the address of its data follows what begins every object of Python. Compiled code
# reads it there, as `array.ctypes.data` takes 1.3 us, of which a frame needs fifty.
_TO_DATA = object.__basicsize__
EVERY: "list[Compiled]" = []
"""All compiled functions so far."""


def kernel(function: F, are_disjoint: bool = False, **options: Any) -> F:
    """Return a function for use in compiled ones, with options of Numba.

    If its arrays `are_disjoint`, so that none overlaps another in memory, loops over them become vector code.
    """
    return cast("F", Kernel(function, are_disjoint, options))


def compiled(*example: Any, name: str = "", **options: Any) -> "Callable[[Callable[..., Any]], Compiled]":
    """Make a function machine code that takes arguments like those of an example, with options of Numba.

    `name` is that of its library, by default its own. Arguments are numbers, arrays in C order, or (named) tuples of
    these; types and numbers of axes are those of the example. The function writes what it finds to arrays that it is
    given, and makes no arrays. It returns nothing, or a whole number from 0 on if it is declared to return an int.
    """

    def decorator(function: Callable[..., Any]) -> Compiled:
        return Compiled(function, example, name or function.__name__.strip("_"), options)

    return decorator


class Compiled:
    """A function that runs as machine code, which is loaded or made at the first call."""

    def __init__(self, function: Any, example: tuple[Any, ...], name: str, options: dict[str, Any]) -> None:
        self.function = function
        """The function in Python."""
        self.example = example
        """Arguments that tell the types of others."""
        self.options = options
        """Options of Numba."""
        self.name = name
        """Name of its library, together with a hash."""
        self._kept: tuple[object, list[float]] = (None, [])
        EVERY.append(self)

    def __call__(self, *arguments: Any) -> int:
        """Run it; other threads run meanwhile. Raises TypeError for arguments unlike the example's."""
        numbers: list[float] = []
        for example, argument in zip(self.example, arguments, strict=True):
            if hasattr(example, "_fields"):
                numbers += self._numbers_of(example, argument)
            else:
                _flatten(example, argument, numbers)
        result = self.code(self._pack(*numbers))
        if result < 0:
            raise RuntimeError(f"the compiled function {self.name} failed")
        return result

    def _numbers_of(self, example: Any, argument: Any) -> list[float]:
        """Return the numbers of a named tuple, which are kept as the next call often has the same one."""
        kept = self._kept  # read once, as another thread may replace it
        if kept[0] is not argument:
            kept = (argument, [])
            _flatten(example, argument, kept[1])
            self._kept = kept
        return kept[1]

    def __reduce__(self) -> Any:
        """Return the name, by which a copy finds the same function, as code is not copied."""
        return _compiled_of, (self.name,)

    @property
    def is_loaded(self) -> bool:
        """True once the machine code is loaded."""
        return "code" in vars(self)

    def load(self) -> None:
        """Load the machine code, or make it."""
        _ = self.code

    @cached_property
    def code(self) -> Callable[[bytes], int]:
        """The machine code: a function of C that takes the packed numbers of `_flatten`, and returns -1 if it failed.

        One argument of some hundred bytes is quicker than fifty numbers, of which ctypes takes each by itself.
        """
        from palpate.compiled.library import code_of

        return code_of(self)

    @cached_property
    def _pack(self) -> Callable[..., bytes]:
        """Pack the numbers of `_flatten`, eight bytes each."""
        numbers: list[float] = []
        for example in self.example:
            _flatten(example, example, numbers)
        return struct.Struct("".join("d" if isinstance(number, float) else "q" for number in numbers)).pack


def _compiled_of(name: str) -> Compiled:
    return next(one for one in EVERY if one.name == name)


def _flatten(example: Any, argument: Any, numbers: list[float]) -> None:
    """Append the place of an array's address and its lengths, real and imaginary part of a complex number, or a number.

    The array must outlive the call.
    """
    if isinstance(example, np.ndarray):
        is_type = argument.dtype is example.dtype or argument.dtype == example.dtype  # structured types compare slowly
        if not is_type or argument.ndim != example.ndim or not argument.flags.c_contiguous:
            raise TypeError(f"an array has {argument.dtype}, {argument.strides}; the example has {example.dtype}")
        numbers.append(id(argument) + _TO_DATA)
        numbers.extend(argument.shape)
    elif isinstance(example, tuple):
        for part, given in zip(example, argument, strict=True):
            _flatten(part, given, numbers)
    elif isinstance(example, complex):
        numbers.append(float(argument.real))
        numbers.append(float(argument.imag))
    else:
        numbers.append(type(example)(argument))
