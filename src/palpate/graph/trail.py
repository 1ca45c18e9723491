"""A path that grows at its end, and that others who go another way from here on share."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PIECE = 1000  # rows


class Trail:
    """Rows of one shape, of which there may be hundreds of thousands: a copy costs next to nothing."""

    def __init__(self) -> None:
        """Begin with none."""
        self._pieces: list[Array] = []  # never changed, for copies share them
        self._last: list[Array] = []

    def append(self, row: Array) -> None:
        """Add a row, which is not to be changed afterwards."""
        self._last.append(row)
        if len(self._last) == _PIECE:
            self._end_piece()

    def extend(self, rows: Array) -> None:
        """Add rows (N, ...), which are not to be changed afterwards."""
        self._end_piece()
        if len(rows):
            self._pieces.append(rows)

    def copied(self) -> "Trail":
        """Return one with the same rows that goes its own way."""
        other = Trail()
        other._pieces, other._last = [*self._pieces], [*self._last]
        return other

    def rows(self) -> Array:
        """Return all rows (N, ...); an array (0,) where there are none."""
        parts = [*self._pieces, *([np.array(self._last)] if self._last else [])]
        return np.concatenate(parts) if parts else np.empty(0)

    def _end_piece(self) -> None:
        if self._last:
            self._pieces.append(np.array(self._last))
            self._last = []
