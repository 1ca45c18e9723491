"""Terms of all factors that are linearised together, as the blocks of iSAM2 are."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.graph.compiled import Array
from palpate.graph.factors.factor import Terms
from palpate.graph.variables import STEP_SIZE


@dataclass(eq=False)
class TermGroup:
    """Terms that are linearised together."""

    terms: list[Terms | None]
    """By factor; places are counted from the first step of the contact."""
    linear: list[int] = field(default_factory=list)
    """Where GTSAM keeps what they were linearised to."""
    at: Array = field(default_factory=lambda: np.empty((0, STEP_SIZE)))
    """How far the steps of its blocks had moved where they were linearised."""

    @property
    def last(self) -> int:
        """The newest step that any of them is tied to."""
        return max(int(terms.places[:, -1].max()) for terms in self.terms if terms is not None)

    def append(self, which: int, arrived: Terms) -> None:
        """Take more terms of a factor."""
        here = self.terms[which]
        if not len(arrived.data):
            return
        if here is not None:
            arrived = Terms(np.concatenate([here.places, arrived.places]), np.concatenate([here.data, arrived.data]))
        self.terms[which] = arrived

    def split(self, first: int) -> "TermGroup":
        """Remove the terms that are tied to a step before the first one, and return them."""
        away = TermGroup([None] * len(self.terms))
        for which, terms in enumerate(self.terms):
            if terms is not None:
                old = terms.places[:, 0] < first
                away.terms[which] = chosen(terms, old) if old.any() else None
                self.terms[which] = None if old.all() else chosen(terms, ~old)
        return away


def chosen(terms: Terms, which: NDArray[np.bool_]) -> Terms:
    """Return some of the terms: those that which (T,) says."""
    return Terms(terms.places[which], terms.data[which])
