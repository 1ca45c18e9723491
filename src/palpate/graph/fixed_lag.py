"""The smoother that palpate uses unless told otherwise: one smoother over a sliding window."""

from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from palpate.config import Normal, Priors
from palpate.filter.belief import Belief, Prior
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.factor import Factor
from palpate.graph.values import Knock
from palpate.graph.variables import LAG
from palpate.graph.window import Window
from palpate.types.measurements import Measurement

Array = NDArray[np.float64]


class FixedLag:
    """One smoother of a window, which others may share; see Smoother."""

    def __init__(
        self,
        factors: Sequence[Factor],
        model: ContactModel,
        prior: Prior,
        sensor_pose: Array,
        measurements: Sequence[Measurement] = (),
        time: float = 0.0,
        lag: int = LAG,
        usual: Priors | None = None,
    ) -> None:
        """Begin with the first frame of a contact and what is known of the object; see Window. `lag` is in steps."""
        self._window = Window(factors, model, [prior], sensor_pose, measurements, time, lag, usual)
        self._place = 0  # in the window

    def add(self, sensor_pose: Array, measurements: Sequence[Measurement] = (), time: float = 0.0) -> None:
        """See Smoother."""
        add_to_all([self], sensor_pose, measurements, time, [None])

    def knocked(self, steps: int, slide: Normal, grip: tuple[Normal, Normal] | None = None) -> "FixedLag":
        """See Window."""
        other = copy(self)
        other._window, other._place = Window.bank([(self._window, self._place)]).knocked(steps, slide, grip), 0
        return other

    @property
    def is_solved(self) -> bool:
        """Whether its graph has a solution."""
        return not self._window.is_lost[self._place]

    def mean_square(self, name: str, steps: int) -> float:
        """See Window."""
        return self._window.mean_square(name, steps, self._place)

    def pushing_angle(self) -> float:
        """See Window."""
        return float(self._window.pushing_angle()[self._place])

    def costs(self) -> Array:
        """Return what each of the last steps costs (N, 2); see Window."""
        return self._window.costs()[self._place]

    def belief(self) -> Belief:
        """See Smoother."""
        return self._window.belief(self._place)

    def path(self) -> tuple[Array, Array]:
        """See Smoother; steps that left the window stay as they were last estimated in it."""
        g, e = self._window.path()
        return g[self._place], e[self._place]

    def last_errors(self) -> dict[str, Array]:
        """See Smoother."""
        return {name: errors[self._place] for name, errors in self._window.last_errors().items()}


def add_to_all(
    smoothers: Sequence[FixedLag],
    sensor_pose: Array,
    measurements: Sequence[Measurement],
    time: float,
    knocks: Sequence[Knock | None],
) -> None:
    """Add the next frame of one contact to smoothers, all in one call; `knocks` are what each thinks may push besides.

    Raises EstimationError where none of their graphs has a solution.
    """
    window = smoothers[0]._window
    places = [one._place for one in smoothers]
    if any(one._window is not window for one in smoothers) or sorted(places) != [*range(window.smoothers)]:
        window = Window.bank([(one._window, one._place) for one in smoothers])
        for place, one in enumerate(smoothers):
            one._window, one._place = window, place
        places = range(len(smoothers))
    in_place = dict(zip(places, knocks, strict=True))
    window.add(sensor_pose, measurements, time, [in_place[place] for place in range(window.smoothers)])
