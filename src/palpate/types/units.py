"""Units that are easily confused: nanoseconds with seconds, millimetres with metres, degrees with radians."""

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.checks import NUMBERS, check_rows, checked_array
from palpate.errors import FileError, ShapeError
from palpate.geometry.shapes import Shape

logger = logging.getLogger(__name__)

METRES: dict[str, float] = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "m": 1.0}
"""[m] of each unit of lengths, the likeliest first."""
NAMES = {"mm": "millimetres", "cm": "centimetres", "in": "inches", "m": "metres"}
SECONDS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
SPAN = 5.0
"""[m] Largest extent of a push; one of 10 mm in millimetres spans more."""
TURNS = 4.0 * np.pi
"""[rad] Angles beyond are probably in degrees."""


def nanoseconds(name: str, time: ArrayLike) -> NDArray[np.int64]:
    """Return times (N,), seconds as floats or nanoseconds as integers, as nanoseconds.

    Raises FileError that names the field where they are none or seem to be in another unit.
    """
    given = checked_array(name, time, NUMBERS, ("N",))
    if not len(given):
        raise FileError(f"{name}: found no times, expected one or more")
    whole = given.dtype.kind in "iu"
    check_rows(name, given, np.isfinite(given), "a finite number")
    step = np.abs(np.diff(given.astype(np.int64 if whole else np.float64)))
    step = float(np.median(step[step > 0])) if (step > 0).any() else 0.0
    rate = 1.0 / (step * (1e-9 if whole else 1.0)) if step else None
    is_late = not whole and np.abs(given).max() > 4e9  # after the year 2096
    if is_late or (rate is not None and not 0.1 <= rate <= 20e3):
        fits = [unit for unit, size in SECONDS.items() if step and 1.0 <= 1.0 / (step * size) <= 1500.0]
        hint = f": are these {fits[-1]}? times {SECONDS[fits[-1]]:g} they are seconds" if fits else ""
        kind = "integers, which are nanoseconds" if whole else "floats, which are seconds"
        raise FileError(f"{name}: found {kind}, in the median {step:g} from one to the next{hint}")
    return given.astype(np.int64) if whole else np.round(given * 1e9).astype(np.int64)


def other_time_unit(interval: float, rate: float) -> str:
    """Return the question for another unit if an interval [s] of a stream of about this rate [Hz] fits it, or ""."""
    fits = [name for name, size in SECONDS.items() if size < 1.0 and 0.2 < interval * size * rate < 5.0]
    return f"are these {fits[0]}?" if fits else ""


def check_metres(name: str, position: NDArray[np.float64]) -> None:
    """Raise FileError if positions (N, 2 or 3) spread wider than any push [m]."""
    finite = position[np.isfinite(position).all(axis=1)]
    span = float(np.ptp(finite, axis=0).max()) if len(finite) else 0.0
    if span > SPAN:
        hint = _other_units(span, (0.01, SPAN))
        raise FileError(f"{name}: found positions that span {span:.4g} m, allowed are {SPAN:g} m{hint}")


def _other_units(
    number: float, likely: tuple[float, float], how: str = "times {size:g}", units: Sequence[str] = ("mm", "cm")
) -> str:
    """Return the question for units that make a length likely [m], or ""; `how` is the way to a `unit` of a `size`."""
    fits = [unit for unit in units if likely[0] <= number * METRES[unit] <= likely[1]]
    makes = [f"{how.format(unit=unit, size=METRES[unit])} makes it {number * METRES[unit]:.3g} m" for unit in fits]
    return f": are these {' or '.join(NAMES[unit] for unit in fits)}? {', '.join(makes)}" if fits else ""


def extent_of(shape: Shape) -> float:
    """Return the larger of the outline's widths along x and y [m]."""
    return float(np.ptp(shape.outline(), axis=0).max())


def wrong_width(shape: Shape, unit: str | None = None, how: str = "times {size:g}") -> str:
    """Return a sentence on an outline, read in a unit, that is too large or small to be pushed, or ""."""
    width = extent_of(shape)
    if 0.005 <= width <= 2.0:
        return ""
    hint = _other_units(width / METRES[unit or "m"], (0.02, 1.0), how, tuple(METRES))
    return f"the outline is {width:g} m wide, allowed are 0.005 to 2 m{hint}"


def check_outline(shape: Shape) -> None:
    """Raise ShapeError if an outline is wider than any pushed object; warn if it is wider or smaller than most."""
    if wrong := wrong_width(shape):
        if extent_of(shape) > SPAN:
            raise ShapeError(wrong)
        logger.warning("%s", wrong)


def check_degrees(name: str, angle: NDArray[np.float64]) -> None:
    """Raise FileError if angles (N,) are too large for radians."""
    if len(angle) and (largest := float(np.abs(angle).max())) > TURNS:
        raise FileError(
            f"{name}: found angles up to {largest:.4g} rad, which are {largest / (2 * np.pi):.1f} turns: are these "
            "degrees? np.radians makes them radians"
        )
