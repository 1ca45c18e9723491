"""Shoves as hypotheses: copies of rows whose object something else has moved, how they are weighed, and the status."""

import numpy as np
import pytest

from palpate import Disc, Outline, Sketch, TrackerSettings, Unknown
from palpate.exploring.evidence import Contacts, form_evidence
from palpate.exploring.rows import Rows
from palpate.exploring.shoves import propose_shoves
from palpate.exploring.start import rows_about_origin

KNOWN = np.diag(np.square((1e-4, 1e-4, 1e-3)))


def first_rows() -> Rows:
    return rows_about_origin(Unknown(), np.zeros(3), KNOWN, TrackerSettings("none").noise.priors, 0.02)


def proposed(times: int = 1) -> Rows:
    rows = first_rows()
    generator = np.random.default_rng(1)
    for _ in range(times):
        propose_shoves(rows, generator)
    return rows


def test_rows_that_something_else_has_moved_stand_beside_the_others_with_a_small_weight():
    first = first_rows()
    rows = proposed()
    is_moved = rows.shoves == 1
    assert is_moved.sum() > 0 and np.array_equal(np.unique(rows.family), first.family)
    assert 0.002 < rows.weight[is_moved].sum() < 0.05
    for family in rows.family[is_moved]:
        assert rows.weight[rows.family == family].sum() == pytest.approx(0.01)  # that of a row before


def test_such_rows_are_elsewhere_less_certain_and_of_the_same_form():
    rows = proposed()
    moved = np.flatnonzero(rows.shoves == 1)
    source = np.array([np.flatnonzero((rows.family == rows.family[row]) & (rows.shoves == 0))[0] for row in moved])
    apart = rows.mean[moved] - rows.mean[source]
    variance = (rows.covariance[moved] - rows.covariance[source])[:, range(3), range(3)]
    # Half of the variance is between the rows and half in each: 2 cm and 0.2 rad in all.
    whole = apart[:, :3].var(axis=0) + variance.mean(axis=0)
    assert np.sqrt(whole) == pytest.approx((0.02, 0.02, 0.2), rel=0.3)
    assert not apart[:, 3:].any()


def test_the_number_of_rows_stays_bounded_and_no_first_row_is_lost():
    rows = proposed(times=10)
    assert len(rows.mean) == len(proposed(times=5).mean) < 2 * len(first_rows().mean)
    assert np.array_equal(np.unique(rows.family), first_rows().family)


def test_few_observations_tell_a_shove_and_many_a_form():
    rows = proposed()
    moved = int(np.flatnonzero(rows.shoves == 1)[0])
    source = int(np.flatnonzero((rows.family == rows.family[moved]) & (rows.shoves == 0))[0])
    other = int(np.flatnonzero(np.bincount(rows.family) == 1)[0])  # a family of one row
    before = rows.log_weight.copy()
    log_likelihood = np.zeros(len(before))
    log_likelihood[[moved, other]] = 6.0
    rows.weigh(log_likelihood)
    gained = rows.log_weight - before
    assert gained[moved] - gained[source] == pytest.approx(3.0)
    lone = rows.family == np.flatnonzero(np.bincount(rows.family) == 1)[1]
    assert gained[rows.family == other] - gained[lone] == pytest.approx(0.5)


def sketch_evidence(far: list[int], shoved: float = 0.0, count: int = 10):
    """Evidence on a sketch of a disc that was touched once in each contact; some touched 3 cm outside of it."""
    angle = 2.0 * np.pi * np.arange(count) / count
    radius = np.where(np.isin(np.arange(count), far), 0.09, 0.06)
    points = radius[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    contacts = Contacts(points, np.full(count, 1e-3), np.arange(count) + 1, count, shoved)
    outline = Outline(points, np.full(count, 1e-3), np.ones(count, np.bool_))
    return form_evidence(outline, contacts, Sketch(Disc(0.06), 2e-3), 0.01, has_directions=True)


def test_a_sketch_is_contradicted_by_many_contacts_and_not_by_the_one_after_a_shove():
    assert sketch_evidence(far=[4]).from_sketch == 0.0
    assert sketch_evidence(far=[1, 4, 7]).from_sketch == pytest.approx(0.03)
    assert sketch_evidence(far=[0], count=1).from_sketch == pytest.approx(0.03)


def test_shoves_are_named_if_they_are_many():
    assert sketch_evidence(far=[], shoved=1.5).shoved_share == 0.0
    assert sketch_evidence(far=[], shoved=3.0).shoved_share == pytest.approx(0.3)
