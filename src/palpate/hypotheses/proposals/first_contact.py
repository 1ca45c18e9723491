"""Proposal at a first contact: other places of the outline at which the sensor may have met a known object.

They are considered if a belief is rough, or contradicts the direction of the contact as it does on the wrong side of a
corner. If something moved the object, its belief is a guess of how far and only says which places are likely.
"""

from dataclasses import replace

import numpy as np

from palpate.hypotheses.bank import Hypotheses
from palpate.hypotheses.proposals.contact_places import (
    MOST_PLACES,
    choose_beliefs,
    hypotheses_at,
)
from palpate.hypotheses.proposals.hand_places import leaves_several_places, places_of_contact
from palpate.hypotheses.proposals.shove import STEPS_AFTER_ALARM
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.measurements import Step


def propose_first_contact(
    rows: Hypotheses, rest: Belief, displaced: Belief, model: ContactModel, step: Step
) -> Hypotheses:
    """Return the hypotheses with which a contact begins, likeliest first.

    Those that take images the other way than the best come last. The beliefs `rest` (B,) hold if nothing moved the
    object since it was touched last, `displaced` (B,) include the covariance of its displacement.
    """
    is_displaced = rows.displacement > 0.0
    is_open = leaves_several_places(displaced, rows.touch_sign, model, step)
    places = places_of_contact(displaced, np.flatnonzero(is_open), rows.touch_sign, model, step, is_guess=is_displaced)
    has_places = np.bincount(places.parent, minlength=len(rows)) > 0
    # Where there are other places, the hypothesis that is kept says that nothing has moved the object.
    kept = replace(
        rows,
        belief=choose_beliefs(has_places, rest, displaced),
        weight=np.where(has_places, 1.0, rows.weight),
    )
    # Something else may still move an object that was displaced.
    disturbed_steps_left = np.where(rows.displacement[places.parent] > 0.0, STEPS_AFTER_ALARM + 1, 0)
    added = hypotheses_at(rows, places, "first contact", disturbed_steps_left)
    is_mirror = np.concatenate([rows.is_mirror_of_best, rows.is_mirror_of_best[places.parent]])
    proposed = kept.joined(added)
    likeliest = np.argsort(-proposed.log_prior, kind="stable")
    best = likeliest[~is_mirror[likeliest]][:MOST_PLACES]
    mirrors = likeliest[is_mirror[likeliest]][:MOST_PLACES]
    return proposed.take(np.concatenate([best, mirrors]))
