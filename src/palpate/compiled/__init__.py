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
from numpy.typing import NDArray

from palpate.compiled.kernels import Kernel

F = TypeVar("F", bound=Callable[..., object])
# In NumPy's structure of an array, the address of its data follows what begins every object of Python. Compiled code
# reads it there, as `array.ctypes.data` takes 1.3 us, of which a frame needs fifty.
_TO_DATA = object.__basicsize__
Putter = Callable[[Any, list[float]], None]
"""A function that appends the numbers of an argument to a list."""
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
        self._putters = [_putter_of(each) for each in example]
        EVERY.append(self)

    def __call__(self, *arguments: Any) -> int:
        """Run it; other threads run meanwhile. Raises TypeError for arguments unlike the example's."""
        numbers: list[float] = []
        for put, argument in zip(self._putters, arguments, strict=True):
            put(argument, numbers)
        result = self.code(self._pack(*numbers))
        if result < 0:
            raise RuntimeError(f"the compiled function {self.name} failed")
        return result

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
        """The machine code: a function of C that takes the packed numbers of arguments, and returns -1 if it failed.

        One argument of some hundred bytes is quicker than fifty numbers, of which ctypes takes each by itself.
        """
        from palpate.compiled.library import code_of

        return code_of(self)

    @cached_property
    def _pack(self) -> Callable[..., bytes]:
        """Pack the numbers of arguments, eight bytes each."""
        numbers: list[float] = []
        for put, example in zip(self._putters, self.example, strict=True):
            put(example, numbers)
        return struct.Struct("".join("d" if isinstance(number, float) else "q" for number in numbers)).pack


def _compiled_of(name: str) -> Compiled:
    return next(one for one in EVERY if one.name == name)


def _putter_of(example: Any) -> Putter:
    """Return the function that appends the numbers of an argument like an example.

    They are the place of an array's address and its lengths, real and imaginary part of a complex number, or a number.
    Arrays must outlive the call.
    """
    if isinstance(example, np.ndarray):
        return _putter_of_array(example)
    if isinstance(example, tuple):
        return _putter_of_tuple(example)
    if isinstance(example, complex):
        return lambda number, numbers: numbers.extend((float(number.real), float(number.imag)))
    kind = type(example)
    return lambda number, numbers: numbers.append(kind(number))


def _putter_of_array(example: NDArray[Any]) -> Putter:
    kind = example.dtype
    axes = example.ndim

    def put(array: NDArray[Any], numbers: list[float]) -> None:
        is_kind = array.dtype is kind or array.dtype == kind  # structured types compare slowly
        if not is_kind or array.ndim != axes or not array.flags.c_contiguous:
            raise TypeError(f"an array has {array.dtype}, {array.strides}; the example has {kind}")
        numbers.append(id(array) + _TO_DATA)
        numbers.extend(array.shape)

    return put


def _putter_of_tuple(example: tuple[Any, ...]) -> Putter:
    """Return the same for a tuple. The numbers of a named one are kept, as the next call often has the same one."""
    putters = [_putter_of(part) for part in example]
    is_named = hasattr(example, "_fields")
    last: tuple[object, list[float]] = (None, [])

    def put(parts: tuple[Any, ...], numbers: list[float]) -> None:
        nonlocal last
        of_last = last  # read once, as another thread may replace it
        if of_last[0] is not parts:
            of_last = (parts, [])
            for put_part, part in zip(putters, parts, strict=True):
                put_part(part, of_last[1])
            last = of_last if is_named else (None, [])
        numbers += of_last[1]

    return put
