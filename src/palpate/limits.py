"""How much a file may ask for before it is refused; environment variables raise the limits (see docs/guide)."""

import math
import os
from typing import NamedTuple

from palpate.errors import FileError, SettingError

FARTHEST = 1e6
"""[m] A position, or a length, beyond this is damage: the planet is not much larger."""

LONGEST = 1e7
"""[s] A recording of more than these four months is damage: a wrong clock, or a wrong unit."""


class Limit(NamedTuple):
    """The most that a file may ask for of one kind."""

    variable: str
    """The environment variable that says another one."""
    usual: float
    """What holds without it, in units of `unit`."""
    unit: float = 1e6
    """How many bytes, or how much of what else is counted, one of them is."""

    @property
    def value(self) -> int:
        """The limit as it is now. Raises SettingError where the variable is no number."""
        said = os.environ.get(self.variable, str(self.usual))
        try:
            value = float(said)
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise SettingError(f"{self.variable} is {said!r}; allowed is a number above 0")
        return int(value * self.unit)

    @property
    def words(self) -> str:
        """What is allowed and how to allow more, to end an error with."""
        return f"allowed are {self.value / self.unit:g}{' MB' if self.unit > 1.0 else ''}; {self.variable} allows more"

    def check(self, size: int, what: str) -> None:
        """FileError where `what` has a larger size."""
        if size > self.value:
            found = f"{size / self.unit:.0f} MB" if self.unit > 1.0 else str(size)
            raise FileError(f"{what} of {found}, {self.words}")


TEXT = Limit("PALPATE_MAX_TEXT_MB", 100)
"""Bytes of a text file, once unpacked."""
ARRAYS = Limit("PALPATE_MAX_ARRAYS_MB", 256)
"""Bytes of the arrays in one file, once unpacked; images, which are not packed any further, do not count."""
DRAWING = Limit("PALPATE_MAX_DRAWING_MB", 5)
"""Bytes of an SVG or DXF."""
IMAGE = Limit("PALPATE_MAX_IMAGE_MB", 64)
"""Bytes of one image, once decoded: 3 a pixel."""
CHUNK = Limit("PALPATE_MAX_CHUNK_MB", 64)
"""Bytes of one chunk of a bag, once unpacked."""
SECONDS = Limit("PALPATE_MAX_SECONDS", 5, unit=1.0)
"""Seconds that the HDF5 library may take at a time: for all arrays of a file, or for AT_ONCE of its images."""
AT_ONCE = 32
"""Rows of bytes, such as images, of an HDF5 file that are read at once."""
BAG = Limit("PALPATE_MAX_BAG_MB", 20_000)
"""Bytes of a bag whose files are packed as a whole, once unpacked; they are unpacked on the disk."""
MESSAGES = Limit("PALPATE_MAX_MESSAGES", 10_000_000, unit=1.0)
"""Messages of a bag."""
