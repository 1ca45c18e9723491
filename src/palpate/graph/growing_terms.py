"""The terms of one factor in a window that moves on: they come at the end and mostly leave at the beginning."""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from palpate.graph.factors.factor import Terms


class GrowingTerms:
    """The terms of one factor, by the place of their steps in the window."""

    def __init__(self) -> None:
        self.begun = False
        self.span = 0
        """How many steps the farthest term spans."""
        self._back = 0  # how many steps before the one with which it came the farthest term reaches
        self._places, self._data = np.empty((0, 1), np.int64), np.empty(0, np.dtype([]))
        self._first = self._end = 0

    def __len__(self) -> int:
        return self._end - self._first

    @property
    def terms(self) -> Terms:
        """All of them; views of what is kept here."""
        return Terms(self._places[self._first : self._end], self._data[self._first : self._end])

    def copy(self) -> "GrowingTerms":
        """Return the same, independent of this one."""
        other = copy(self)
        other._places, other._data = self._places.copy(), self._data.copy()
        return other

    def append(self, arrived: Terms, now: int) -> None:
        """Take terms that arrive with the step at place now, as far as the window reaches."""
        places, data = arrived
        earliest = int(places[0, 0] if len(places) == 1 else places[:, 0].min())
        if now + earliest < 0:
            kept = places[:, 0] >= -now
            places, data, earliest = places[kept], data[kept], -now
        count = len(places)
        if not count:
            return
        if self._end + count > len(self._data):
            self._make_room(count, places, data)
        self._back = max(self._back, -earliest)
        if places.shape[1] > 1:
            self.span = self._back
        np.add(places, now, out=self._places[self._end : self._end + count])
        self._data[self._end : self._end + count] = data
        self._end += count
        self.begun = True

    def drop_oldest(self) -> None:
        """Drop the terms that are tied to the oldest step, and move the places of the others on by a step."""
        places = self._places[self._first : self._end]
        places -= 1
        if self._back < places.shape[1]:  # each came with its own step, so that they stand in order
            while self._first < self._end and self._places[self._first, 0] < 0:
                self._first += 1
            return
        kept, data = places[:, 0] >= 0, self._data[self._first : self._end]
        self._end = self._first + int(np.count_nonzero(kept))
        self._places[self._first : self._end], self._data[self._first : self._end] = places[kept], data[kept]

    def _make_room(self, count: int, places: NDArray[np.int64], data: NDArray[np.void]) -> None:
        """Move the terms to the front of arrays in which as many again have room."""
        terms = self.terms
        size = 2 * (len(terms.data) + count)
        self._places, self._data = np.empty((size, places.shape[1]), np.int64), np.empty(size, data.dtype)
        if len(terms.data):
            self._places[: len(terms.data)], self._data[: len(terms.data)] = terms
        self._first, self._end = 0, len(terms.data)
