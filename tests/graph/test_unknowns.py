"""Where every unknown stands, and what is believed of the object's."""

import numpy as np
import pytest
from push_samples import model_of, values_at

from palpate.config import Priors
from palpate.errors import SettingError
from palpate.filter.belief import Belief, Prior
from palpate.geometry import se2
from palpate.graph.variables import (
    CONTACT_SIZE,
    DEPTH,
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    FRICTION_CENTER,
    FRICTION_RATIO,
    GRIP,
    IN_OBJECT,
    IN_SHARED,
    IN_STEP,
    LAG,
    OBJECT_POSE,
    OBJECT_SIZE,
    OF_CONTACT,
    OF_OBJECT,
    OF_STEP,
    OUTLINE_SCALE,
    PLACE_BIAS,
    SENSOR,
    SENSOR_IN_OBJECT,
    SHARED,
    SHARED_SIZE,
    STEP_SIZE,
    TURN_OFFSET,
    UNKNOWNS,
    named,
)
from palpate.types.measurements import FARTHEST_BACK


@pytest.mark.parametrize(
    ("unknowns", "places", "size"),
    [(OF_STEP, IN_STEP, STEP_SIZE), (SHARED, IN_SHARED, SHARED_SIZE), (OF_OBJECT, IN_OBJECT, OBJECT_SIZE)],
)
def test_unknowns_follow_one_another_without_a_gap(unknowns, places, size):
    assert list(places) == list(unknowns)
    numbers = [number for unknown in unknowns for number in range(places[unknown].start, places[unknown].stop)]
    assert numbers == list(range(size))
    assert all(places[unknown].stop - places[unknown].start == unknown.dimension for unknown in unknowns)


def test_where_they_stand():
    assert (IN_STEP[SENSOR_IN_OBJECT], IN_STEP[SENSOR]) == (slice(0, 3), slice(3, 6))
    assert OF_CONTACT == (TURN_OFFSET,)
    of_touch = DIRECTION_BIAS, DIRECTION_SCALE, PLACE_BIAS, DEPTH, OUTLINE_SCALE
    assert (*of_touch, FRICTION_RATIO, FRICTION_CENTER, GRIP) == OF_OBJECT
    assert SHARED == OF_CONTACT + OF_OBJECT  # those of the contact first, so that the others are one piece
    assert set(UNKNOWNS) == set(OF_STEP) | set(SHARED)
    assert SHARED_SIZE == CONTACT_SIZE + OBJECT_SIZE
    for unknown in OF_OBJECT:
        assert IN_SHARED[unknown].start == IN_OBJECT[unknown].start + CONTACT_SIZE
    assert LAG == FARTHEST_BACK + 1


def test_each_is_known_by_its_name():
    for unknown in (OBJECT_POSE, *UNKNOWNS):
        assert named(unknown.name) is unknown
    names = "object_pose, sensor_in_object, sensor, turn_offset, direction_bias, direction_scale, place_bias, depth"
    known = f"{names}, outline_scale, friction_ratio, friction_center, grip"
    with pytest.raises(SettingError, match=f"unknown 'yaw' is not known; known are {known}"):
        named("yaw")


def test_there_is_a_prior_of_what_belongs_to_the_object():
    priors = Priors()
    for unknown in OF_OBJECT:
        mean, deviation = getattr(priors, unknown.name)
        assert (priors.mean[IN_OBJECT[unknown]] == mean).all()
        assert (priors.deviation[IN_OBJECT[unknown]] == deviation).all()


def test_values_are_found_by_unknown_and_moved_by_place():
    rng = np.random.default_rng(1)
    g, e = rng.normal(size=(2, 4, 3, 3))
    shared = {unknown: rng.normal(size=(unknown.dimension, 4)) for unknown in SHARED}
    at = values_at(model_of("disc"), g, e, shared)
    assert (at.smoothers, at.steps) == (4, 3)
    by_step, by_shared = rng.normal(0.0, 0.3, (4, 3, STEP_SIZE)), rng.normal(size=(4, SHARED_SIZE))
    moved = at.moved(by_step, by_shared)
    for unknown, pose in ((SENSOR_IN_OBJECT, g), (SENSOR, e)):
        np.testing.assert_array_equal(at[unknown], pose)
        wanted = se2.compose(pose, se2.exp(by_step[..., IN_STEP[unknown]]))
        off = se2.log(se2.between(moved[unknown], wanted))
        np.testing.assert_allclose(off, 0.0, atol=1e-12)
    for unknown, value in shared.items():
        np.testing.assert_array_equal(at[unknown], value)
        np.testing.assert_allclose(moved[unknown], value + by_shared[:, IN_SHARED[unknown]].T)
    # Seen from before, they are apart by what they moved by.
    apart = moved.apart_from(at, 2)
    np.testing.assert_allclose(apart[:, : 2 * STEP_SIZE].reshape(4, 2, STEP_SIZE), by_step[:, :2], atol=1e-12)
    np.testing.assert_allclose(apart[:, 2 * STEP_SIZE :], by_shared, atol=1e-12)
    np.testing.assert_allclose(moved.apart_from(at, 0), by_shared, atol=1e-12)


def test_other_values_of_one_unknown_or_of_some_steps():
    rng = np.random.default_rng(2)
    at = values_at(model_of("disc"), rng.normal(size=(2, 5, 3)), shared={DEPTH: rng.normal(size=2)})
    other = at.with_value(FRICTION_CENTER, np.array([[1.0, 2.0], [3.0, 4.0]]))
    np.testing.assert_array_equal(other[FRICTION_CENTER], [[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(other[DEPTH], at[DEPTH])
    assert not at[FRICTION_CENTER].any()
    last = at.with_steps(lambda value: value[:, -2:])
    assert last.steps == 2
    np.testing.assert_array_equal(last[SENSOR], at[SENSOR][:, -2:])
    np.testing.assert_array_equal(last.touching, at.touching[:, -2:])


def test_the_object_as_the_last_step_of_a_contact_leaves_it():
    # By drawing g, e and the rest around a belief: mean and covariance of the object's pose o = e g^-1.
    rng = np.random.default_rng(3)
    root = 1e-3 * (np.eye(6 + OBJECT_SIZE) + 0.4 * rng.normal(size=(6 + OBJECT_SIZE, 6 + OBJECT_SIZE)))
    g, e, values = np.array([-0.1, 0.02, 0.5]), np.array([0.3, 0.4, -2.9]), rng.normal(size=OBJECT_SIZE)
    prior = Belief(g, e, values, root @ root.T).prior
    np.testing.assert_allclose(prior.pose, se2.compose(e, se2.inverse(g)))
    draws = rng.normal(size=(100_000, 6 + OBJECT_SIZE)) @ root.T
    o = se2.compose(se2.compose(e, se2.exp(draws[:, 3:6])), se2.inverse(se2.compose(g, se2.exp(draws[:, :3]))))
    both = np.hstack([se2.log(se2.between(prior.pose, o)), draws[:, 6:]])
    deviation = np.sqrt(np.diag(prior.covariance))
    np.testing.assert_allclose(
        np.cov(both.T) / np.outer(deviation, deviation), prior.covariance / np.outer(deviation, deviation), atol=0.02
    )
    np.testing.assert_array_equal(prior.covariance, prior.covariance.T)
    for unknown in OF_OBJECT:
        np.testing.assert_array_equal(prior[unknown], values[IN_OBJECT[unknown]])


def test_a_prior_made_less_certain():
    prior = Prior(np.zeros(3), np.zeros(OBJECT_SIZE), np.eye(3 + OBJECT_SIZE))
    more = np.diag([1.0, 2.0, 3.0])
    loosened = prior.loosened(more)
    np.testing.assert_array_equal(loosened.pose_covariance, np.eye(3) + more)
    np.testing.assert_array_equal(loosened.covariance[3:], np.eye(3 + OBJECT_SIZE)[3:])
    np.testing.assert_array_equal(prior.covariance, np.eye(3 + OBJECT_SIZE))


def test_friction_is_less_certain_at_the_next_contact():
    covariance = np.full((3 + OBJECT_SIZE, 3 + OBJECT_SIZE), 1e-4) + np.eye(3 + OBJECT_SIZE)
    known = Prior(np.ones(3), np.arange(float(OBJECT_SIZE)), covariance)
    usual = Priors(friction_ratio=(0.5, 2.0), friction_center=(0.0, 0.5), grip=(0.3, 0.25))
    later = known.at_next_contact(usual)
    np.testing.assert_array_equal(later.pose, known.pose)
    # sqrt(1 - 0.44^2) of what friction was, about what is usual, and besides (0.44 x 2)^2, (0.44 x 0.5)^2 twice and
    # (0.44 x 0.25)^2 on the diagonal; nothing else changes.
    keeps, more, usually = np.ones(3 + OBJECT_SIZE), np.zeros(3 + OBJECT_SIZE), np.zeros(OBJECT_SIZE)
    for unknown, mean, variance in ((FRICTION_RATIO, 0.5, 0.7744), (FRICTION_CENTER, 0.0, 0.0484), (GRIP, 0.3, 0.0121)):
        place = slice(3 + IN_OBJECT[unknown].start, 3 + IN_OBJECT[unknown].stop)
        keeps[place], more[place], usually[IN_OBJECT[unknown]] = 0.8979978, variance, mean
    np.testing.assert_allclose(later.values, usually + keeps[3:] * (known.values - usually), atol=1e-6)
    np.testing.assert_allclose(later.covariance, covariance * np.outer(keeps, keeps) + np.diag(more), atol=1e-6)
    # Where contacts teach nothing it is known as well as at first.
    prior = Prior(np.ones(3), usual.mean, np.diag(np.square([1.0, 1.0, 1.0, *usual.deviation])))
    np.testing.assert_allclose(prior.at_next_contact(usual).covariance, prior.covariance)
    np.testing.assert_array_equal(prior.at_next_contact(usual).values, prior.values)
