"""What everything says together: factors, their noise and the smoothers. Knows nothing of images."""

import sys
from collections.abc import Sequence
from typing import get_args

from palpate.errors import SettingError
from palpate.graph.factors import ContactModel
from palpate.graph.noise import GraphNoise
from palpate.graph.smoother import Smoother, SmootherName


def make_smoother(name: SmootherName, tips: Sequence[ContactModel], noise: GraphNoise) -> Smoother:
    """Return the smoother of that name for a sensor with these tips."""
    if name == "fixed-lag":
        from palpate.graph.fixed_lag import FixedLagSmoother

        return FixedLagSmoother(tips, noise)
    if name == "batch":
        from palpate.graph.fixed_lag import FixedLagSmoother

        return FixedLagSmoother(tips, noise, lag=sys.maxsize)
    if name == "isam2":
        from palpate.graph.isam2 import Isam2Smoother

        return Isam2Smoother(tips, noise)
    if name == "particle-filter":
        from palpate.graph.particle_filter import ParticleFilter

        return ParticleFilter(tips, noise)
    raise SettingError(f"smoother is {name!r}; allowed are {', '.join(get_args(SmootherName))}")
