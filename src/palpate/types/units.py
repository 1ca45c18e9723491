"""Units that are easily taken for others: nanoseconds for seconds, millimetres for metres, degrees for radians."""

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
_WORDS = {"mm": "millimetres", "cm": "centimetres", "in": "inches", "m": "metres"}
UNITS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}

RATES = (0.1, 20e3)
"""[Hz] Least and most of images or poses in a second; a wrong unit is a factor of 1000 or more off."""
LIKELY = (1.0, 1500.0)
"""[Hz] of images and poses, by which another unit is proposed."""
LATEST = 4e9
"""[s] since 1970: the year 2096."""
SPAN = 5.0
"""[m] that no arm and no object on a table moves; a push of 10 mm in millimetres spans more."""
SPANS = (0.01, SPAN)
"""[m] of a push, by which another unit is proposed."""
WIDTHS, LIKELY_WIDTHS = (0.005, 2.0), (0.02, 1.0)
"""[m] Widths of outlines, and those by which another unit is proposed."""
TURNS = 4.0 * np.pi
"""[rad] beyond which an angle is rather in degrees."""


def nanoseconds(name: str, time: ArrayLike) -> NDArray[np.int64]:
    """Times (N,), seconds if they are floats and nanoseconds if they are integers, as nanoseconds.

    Raises FileError where they are by another unit, as it seems, and says which.
    """
    given = checked_array(name, time, NUMBERS, ("N",))
    if not len(given):
        raise FileError(f"{name}: found no times, expected one or more")
    whole = given.dtype.kind in "iu"
    check_rows(name, given, np.isfinite(given), "a finite number")
    step = np.abs(np.diff(given.astype(np.int64 if whole else np.float64)))
    step = float(np.median(step[step > 0])) if (step > 0).any() else 0.0
    rate = 1.0 / (step * (1e-9 if whole else 1.0)) if step else None
    late = not whole and np.abs(given).max() > LATEST
    if late or (rate is not None and not RATES[0] <= rate <= RATES[1]):
        fits = [unit for unit, size in UNITS.items() if step and LIKELY[0] <= 1.0 / (step * size) <= LIKELY[1]]
        asked = f": are these {fits[-1]}? times {UNITS[fits[-1]]:g} they are seconds" if fits else ""
        kind = "integers, which are nanoseconds" if whole else "floats, which are seconds"
        raise FileError(f"{name}: found {kind}, in the median {step:g} from one to the next{asked}")
    return given.astype(np.int64) if whole else np.round(given * 1e9).astype(np.int64)


def other_time_unit(interval: float, rate: float) -> str:
    """Ask whether an interval [s] of a stream of about this rate [Hz] is in another unit; nothing where it is not."""
    fits = [name for name, size in UNITS.items() if size < 1.0 and 0.2 < interval * size * rate < 5.0]
    return f"are these {fits[0]}?" if fits else ""


def check_metres(name: str, position: NDArray[np.float64]) -> None:
    """FileError if positions (N, 2 or 3) spread wider than any push [m]."""
    finite = position[np.isfinite(position).all(axis=1)]
    span = float(np.ptp(finite, axis=0).max()) if len(finite) else 0.0
    if span > SPAN:
        raise FileError(
            f"{name}: found positions that span {span:.4g} m, allowed are {SPAN:g} m{other_units(span, SPANS)}"
        )


def other_units(
    number: float, likely: tuple[float, float], how: str = "times {size:g}", units: Sequence[str] = ("mm", "cm")
) -> str:
    """Ask whether a length is in one of these units, of those that make it likely [m]; nothing where none does.

    `how` tells what makes a `unit` of a `size` [m] of it.
    """
    fits = [unit for unit in units if likely[0] <= number * METRES[unit] <= likely[1]]
    makes = [f"{how.format(unit=unit, size=METRES[unit])} makes it {number * METRES[unit]:.3g} m" for unit in fits]
    return f": are these {' or '.join(_WORDS[unit] for unit in fits)}? {', '.join(makes)}" if fits else ""


def extent_of(shape: Shape) -> float:
    """The larger of the outline's widths along x and y [m]."""
    return float(np.ptp(shape.outline(), axis=0).max())


def wrong_width(shape: Shape, unit: str | None = None, how: str = "times {size:g}") -> str:
    """Say what is wrong with an outline's width, which was read in a unit, and ask for another; mostly nothing."""
    width = extent_of(shape)
    if WIDTHS[0] <= width <= WIDTHS[1]:
        return ""
    asked = other_units(width / METRES[unit or "m"], LIKELY_WIDTHS, how, tuple(METRES))
    return f"the outline is {width:g} m wide, allowed are {WIDTHS[0]:g} to {WIDTHS[1]:g} m{asked}"


def check_outline(shape: Shape) -> None:
    """ShapeError if an outline is wider than anything that is pushed; warns where it is wider or smaller than most."""
    if wrong := wrong_width(shape):
        if extent_of(shape) > SPAN:
            raise ShapeError(wrong)
        logger.warning("%s", wrong)


def check_degrees(name: str, angle: NDArray[np.float64]) -> None:
    """FileError if angles (N,) are too large for radians."""
    if len(angle) and (largest := float(np.abs(angle).max())) > TURNS:
        raise FileError(
            f"{name}: found angles up to {largest:.4g} rad, which are {largest / (2 * np.pi):.1f} turns: are these "
            "degrees? np.radians makes them radians"
        )
