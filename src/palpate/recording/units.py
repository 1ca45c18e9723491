"""Units that are easily taken for others: nanoseconds for seconds, millimetres for metres, degrees for radians."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import FileError
from palpate.files import NUMBERS, check_rows, checked_array

UNITS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}

RATES = (0.1, 20e3)
"""[Hz] Least and most of images or poses in a second; a wrong unit is a factor of 1000 or more off."""
LIKELY = (1.0, 1500.0)
"""[Hz] of images and poses, by which another unit is proposed."""
LATEST = 4e9
"""[s] since 1970: the year 2096."""
SPAN = 5.0
"""[m] that no arm and no object on a table moves; a push of 10 mm in millimetres spans more."""
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


def check_metres(name: str, position: NDArray[np.float64]) -> None:
    """FileError if positions (N, 2 or 3) spread wider than any push [m]."""
    finite = position[np.isfinite(position).all(axis=1)]
    span = float(np.ptp(finite, axis=0).max()) if len(finite) else 0.0
    if span > SPAN:
        raise FileError(
            f"{name}: found positions that span {span:.4g} m, allowed are {SPAN:g} m: are these millimetres? times "
            "0.001 they are metres"
        )


def check_degrees(name: str, angle: NDArray[np.float64]) -> None:
    """FileError if angles (N,) are too large for radians."""
    if len(angle) and (largest := float(np.abs(angle).max())) > TURNS:
        raise FileError(
            f"{name}: found angles up to {largest:.4g} rad, which are {largest / (2 * np.pi):.1f} turns: are these "
            "degrees? np.radians makes them radians"
        )
