"""Rows of hypotheses: no two fields share an array, and no step writes into the rows of the one before."""

from dataclasses import fields
from itertools import combinations

import numpy as np
import planar
from push_samples import contact_directions, in_two_contacts, model_of

from palpate import ContactDirection, Frame, TrackerSettings
from palpate.hypotheses.bank import Hypotheses
from palpate.hypotheses.filter import MultiHypothesisFilter
from palpate.hypotheses.posterior import Posterior
from palpate.models.pushing.belief import Belief

FIRST_SIGMA = np.array([0.02, 0.02, 0.17])


def arrays(rows: Hypotheses | Belief) -> dict[str, np.ndarray]:
    """Return all arrays of the rows by name."""
    found: dict[str, np.ndarray] = {}
    for field in fields(rows):
        value = getattr(rows, field.name)
        found |= arrays(value) if isinstance(value, Belief) else {field.name: value}
    return found


def posteriors(hypotheses: int, is_read_only: bool = False) -> list[Posterior]:
    """Return the posteriors of an object that is known roughly, pushed in two contacts with a rest between.

    If they are read-only, a step that writes into the rows of the one before raises an error.
    """
    o, e, contact = in_two_contacts("rectangle", 25)
    directions = contact_directions(planar.between(o, e), model_of("rectangle"))
    settings = TrackerSettings(hypotheses=hypotheses)
    estimator = MultiHypothesisFilter(model_of("rectangle"), settings, o[0], np.diag(FIRST_SIGMA**2), True)
    found = []
    for k, (pose, direction) in enumerate(zip(e, directions, strict=True)):
        frame = Frame(k / 30.0, pose, contact=bool(contact[k]))
        if not frame.contact:
            estimator.end_contact()
        found.append(estimator.step(frame, [ContactDirection(float(direction), 1e-3)] if frame.contact else ()))
        if is_read_only:
            for array in arrays(found[-1].rows).values():
                array.setflags(write=False)
    return found


def test_no_two_fields_share_an_array():
    for hypotheses in (1, 9):
        for posterior in posteriors(hypotheses):
            for (name, one), (other_name, other) in combinations(arrays(posterior.rows).items(), 2):
                assert not np.shares_memory(one, other), f"{name} and {other_name}"


def test_a_posterior_stays_as_it_was_while_later_frames_are_taken():
    for posterior in posteriors(9, is_read_only=True):
        assert len(posterior.rows) == len(posterior.covariances)
