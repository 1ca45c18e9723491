"""What the tracker asks of the graph of one contact, and the solvers that can give it."""

import sys
from collections.abc import Callable, Sequence
from typing import Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from palpate.config import NoiseSettings, SmootherName
from palpate.errors import SettingError
from palpate.filter.belief import Belief, Prior
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factor_list import make_factors
from palpate.types.measurements import Measurement

Array = NDArray[np.float64]
IN_A_WINDOW: tuple[SmootherName, ...] = ("fixed-lag", "batch")
"""Those that can say how well the last steps fit, and take something back."""


class Smoother(Protocol):
    """The graph of one contact. A step that cannot be solved raises EstimationError."""

    def add(self, sensor_pose: Array, measurements: Sequence[Measurement] = (), time: float = 0.0) -> None:
        """Add the next frame: the measured sensor pose (3,), what touch and others say, and its time [s]."""
        ...

    def belief(self) -> Belief:
        """Return the estimate at the last step."""
        ...

    def path(self) -> tuple[Array, Array]:
        """Return all steps of this contact as smoothed so far: g (N, 3) and e (N, 3)."""
        ...

    def last_errors(self) -> dict[str, Array]:
        """Return the errors of the last step by factor, of those that tell strain: (rows,) [standard deviations].

        Kernels are left out; of several terms it is the one worst off.
        """
        ...


BeginContact = Callable[[Prior, Array, Sequence[Measurement], float], Smoother]
"""Makes the graph of a contact from what is known of the object and its first frame: the measured sensor pose (3,),
what touch and others say, and its time [s]. Raises EstimationError where it cannot be solved."""


def make_smoother(name: SmootherName, settings: NoiseSettings, model: ContactModel) -> BeginContact:
    """Return what begins contacts with the smoother of that name; raises SettingError on another one."""
    factors = make_factors(settings, model)
    if name in IN_A_WINDOW:
        from palpate.graph.fixed_lag import FixedLag
        from palpate.graph.variables import LAG

        lag = LAG if name == "fixed-lag" else sys.maxsize
        return lambda prior, pose, said, time: FixedLag(factors, model, prior, pose, said, time, lag, settings.priors)
    if name == "isam2":
        from palpate.lab.paper.isam2 import Isam2

        return lambda prior, pose, said, time: Isam2(factors, model, prior, pose, said, time)
    if name == "particle-filter":
        from palpate.lab.paper.particle_filter import ParticleFilter

        random = np.random.default_rng(0)
        return lambda prior, pose, said, time: ParticleFilter(
            factors, settings, model, prior, pose, said, time, random=random
        )
    raise SettingError(f"smoother is {name!r}; allowed are {', '.join(get_args(SmootherName))}")
