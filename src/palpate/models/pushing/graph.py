"""Inputs that all graphs of an object and a sensor have in common."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.estimation.compiled_model import CompiledModel
from palpate.models.pushing.compiled import PUSHING
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.own_measurements import OwnMeasurements


@dataclass(frozen=True, eq=False)
class Graph:
    """Inputs of a graph, of a contact or of the resting object."""

    settings: NDArray[np.void]
    """Settings of the factors; see `models.pushing.settings`."""
    model: ContactModel
    """The object's outline and the sensor."""
    own: OwnMeasurements = field(default_factory=OwnMeasurements)
    """Measurements of the user's own."""
    compiled: CompiledModel = PUSHING
    """Variables and factors: those of pushing, or of a model that extends it."""
