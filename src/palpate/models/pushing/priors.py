"""The prior of the object's variables as vectors, in the order of the model."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from palpate.arrays import Array
from palpate.config import Priors
from palpate.estimation.model import Model
from palpate.models.pushing.hand import is_of_finger
from palpate.models.pushing.model import MODEL


@dataclass(frozen=True, eq=False)
class ObjectPrior:
    """Belief about the object's variables before its first contact, and how they change."""

    names: tuple[str, ...]
    """Name of each number's variable, V of them."""
    mean: Array
    """Means (V,)."""
    deviation: Array
    """Standard deviations (V,)."""
    change_between_contacts: Array
    """Variances (V,) of the changes from one contact to the next."""
    change_per_step: Array
    """Variances (V,) of the changes in each step of a contact."""


@lru_cache(maxsize=32)
def object_prior(priors: Priors, model: Model = MODEL, fingers: tuple[Priors, ...] = ()) -> ObjectPrior:
    """Return the prior of a model's object: by the settings where these have it, else as the variable states it.

    `fingers` are the settings of each finger of a hand, for the variables that it has for itself.
    """
    names: list[str] = []
    means: list[float] = []
    deviations: list[float] = []
    changes_between_contacts: list[float] = []
    changes_per_step: list[float] = []
    for variable in model.of("object"):
        settings = fingers[variable.finger] if fingers and is_of_finger(variable) else priors
        mean, deviation = getattr(settings, variable.known_as, variable.prior)
        names.extend(variable.dimension * [variable.name])
        means.extend(variable.dimension * [mean])
        deviations.extend(variable.dimension * [deviation])
        between_contacts, per_step = variable.change  # shares of the deviation
        changes_between_contacts.extend(variable.dimension * [between_contacts * deviation])
        changes_per_step.extend(variable.dimension * [per_step * deviation])
    return ObjectPrior(
        names=tuple(names),
        mean=np.array(means),
        deviation=np.array(deviations),
        change_between_contacts=np.square(changes_between_contacts),
        change_per_step=np.square(changes_per_step),
    )
