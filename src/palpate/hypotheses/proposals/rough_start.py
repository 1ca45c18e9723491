"""Proposal at the first contact of an object whose first pose is known roughly: all places it may be touched at.

The rough first pose holds until the object is found, so that contacts from several sides add up.
"""

from dataclasses import replace

import numpy as np

from palpate.arrays import Array
from palpate.hypotheses.bank import Hypotheses
from palpate.hypotheses.proposals.contact_places import (
    BeliefsAtPlaces,
    choose_beliefs,
    hypotheses_at,
    is_rough,
    most_of_rough_start,
)
from palpate.hypotheses.proposals.hand_places import leaves_several_places, places_of_contact
from palpate.hypotheses.proposals.shove import STEPS_AFTER_ALARM
from palpate.hypotheses.reducer import POOR_WEIGHT, merged
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.measurements import Step

_HOPELESS_SIGMA = 0.02, 0.02, 0.2
"""[m, m, rad] standard deviations of a first pose that is too rough for one graph to find the object."""


def propose_rough_start(
    rows: Hypotheses, rest: Belief, displaced: Belief, model: ContactModel, step: Step
) -> Hypotheses:
    """Return the hypotheses with which a contact begins, likeliest first.

    Those that take images the other way than the best come last. The beliefs `rest` (B,) hold if nothing moved the
    object since it was touched last, `displaced` (B,) include the covariance of its displacement.
    """
    is_open = leaves_several_places(displaced, rows.touch_sign, model, step)
    no_guess = np.zeros(len(rows), np.bool_)
    everywhere = places_of_contact(displaced, np.arange(len(rows)), rows.touch_sign, model, step, is_guess=no_guess)
    places = everywhere.take(np.flatnonzero(is_open[everywhere.parent]))
    kept = replace(
        rows,
        belief=choose_beliefs(is_open, rest, displaced),
        log_prior=rows.log_prior + _log_evidence(everywhere, len(rows)),
        weight=np.ones(len(rows)),
    )
    has_places = np.bincount(places.parent, minlength=len(rows)) > 0
    is_hopeless = is_rough(displaced, model, _HOPELESS_SIGMA) & has_places & (rows.displacement <= 0.0)
    # Something else may still move the object, as it is not found yet.
    disturbed_steps_left = np.full(len(places.parent), STEPS_AFTER_ALARM + 1)
    added = hypotheses_at(rows, places, "rough start", disturbed_steps_left)
    proposed = kept.take(~is_hopeless).joined(added)
    proposed = proposed.take(np.argsort(-proposed.log_prior, kind="stable"))
    is_mirror = proposed.touch_sign != rows.touch_sign[0]
    most = most_of_rough_start(model)
    best = merged(proposed.take(~is_mirror), most, model)
    mirrors = merged(proposed.take(is_mirror), most, model)
    return best.joined(mirrors)


def _log_evidence(places: BeliefsAtPlaces, count: int) -> Array:
    """Return the log probability (count,) of this contact in each hypothesis, at whatever place it is."""
    evidence = np.full(count, np.log(POOR_WEIGHT))  # even where no place is likely
    np.logaddexp.at(evidence, places.parent, places.log_likelihood)
    return evidence
