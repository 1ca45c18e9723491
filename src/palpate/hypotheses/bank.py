"""The bank: rows of hypotheses and, in a contact, the window that solves them, always in the same order."""

import numpy as np

from palpate.estimation.rows import Indices
from palpate.hypotheses.rows import Hypotheses
from palpate.models.pushing.window import ContactWindow


class HypothesisBank:
    """Holds all hypotheses, the best first. To branch, prune and reorder them is to take rows."""

    def __init__(self, rows: Hypotheses) -> None:
        self.rows = rows
        """State of each hypothesis."""
        self.window: ContactWindow | None = None
        """The graph of the contact, in all hypotheses; None between contacts."""

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, indices: Indices) -> None:
        """Keep these hypotheses, in this order; one may be taken several times."""
        present = np.arange(len(self.rows))
        taken = present[indices]
        if taken.tolist() == present.tolist():
            return
        self.rows = self.rows.take(taken)
        if self.window is not None:
            self.window.take(taken)

    def drop_lost(self) -> None:
        """Drop the hypotheses that have no solution."""
        if self.window is not None and self.window.has_lost_rows:
            self.take(~self.window.rows["is_lost"])
