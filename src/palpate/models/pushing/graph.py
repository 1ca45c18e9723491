"""Common part of all graphs of an object and a sensor: outline, settings, variables and factors."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.estimation.compiled_model import CompiledModel
from palpate.models.pushing.compiled import PUSHING
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.own_measurements import OwnMeasurements


@dataclass(frozen=True, eq=False)
class Graph:
    """Inputs that are the same for the graph of each contact, and of the resting object between contacts."""

    settings: NDArray[np.void]
    """Settings of the factors; see `models.pushing.settings`."""
    contact_model: ContactModel
    """The object's outline and the sensor."""
    own: OwnMeasurements = field(default_factory=OwnMeasurements)
    """Measurements of the user's own."""
    compiled: CompiledModel = PUSHING
    """Variables and factors: those of pushing, or of a model that extends it."""
