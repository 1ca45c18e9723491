"""The smoother that palpate uses unless told otherwise: one smoother over a sliding window."""

from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from palpate.estimation.belief import Belief, Prior
from palpate.estimation.contact_model import ContactModel
from palpate.estimation.factors.factor import Factor, Knock
from palpate.estimation.unknowns import LAG, Normal, Priors
from palpate.estimation.window import Window
from palpate.recording.measurements import Measurement

Array = NDArray[np.float64]


class FixedLag:
    """A window with one smoother in it; see Smoother."""

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

    def add(
        self,
        sensor_pose: Array,
        measurements: Sequence[Measurement] = (),
        time: float = 0.0,
        knock: Knock | None = None,
    ) -> None:
        """See Smoother; `knock` is what else may move the object in this step."""
        self._window.add(sensor_pose, measurements, time, knock)

    def knocked(self, steps: int, slide: Normal, grip: tuple[Normal, Normal] | None = None) -> "FixedLag":
        """See Window."""
        other = copy(self)
        other._window = self._window.knocked(steps, slide, grip)
        return other

    def mean_square(self, name: str, steps: int) -> float:
        """See Window."""
        return self._window.mean_square(name, steps)

    def pushing_angle(self) -> float:
        """See Window."""
        return self._window.pushing_angle()

    def costs(self) -> Array:
        """See Window."""
        return self._window.costs()

    def belief(self) -> Belief:
        """See Smoother."""
        return self._window.beliefs()[0]

    def path(self) -> tuple[Array, Array]:
        """See Smoother; steps that left the window stay as they were last estimated in it."""
        g, e = self._window.path()
        return g[0], e[0]

    def last_errors(self) -> dict[str, Array]:
        """See Smoother."""
        return {name: errors[0] for name, errors in self._window.last_errors().items()}
