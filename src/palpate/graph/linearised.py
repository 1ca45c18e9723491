"""The terms of a window as they were last linearised, and how badly they fit."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.graph.evidence import add_costs, add_headings, mean_square
from palpate.graph.factors.factor import Factor, Rows, Terms
from palpate.graph.growing_terms import GrowingTerms
from palpate.graph.values import ANGLE_STEPS, Values
from palpate.graph.variables import SENSOR, SENSOR_IN_OBJECT

Array = NDArray[np.float64]
_NOT_OF_STEPS = "first_pose"  # what was known before is no evidence for what is measured


class Linearised:
    """Terms of factors with room for their rows, for a bank of smoothers."""

    def __init__(self, factors: Sequence[Factor], terms: Sequence[GrowingTerms], smoothers: int) -> None:
        """Make room for the terms of each factor."""
        self._rows = [
            (factor, grown.terms, factor.empty_rows(smoothers, len(grown)))
            for factor, grown in zip(factors, terms, strict=True)
            if grown
        ]
        self._at: Values | None = None
        self._costs: Array | None = None

    def __iter__(self) -> Iterator[tuple[Factor, Terms, Rows]]:
        """Yield factors with their terms and rows."""
        return iter(self._rows)

    @property
    def at(self) -> Values:
        """The values at which they are linearised."""
        assert self._at is not None
        return self._at

    def linearise(self, at: Values) -> None:
        """Linearise all terms at values."""
        self._at, self._costs = at, None
        for factor, terms, rows in self._rows:
            factor.linearise_into(rows, at, terms)

    def reach_of_oldest(self) -> int:
        """Return the newest step that a term of the oldest one is tied to, at least the next one."""
        reach = 1
        for _, terms, _ in self._rows:
            if terms.places.shape[1] > 1:
                reach = max(reach, int(terms.places[terms.places[:, 0] == 0, -1].max(initial=1)))
        return reach

    def mean_square(self, name: str, first: int, smoother: int) -> float:
        """Return the mean square error of a factor's terms from a step on [variances], kernels left out."""
        for factor, terms, rows in self._rows:
            if factor.name == name:
                return mean_square(rows.residual[smoother], rows.information[smoother], terms.places, first)
        return 0.0

    def costs(self) -> Array:
        """Return what each step costs (B, N, 2): what is measured in it, and pushing; see `Window.costs`."""
        if self._costs is None:
            self._costs = np.zeros((self.at.smoothers, self.at.steps, 2))
            for factor, terms, rows in self._rows:
                if factor.name != _NOT_OF_STEPS:
                    of = self._costs[..., int(factor.is_of_pushing)]
                    add_costs(rows.residual, rows.information, rows.weight, terms.places, of)
            add_headings(self.at[SENSOR_IN_OBJECT], self.at[SENSOR], self.at.touching, ANGLE_STEPS, self._costs[..., 1])
        return self._costs

    def last_errors(self, at: Values) -> dict[str, Array]:
        """Return the errors of the last step at values by factor, of those that tell strain; see `Smoother`."""
        last = at.steps - 1
        nearby = at.with_steps(lambda value: value[:, -ANGLE_STEPS - 1 :])
        errors = {}
        for factor, (places, data), _ in self._rows:
            if factor.tells_strain:
                mine = places[:, -1] == last
                rows = factor.linearise(nearby, Terms(places[mine] + nearby.steps - at.steps, data[mine]))
                errors[factor.name] = np.abs(rows.residual * np.sqrt(rows.information)).max(axis=1)
        return errors
