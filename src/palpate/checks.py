"""Checks of numbers from files and users; errors name the field, what was found and what is allowed."""

from contextlib import suppress
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array, Flags
from palpate.errors import FileError, one_line

# Kinds of NumPy types that a field may have, and their name in an error.
NUMBERS = ("fiu", "numbers")
FLAGS = ("b", "booleans")

FARTHEST = 1e6
"""Largest number that a position or a length [m], an angle [rad] or the duration of a recording [s] may have. Beyond it
a file is damaged, or a unit or a clock is wrong: no robot is 1000 km away, and no recording is 12 days long."""
SPAN = 5.0
"""Largest extent of the positions of a push [m]. In millimetres even a push over 10 mm has more."""
TURNS = 4.0 * np.pi
"""Largest angle [rad], two turns. Larger ones are probably in degrees."""
METRES = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "m": 1.0}
"""Length of each unit [m], the likeliest unit first."""
_WORDS = {"mm": "millimetres", "cm": "centimetres", "in": "inches", "m": "metres"}
"""Names of these units in errors."""
_SECONDS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
"""Length of each unit of time [s]."""


def checked_array(name: str, value: Any, kind: tuple[str, str], shape: tuple[int | str, ...]) -> NDArray[Any]:
    """Return `value` as an array of the given kind and shape, "N" for any length. Raises FileError."""
    kinds, words = kind
    array = as_array(name, value)
    fits = array.ndim == len(shape)
    if fits:
        fits = all(wanted in ("N", size) for size, wanted in zip(array.shape, shape, strict=True))
    if array.dtype.kind in "SU":
        raise FileError(f"{name}: found text, expected {words}")
    if not fits:
        expected = str(shape).replace("'", "")
        raise FileError(f"{name}: found shape {array.shape}, expected {expected}")
    if array.dtype.kind not in kinds:
        found = type(array.flat[0]).__name__ if array.dtype.kind == "O" and array.size else array.dtype
        raise FileError(f"{name}: found values of type {found}, expected {words}")
    return array


def as_array(name: str, value: Any) -> NDArray[Any]:
    """Return an array, tensor or list of numbers as an array, in which masked numbers and None are NaN.

    Raises FileError.
    """
    if hasattr(value, "read"):
        raise FileError(
            f"{name}: is an open file, {type(value).__name__}; give what it holds, as its read() returns it"
        )
    try:
        if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
            return _without_mask(name, value)
        array = np.asarray(without_gradient(value))
    except (ValueError, MemoryError) as error:  # one long text among numbers asks for terabytes
        raise FileError(f"{name}: rows have different lengths, expected those of an array") from error
    except (TypeError, RuntimeError) as error:  # tensors in a list, or those of another library
        raise FileError(f"{name}: is no array of NumPy, nor can it be made one ({one_line(error)})") from error
    if array.dtype.kind == "O" and array.ndim:
        # Nanoseconds have more digits than a float.
        are_whole = array.size > 0 and all(isinstance(each, Integral) for each in array.flat)
        with suppress(TypeError, ValueError, OverflowError):  # of anything but numbers and None
            return array.astype(np.int64 if are_whole else np.float64)
    return array


def _without_mask(name: str, value: Any) -> NDArray[Any]:
    """Return a masked array with NaN where it is masked. Raises FileError if its type has none."""
    if value.dtype.kind not in "fmM":
        count = int(np.count_nonzero(np.ma.getmaskarray(value)))
        raise FileError(f"{name}: {count} of {value.size} values, {value.dtype}, are masked; allowed in floats only")
    return np.asarray(value.filled(np.nan if value.dtype.kind == "f" else "NaT"))


def without_gradient(value: Any) -> Any:
    """Return a tensor of PyTorch without gradient and on the CPU, as NumPy needs it; any other value as it is."""
    for method in ("detach", "cpu"):
        if hasattr(value, method):
            value = getattr(value, method)()
    return value


def check_rows(name: str, values: NDArray[Any], good: np.bool_ | Flags, allowed: str) -> None:
    """Raise FileError that names the first frame whose flag `good` is false, its value and what is allowed."""
    if not np.all(good):
        index = int(np.argmin(good))
        raise FileError(f"{name}: frame {index} is {values[index].tolist()}, allowed is {allowed}")


def checked_times(time: Any) -> Array:
    """Return times as floats (N,) [s], one or more, finite and strictly increasing. Raises FileError."""
    given = checked_array("time", time, NUMBERS, ("N",)).astype(np.float64)
    if not len(given):
        raise FileError("time: found no times, expected one or more")
    check_rows("time", given, np.isfinite(given), "a finite number")
    is_repeated = np.diff(given) <= 0
    if is_repeated.any():
        index = int(np.argmax(is_repeated)) + 1
        verb = "repeats" if given[index] == given[index - 1] else "runs backwards at"
        raise FileError(
            f"time: frame {index} {verb} {given[index]:.17g} s after {given[index - 1]:.17g} s, "
            "allowed are strictly increasing times"
        )
    # Compared without a difference, which may overflow.
    if given[-1] > given[0] + FARTHEST:
        raise FileError(f"time: runs from {given[0]:.17g} to {given[-1]:.17g} s, allowed are {FARTHEST:g} s at most")
    return given


def checked_poses(name: str, poses: Any, n: int, may_be_unknown: bool = False) -> Array:
    """Return n poses in the plane as floats (n, 3); unknown ones are three NaN. Raises FileError."""
    given = checked_array(name, poses, NUMBERS, (n, 3)).astype(np.float64)
    good = are_in_range(given).all(axis=1)
    allowed = f"three numbers up to {FARTHEST:g}"
    if may_be_unknown:
        good = good | np.isnan(given).all(axis=1)
        allowed += ", or three NaN"
    check_rows(name, given, good, allowed)
    return given


def checked_number(value: Any, least: float, most: float, kind: type = Real) -> float | None:
    """Return a number of a kind in a range, as an int if the kind is Integral, else a float; None for other values."""
    # Compared before it is converted, as a float cannot hold every whole number.
    if not isinstance(value, kind) or isinstance(value, bool) or not least <= value <= most:  # pyright: ignore[reportOperatorIssue]
        return None
    return int(value) if kind is Integral else float(value)  # pyright: ignore[reportArgumentType]


def are_in_range(values: NDArray[Any]) -> Flags:
    """Return flags of numbers that are finite, and small enough for a position or length [m]."""
    return np.abs(values) <= FARTHEST


def check_metres(name: str, position: Array) -> None:
    """Raise FileError if positions (N, 2 or 3) spread wider than any push [m]."""
    finite = position[np.isfinite(position).all(axis=1)]
    span = float(np.ptp(finite, axis=0).max()) if len(finite) else 0.0
    if span > SPAN:
        question = other_unit(span, 0.01, SPAN)
        raise FileError(f"{name}: found positions that span {span:.4g} m, allowed are {SPAN:g} m{question}")


def other_unit(length: float, least: float, most: float) -> str:
    """Return a question that names the units in which a length lies in a likely range [m], or ""."""
    fits = [_WORDS[unit] for unit, size in METRES.items() if least <= length * size <= most]
    return f": are these {' or '.join(fits)}?" if fits else ""


def other_time_unit(interval: float, rate: float) -> str:
    """Return a question that names the unit in which an interval [s] fits a stream of about this rate [Hz], or ""."""
    fits = [name for name, size in _SECONDS.items() if 0.2 < interval * size * rate < 5.0]
    return f"are these {fits[0]}?" if fits else ""
