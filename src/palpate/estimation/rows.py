"""Dataclasses whose arrays have one leading axis of rows, so that to choose rows is to index."""

from typing import Any, Self

import numpy as np

from palpate.arrays import Flags, Integers

Indices = Integers | Flags | list[int] | slice


class RowArrays:
    """Base of dataclasses whose fields all have one leading axis of rows, or are such dataclasses themselves."""

    def take(self, rows: Indices) -> Self:
        """Return these rows; a row may be taken several times."""
        chosen: dict[str, Any] = {}
        for name, field in vars(self).items():
            chosen[name] = field[rows] if isinstance(field, np.ndarray) else field.take(rows)
        return type(self)(**chosen)

    def joined(self, other: Self) -> Self:
        """Return the rows of both, one after the other."""
        both: dict[str, Any] = {}
        for name, field in vars(self).items():
            added: Any = getattr(other, name)
            is_array = isinstance(field, np.ndarray)
            both[name] = np.concatenate((self.__dict__[name], added)) if is_array else field.joined(added)
        return type(self)(**both)
