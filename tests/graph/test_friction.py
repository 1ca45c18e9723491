"""Friction learnt from pushes: the pressure distribution, the friction coefficient, and slides."""

import math
from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import ArrayLike
from push_samples import (
    contact_directions,
    frames,
    model_of,
    noisy,
    pushing_angles,
    touching,
    with_settings,
)
from slide_samples import DEEPER, slid
from smoother_samples import FELT, ROBUST, belief_at

from palpate.config import NoiseSettings
from palpate.filter.hypothesis_bank import HypothesisBank
from palpate.geometry import se2
from palpate.graph.belief import Belief
from palpate.graph.factors import make_factors
from palpate.graph.variables import FRICTION_CENTER, FRICTION_RATIO, GRIP, IN_OBJECT, Variable
from palpate.graph.window import Window
from palpate.lab.simulate.limit_surface import Steering, push
from palpate.types.measurements import ContactDirection

Array = np.ndarray
MODEL = model_of("rectangle")
HOLDING = with_settings(ROBUST, priors={"grip": (0.8, 0.12)})  # so well that it holds in all that is drawn to stick


def directions(g: Array, seed: int) -> list[ContactDirection]:
    """Contact directions as touch measures them."""
    angle = contact_directions(g, MODEL) + np.random.default_rng(seed).normal(0.0, FELT, len(g))
    return [ContactDirection(one, FELT**2) for one in angle]


def two_pushes(friction: Mapping[Variable, ArrayLike], steps: int = 80) -> tuple[Array, Array, Array]:
    """Object and sensor poses, and contact: pushed above its centre, let go and pushed below it, always sticking."""
    objects, sensors, first = [], [], np.zeros(3)
    for y in (0.045, -0.045):
        g = touching(MODEL, np.array([y])) + DEEPER
        o, e = push(MODEL, first[None], g, steps, Steering(), friction=friction)
        away = se2.compose(o[-1, 0], np.tile([-0.25, 0.0, 0.0], (10, 1)))
        objects += [o[:, 0], np.tile(o[-1, 0], (10, 1))]
        sensors += [e[:, 0], away]
        first = o[-1, 0]
    contact = np.tile(np.repeat([True, False], [steps + 1, 10]), 2)
    return np.concatenate(objects), np.concatenate(sensors), contact


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("true", [(math.log(2.0), 0.15, -0.1), (math.log(0.7), -0.2, 0.15)], ids=["wider", "narrower"])
def test_friction_is_learnt_from_one_contact_to_the_next(true, seed):
    friction = {FRICTION_RATIO: true[0], FRICTION_CENTER: true[1:]}
    o, e, contact = two_pushes(friction)
    e = noisy(e, ROBUST.sensor_pose.deviation, np.random.default_rng(seed))
    said = iter(directions(se2.between(o, e)[contact], seed))
    first = np.diag(np.square(HOLDING.first_pose.deviation))
    bank = HypothesisBank(MODEL, HOLDING, "fixed-lag", o[0], first, most=1)
    known = [bank.belief]
    for frame in frames(o, e, contact):
        if frame.contact:
            bank.contact_step(frame.sensor_pose, [next(said)], frame.time)
        else:
            bank.end_contact()
            bank.rest_step(frame.sensor_pose, (), frame.time)
        known.append(bank.belief)
    prior, first, resting, last = (known[k] for k in (0, 81, 91, -1))
    # What is known rests with the object, and is a little less certain.
    np.testing.assert_array_equal(resting.values, first.at_next_contact(HOLDING.priors).values)
    np.testing.assert_array_equal(resting.covariance, first.at_next_contact(HOLDING.priors).covariance)
    what = slice(IN_OBJECT[FRICTION_RATIO].start, IN_OBJECT[FRICTION_CENTER].stop)  # not the grip, which needs slides
    error = [np.abs(each.values[0, what] - true) for each in (prior, first, last)]
    deviation = [np.sqrt(np.diag(each.covariance[0])[3:])[what] for each in (prior, first, resting, last)]
    # c^2 and the centre come closer than they were held to be, the centre by far, and are as well known as said.
    assert (error[-1] < error[0]).all()
    assert (error[-1][1:] < 0.6 * error[0][1:]).all()
    assert (deviation[1] < deviation[0]).all()
    assert (error[-1] < 3.0 * deviation[-1]).all()
    # What each contact tells of the centre is more than what it may have changed by before.
    assert (deviation[-1][1:] < 0.8 * deviation[2][1:]).all()
    assert (deviation[-1][1:] < deviation[1][1:]).all()
    off = se2.log(se2.between(last.pose[0], o[-1]))
    assert off @ np.linalg.solve(last.pose_covariance[0], off) < 11.3  # 99 %


def followed(o: Array, e: Array, noise: NoiseSettings, seed: int) -> tuple[Belief, float, float]:
    """The belief at the end of a contact in which directions are felt, its error along the side [m] and its NEES."""
    told = directions(se2.between(o, e), seed)
    seen = noisy(e, ROBUST.sensor_pose.deviation, np.random.default_rng(seed))
    window = Window(make_factors(noise, MODEL), MODEL, belief_at(o[0], noise), seen[0], told[:1])
    for k in range(1, len(seen)):
        window.add(seen[k], [told[k]], k / 30)
    belief = window.belief()
    error = se2.log(se2.between(belief.pose[0], o[-1]))
    along = window.sensor_in_object[0, 1] - se2.between(o[-1], e[-1])[1]
    return belief, float(along), float(error @ np.linalg.solve(belief.pose_covariance[0], error))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    ("y", "heading", "grip"), [(-0.04, 0.8, 0.4), (0.04, -0.8, 0.4), (-0.04, 1.0, 0.4), (-0.04, 0.8, 0.3)]
)
def test_a_slide_at_the_edge_of_the_cone_is_followed(y, heading, grip, seed):
    o, e = slid(y, heading, grip, 60)
    # The draw is what it should be: 15 mm and more along the side, with the force at the cone's edge.
    g = se2.between(o, e)
    way = g[-1, 1] - g[0, 1]
    assert abs(way) > 0.015 and np.sign(way) == np.sign(heading)
    angle = pushing_angles(g, e, MODEL)
    np.testing.assert_allclose(angle, np.sign(heading) * math.atan(grip), atol=0.01)
    belief, along, nees = followed(o, e, ROBUST, seed)
    assert abs(along) < 0.5 * abs(way)
    assert nees < 11.3  # 99 %
    # Of a slide the grip is learnt as well.
    assert belief.covariance[0, -1, -1] < 0.7 * ROBUST.priors.grip[1] ** 2
    # Taken for sticking it is missed altogether, and nothing says so.
    stuck = with_settings(ROBUST, sticking={"sliding_share": 0.05}, friction_cone={"share": None})
    _, along, nees = followed(o, e, stuck, seed)
    assert abs(along) > 0.9 * abs(way)
    assert nees > 100.0


def test_a_push_that_sticks_is_not_taken_for_a_slide():
    # Well inside the cone the defaults are as sure of the place along the side as sticking says.
    g = touching(MODEL, np.array([0.005])) + DEEPER
    o, e = (poses[:, 0] for poses in push(MODEL, np.zeros((1, 3)), g, 60, Steering()))
    assert np.abs(pushing_angles(se2.between(o, e), e, MODEL)).max() < 0.2
    for seed in range(2):
        belief, along, nees = followed(o, e, ROBUST, seed)
        assert abs(along) < 1.5e-3
        assert nees < 11.3
        np.testing.assert_allclose(belief[GRIP][0], ROBUST.priors.grip[0], atol=0.01)
