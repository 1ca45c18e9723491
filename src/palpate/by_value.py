"""Equality by value of dataclasses that hold arrays."""

from dataclasses import fields
from typing import Any

import numpy as np


class ByValue:
    """Base of dataclasses (`eq=False`) that are equal if all their fields are, NaN being the same as NaN."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(same(getattr(self, one.name), getattr(other, one.name)) for one in fields(self))  # pyright: ignore[reportArgumentType]

    __hash__ = None  # pyright: ignore[reportAssignmentType] # arrays may be changed


def same(one: Any, other: Any) -> bool:
    """Return whether two fields are equal, arrays and tuples by what they hold."""
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return type(one) is type(other) and np.array_equal(one, other, equal_nan=True)
    return bool(one == other or (one != one and other != other))
