"""What the steps that left a window leave behind: a Gaussian on those they were tied to and on what all steps share."""

import numpy as np

from palpate.graph.dense_equations import DenseEquations
from palpate.graph.linearised import Linearised
from palpate.graph.normal_equations import Gaussian
from palpate.graph.variables import CONTACT_SIZE, OF_CONTACT, SHARED_SIZE


def nothing_past(smoothers: int) -> Gaussian:
    """Return what is known of what a contact has before anything is measured; it is on no step."""
    information = np.zeros((smoothers, SHARED_SIZE, SHARED_SIZE))
    gradient = np.zeros((smoothers, SHARED_SIZE))
    deviations = [one.prior[1] for one in OF_CONTACT if one.prior for _ in range(one.dimension)]
    information[:, range(CONTACT_SIZE), range(CONTACT_SIZE)] = np.square(deviations) ** -1.0
    return Gaussian(0, information, gradient)


def without_oldest(terms: Linearised, past: Gaussian) -> Gaussian:
    """Return the past with the oldest step, which leaves: all terms that it is tied to as they were last linearised.

    `past` is that of the steps that left before, seen from where the terms are linearised.
    """
    at = terms.at
    steps = min(max(terms.reach_of_oldest() + 1, past.steps), at.steps)
    equations = DenseEquations(at.smoothers, steps)
    for factor, of_factor, rows in terms:
        equations.add(rows, of_factor.places, factor.columns, of_oldest=True)
    equations.add_gaussian(past)
    return equations.without_oldest()
