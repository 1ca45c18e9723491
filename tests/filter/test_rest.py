"""Measurements of an object that nothing touches, and the same at the first step of a contact: by hand and by SciPy."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from push_samples import model_of, touching, with_settings
from scipy.optimize import least_squares
from smoother_samples import PLAIN, prior_at
from tracker_samples import SMOOTHERS

from palpate.filter.belief import Prior
from palpate.filter.rest import measured_at_rest
from palpate.geometry import se2
from palpate.graph.factor_list import make_factors
from palpate.graph.smoother import make_smoother
from palpate.graph.variables import DEPTH, IN_OBJECT, OBJECT_SIZE
from palpate.types.measurements import ContactDirection, Measurement, ObjectPose, OwnMeasurement, Turn

Array = np.ndarray
MODEL = model_of("rectangle")
FACTORS = make_factors(PLAIN, MODEL)
SINCE, NOW = 10.0, 12.0  # [s], of rest


def known(seed: int = 0, size: float = 1e-4, pose: Any = (0.3, -0.2, 3.1)) -> Prior:
    """What is known of an object, all of it correlated."""
    rng = np.random.default_rng(seed)
    root = size * (np.eye(3 + OBJECT_SIZE) + 0.3 * rng.normal(size=(3 + OBJECT_SIZE, 3 + OBJECT_SIZE)))
    return Prior(np.array(pose, np.float64), rng.normal(size=OBJECT_SIZE), root @ root.T)


def at_rest(prior: Prior, *said: Measurement) -> Prior:
    return measured_at_rest(prior, prior, said, FACTORS, MODEL, SINCE, NOW)[0]


def near(prior: Prior, by: Any) -> Array:
    return se2.compose(prior.pose, se2.exp(np.array(by, np.float64)))


def product(prior: Prior, pose: Array, covariance: Array) -> tuple[Array, Array]:
    """How far the mean (9,) is from the prior's, and the covariance: of the product of two Gaussians, linearised."""
    of_pose = np.eye(3, 3 + OBJECT_SIZE)
    gain = prior.covariance @ of_pose.T @ np.linalg.inv(prior.pose_covariance + covariance)
    change = gain @ se2.log(se2.between(prior.pose, pose))
    return change, prior.covariance - gain @ of_pose @ prior.covariance


SEEN = np.array([[4e-8, 1e-8, 0.0], [1e-8, 2e-8, -5e-9], [0.0, -5e-9, 1e-8]])


def test_an_object_pose_at_rest_is_a_product_of_gaussians():
    prior = known()
    pose = near(prior, (2e-4, -1e-4, 1.5e-4))
    found = at_rest(prior, ObjectPose(pose, SEEN))
    change, covariance = product(prior, pose, SEEN)
    # Of second order in 1e-4.
    np.testing.assert_allclose(se2.log(se2.between(prior.pose, found.pose)), change[:3], atol=1e-7)
    np.testing.assert_allclose(found.values - prior.values, change[3:], atol=1e-7)
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-3 * prior.covariance.max())
    np.testing.assert_array_equal(found.covariance, found.covariance.T)
    # Yaw across the seam: 3.1 rad and a little is not far from -3.1.
    assert abs(change[2]) < 2e-4


def test_a_wrong_pose_is_put_right_by_one_that_is_well_seen():
    prior = known(size=0.1)
    pose = near(prior, (0.05, -0.08, 0.3))
    found = at_rest(prior, ObjectPose(pose, 1e-10 * np.eye(3)))
    np.testing.assert_allclose(se2.between(pose, found.pose), 0.0, atol=1e-6)
    np.testing.assert_allclose(found.pose_covariance, 1e-10 * np.eye(3), atol=1e-14)


def test_far_off_it_is_the_most_likely_pose():
    # Where the linearised product is not enough: the least squares of both errors, by SciPy.
    prior, covariance = known(size=0.2), np.diag([4e-2, 1e-2, 9e-2])
    pose = near(prior, (0.3, -0.2, 0.9))
    found = at_rest(prior, ObjectPose(pose, covariance))
    roots = [np.linalg.inv(np.linalg.cholesky(each)) for each in (prior.covariance, covariance)]

    def errors(change: Array) -> Array:
        at = se2.compose(prior.pose, se2.exp(change[:3]))
        apart = np.concatenate([se2.log(se2.between(prior.pose, at)), change[3:]])
        return np.concatenate([roots[0] @ apart, roots[1] @ se2.log(se2.between(pose, at))])

    best = least_squares(errors, np.zeros(3 + OBJECT_SIZE), xtol=1e-12).x
    # Its Gauss-Newton steps take the derivative of the prior's Log for 1, which moves the minimum a little.
    np.testing.assert_allclose(se2.between(near(prior, best[:3]), found.pose), 0.0, atol=0.03)
    np.testing.assert_allclose(found.values, prior.values + best[3:], atol=0.03)


def test_measurements_one_after_the_other_are_the_same_together():
    prior = known()
    seen = [
        ObjectPose(near(prior, (2e-4, -1e-4, 1.5e-4)), SEEN),
        ObjectPose(near(prior, (-1e-4, 3e-4, -2e-4)), 2.0 * SEEN, 11.0),
    ]
    together, one_by_one = at_rest(prior, *seen), at_rest(at_rest(prior, seen[0]), seen[1])
    np.testing.assert_allclose(together.pose, one_by_one.pose, atol=1e-7)
    np.testing.assert_allclose(together.values, one_by_one.values, atol=1e-7)
    np.testing.assert_allclose(together.covariance, one_by_one.covariance, atol=1e-3 * prior.covariance.max())


class Deep(OwnMeasurement):
    """The depth, as something else tells it."""

    on = ("depth",)

    def __init__(self, depth: float, deviation: float, time: float | None = None) -> None:
        self.depth, self.deviation, self.time = depth, deviation, time

    def linearise(self, *values: Array) -> tuple[Array, Array]:
        return (values[0] - self.depth) / self.deviation, np.array([[1.0 / self.deviation]])


def test_an_own_measurement_at_rest_is_a_kalman_update():
    prior, place = known(), 3 + IN_OBJECT[DEPTH].start
    depth, deviation = float(prior[DEPTH][0]) + 2e-4, 5e-5
    found = at_rest(prior, Deep(depth, deviation))
    gain = prior.covariance[:, place] / (prior.covariance[place, place] + deviation**2)
    np.testing.assert_allclose(found.values - prior.values, gain[3:] * 2e-4, atol=1e-9)
    # All is correlated: the pose moves too.
    np.testing.assert_allclose(se2.log(se2.between(prior.pose, found.pose)), gain[:3] * 2e-4, atol=1e-7)
    assert np.abs(gain[:3]).max() > 0.05
    covariance = prior.covariance - np.outer(gain, prior.covariance[place])
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-3 * prior.covariance.max())


def test_what_touch_says_is_of_no_account_at_rest():
    prior = known()
    assert at_rest(prior, ContactDirection(0.1, 1e-4), Turn(0.1, 1e-4)) is prior
    assert at_rest(prior) is prior


def test_what_tells_of_the_pose_is_weighed_against_what_is_doubted():
    prior = known()
    doubted = prior.loosened(1e-4 * np.eye(3))
    seen, deep = ObjectPose(near(prior, (2e-4, -1e-4, 1.5e-4)), SEEN), Deep(float(prior[DEPTH][0]) + 2e-4, 5e-5)
    found, tells_pose = measured_at_rest(prior, doubted, [seen, deep], FACTORS, MODEL, SINCE, NOW)
    assert tells_pose
    np.testing.assert_array_equal(found.pose, at_rest(doubted, seen, deep).pose)
    found, tells_pose = measured_at_rest(prior, doubted, [deep], FACTORS, MODEL, SINCE, NOW)
    assert not tells_pose
    np.testing.assert_array_equal(found.covariance, at_rest(prior, deep).covariance)


def warning_of(caplog: pytest.LogCaptureFixture) -> str:
    (record,) = [record for record in caplog.records if record.levelno >= logging.WARNING]
    return record.message


@pytest.mark.parametrize("time", [SINCE - 5.0, NOW + 5.0, float("nan")])
@pytest.mark.parametrize("own", [False, True])
def test_what_is_of_another_time_is_left_out(time, own, caplog):
    prior = known()
    said = Deep(1.0, 1e-6, time) if own else ObjectPose(np.zeros(3), SEEN, time)
    assert at_rest(prior, said) is prior
    kind = "OwnMeasurement" if own else "ObjectPose"
    wanted = f"frame at 12.000 s: measurement {kind} is of {time} s, which is not between 10.000 s and now"
    assert wanted in warning_of(caplog)


@pytest.mark.parametrize("name", ["sensor", "sensor_in_object", "turn_offset"])
def test_at_rest_there_is_no_sensor(name, caplog):
    class Strange(Deep):
        on = (name,)

    prior = known()
    assert at_rest(prior, Strange(0.0, 1.0)) is prior
    there = "object_pose, direction_bias, direction_scale, place_bias, depth"
    wanted = f"measurement Strange is of {name}; at rest there are {there}"
    assert wanted in warning_of(caplog)


@pytest.mark.parametrize(
    ("returned", "said"),
    [
        ((np.zeros(2), np.zeros((2, 2))), "returns a residual of shape (2,) and a Jacobian of shape (2, 2)"),
        ((np.zeros(7), np.zeros((7, 1))), "they must be (R,) and (R, 1) with R at most 6"),
        ((0.0, np.zeros((1, 1))), "returns a residual of shape () and"),
        ((np.array([np.nan]), np.ones((1, 1))), "returns a residual or Jacobian that is not finite"),
        ((np.zeros(1), np.array([[np.inf]])), "returns a residual or Jacobian that is not finite"),
    ],
)
def test_an_own_measurement_that_returns_something_else_is_named_and_left_out(returned, said, caplog):
    class Broken(Deep):
        def linearise(self, *values: Array) -> Any:
            return returned

    prior = known()
    found = at_rest(prior, Broken(0.0, 1.0))
    np.testing.assert_allclose(found.pose, prior.pose)
    np.testing.assert_allclose(found.covariance, prior.covariance, rtol=1e-6, atol=1e-9 * prior.covariance.max())
    message = warning_of(caplog)
    assert message.startswith("frame at 12.000 s: measurement Broken") and message.endswith("; it is left out")
    assert said in message
    # The others count.
    pose = near(prior, (2e-4, -1e-4, 1.5e-4))
    seen = ObjectPose(pose, SEEN)
    np.testing.assert_allclose(at_rest(prior, Broken(0.0, 1.0), seen).pose, at_rest(prior, seen).pose, atol=1e-12)


# Nothing but the prior and what is measured counts.
FREE = with_settings(PLAIN, contact={"deviation": 0.03}, sensor_pose={"deviation": (3e-3, 3e-3, 0.03)})


@pytest.mark.parametrize("name", SMOOTHERS)
def test_in_contact_an_object_pose_is_a_product_of_gaussians_too(name: Any):
    prior = replace(known(pose=(0.02, -0.03, 0.1)), values=np.zeros(OBJECT_SIZE))
    pose, sensor_pose = near(prior, (2e-4, -1e-4, 1.5e-4)), se2.compose(prior.pose, touching(MODEL, 0.01))
    smoother = make_smoother(name, FREE, MODEL)(prior, sensor_pose, [ObjectPose(pose, SEEN)], 0.0)
    found = smoother.belief().prior
    change, covariance = product(prior, pose, SEEN)
    np.testing.assert_allclose(se2.log(se2.between(prior.pose, found.pose)), change[:3], atol=1e-7)
    np.testing.assert_allclose(found.values - prior.values, change[3:], atol=1e-7)
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-2 * prior.covariance.max())


class Camera(OwnMeasurement):
    """The same as an object pose, by a user's own hand."""

    on = ("object_pose",)

    def __init__(self, pose: Array, covariance: Array, time: float | None = None) -> None:
        self.pose, self.root, self.time = pose, np.linalg.inv(np.linalg.cholesky(covariance)), time

    def linearise(self, *values: Array) -> tuple[Array, Array]:
        error = se2.log(se2.between(self.pose, values[0]))
        return self.root @ error, self.root @ se2.right_jacobian_inverse(error)


@pytest.mark.parametrize("name", ["rest", *SMOOTHERS])
def test_an_own_measurement_of_the_object_pose_is_worth_as_much(name: Any):
    prior = prior_at(np.array([0.02, -0.03, 0.1]), PLAIN)
    pose, covariance = near(prior, (2e-3, -1e-3, 2e-2)), np.diag([1e-6, 2e-6, 1e-5])
    found = []
    for said in (ObjectPose(pose, covariance), Camera(pose, covariance)):
        if name == "rest":
            found.append(at_rest(prior, said))
        else:
            smoother = make_smoother(name, PLAIN, MODEL)(prior, np.array([-0.1, -0.03, 0.0]), [said], 0.0)
            smoother.add(np.array([-0.099, -0.03, 0.0]), [], 1 / 30)
            found.append(smoother.belief().prior)
    np.testing.assert_allclose(found[0].pose, found[1].pose, atol=1e-9)
    np.testing.assert_allclose(found[0].covariance, found[1].covariance, rtol=1e-6, atol=1e-14)
