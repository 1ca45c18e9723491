"""What pushes tell of friction: where an object's pressure is, how well the contact grips, and that it slides."""

import math
from dataclasses import replace

import numpy as np
import pytest
from push_samples import SHAPES, direction_rows, frames, noisy, pushing_angles, pushing_rows, sensor, tips_of, touching
from smoother_samples import FELT, ROBUST, known_at

from palpate.geometry import se2
from palpate.graph.fixed_lag import FixedLagSmoother
from palpate.graph.noise import STICKING, GraphNoise
from palpate.graph.smoother import FRICTION, Belief
from palpate.recording.frame import Frame
from palpate.recording.measurements import ContactDirection, Feeling
from palpate.simulation.limit_surface import Steering, push
from palpate.tracker import Tracker, TrackerSettings

Array = np.ndarray
TIP = tips_of("rectangle")[0]
DEEPER = np.array([ROBUST.depth[0], 0.0, 0.0])  # [m], into the left side as deep as is expected
HOLDING = replace(ROBUST, grip=(0.8, 0.12))  # so well that it holds in all pushes that are drawn to stick


def directions(g: Array, seed: int) -> list[Feeling]:
    """What touch says of where it is touched."""
    angle = direction_rows(g, 0.0, 0.0, TIP)[0][:, 0]
    angle += np.random.default_rng(seed).normal(0.0, FELT, len(g))
    return [Feeling(None, ContactDirection(one, FELT**2), None) for one in angle]


class Told:
    """A touch that says the next of what it is given."""

    def __init__(self, said: list[Feeling]) -> None:
        self.said = iter(said)

    def feel(self, frame: Frame) -> Feeling:
        return next(self.said)

    def lift(self) -> None:
        pass


def two_pushes(friction: Array, steps: int = 80) -> tuple[Array, Array, Array]:
    """Object and sensor poses, and contact: pushed above its centre, let go and pushed below it, always sticking."""
    objects, sensors, first = [], [], np.zeros(3)
    for y in (0.045, -0.045):
        g = touching(TIP, np.array([y])) + DEEPER
        o, e = push(TIP, first[None], g, steps, Steering(), friction=friction)
        away = se2.compose(o[-1, 0], np.tile([-0.25, 0.0, 0.0], (10, 1)))
        objects += [o[:, 0], np.tile(o[-1, 0], (10, 1))]
        sensors += [e[:, 0], away]
        first = o[-1, 0]
    contact = np.tile(np.repeat([True, False], [steps + 1, 10]), 2)
    return np.concatenate(objects), np.concatenate(sensors), contact


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "true", [(math.log(2.0), 0.15, -0.1, 0.8), (math.log(0.7), -0.2, 0.15, 0.8)], ids=["wider", "narrower"]
)
def test_friction_is_learnt_from_one_contact_to_the_next(true, seed):
    true = np.array(true)
    o, e, contact = two_pushes(true)
    e = noisy(e, ROBUST.sensor, np.random.default_rng(seed))
    told = Told(directions(se2.between(o, e)[contact], seed))
    how = TrackerSettings(noise=HOLDING)
    tracker = Tracker(SHAPES["rectangle"], sensor(), o[0], how, touch=told)
    known = [tracker._known]
    for frame in frames(o, e, contact):
        tracker.update(frame)
        known.append(tracker._known)
    prior, first, resting, last = (known[k] for k in (0, 81, 91, -1))
    # What is known rests with the object, the pose aside.
    np.testing.assert_array_equal(resting.lasting, first.lasting)
    np.testing.assert_array_equal(resting.covariance, first.covariance)
    what = slice(0, 3)  # not the grip, which needs slides
    error = [np.abs(each.lasting[FRICTION] - true)[what] for each in (prior, first, last)]
    deviation = [np.sqrt(np.diag(each.covariance)[3:][FRICTION])[what] for each in (prior, first, last)]
    # c^2 and the centre come closer than they were held to be, the centre by far, and are as well known as said.
    assert (error[-1] < error[0]).all()
    assert (error[-1][1:] < 0.6 * error[0][1:]).all()
    assert (deviation[2] < deviation[1]).all()
    assert (deviation[1] < deviation[0]).all()
    assert (deviation[2][1:] < 0.5 * deviation[0][1:]).all()
    assert (error[2] < 3.0 * deviation[2]).all()
    # One contact tells a single number of the centre's two and c, the second one, which begins with that, another.
    assert (deviation[2][1:] < 0.5 * deviation[1][1:]).all()
    off = se2.log(se2.between(last.pose, o[-1]))
    assert off @ np.linalg.solve(last.covariance[:3, :3], off) < 11.3  # 99 %


def slid(y: float, heading: float, grip: float, steps: int) -> tuple[Array, Array]:
    """Object and sensor poses of a push by which the sensor slides along the rectangle's left side.

    The sensor goes straight on at an angle of heading [rad] from the side's normal at first, outside the friction cone.
    The object moves as the balance says with the force at the cone's edge, and the sensor stays on its side.
    """
    friction, side = (0.0, 0.0, 0.0, grip), np.sign(heading)
    g = touching(TIP, y) + DEEPER
    on_normal_balance_and_cone = [0, 2, 3]
    touches, sensors = [g], [g]
    for _ in range(steps):
        e = sensors[-1] + 1e-3 * np.array([math.cos(heading), math.sin(heading), 0.0])
        g = touches[-1]
        for _ in range(8):
            residual, jacobian = pushing_rows(touches[-1], sensors[-1], g, e, TIP, friction, side)
            kept = residual[on_normal_balance_and_cone]
            g = se2.compose(g, se2.exp(-np.linalg.solve(jacobian[on_normal_balance_and_cone, 6:9], kept)))
        touches.append(g)
        sensors.append(e)
    return se2.compose(np.array(sensors), se2.inverse(np.array(touches))), np.array(sensors)


def followed(o: Array, e: Array, noise: GraphNoise, seed: int) -> tuple[Belief, float, float]:
    """The belief at the end of a contact in which directions are felt, its error along the side [m] and its NEES."""
    told = directions(se2.between(o, e), seed)
    seen = noisy(e, ROBUST.sensor, np.random.default_rng(seed))
    smoother = FixedLagSmoother([TIP], noise)
    smoother.begin(seen[0], known_at(o[0], noise), told[0])
    for pose, feeling in zip(seen[1:], told[1:], strict=True):
        smoother.add(pose, feeling)
    belief = smoother.belief()
    error = se2.log(se2.between(belief.known.pose, o[-1]))
    covariance = belief.known.covariance[:3, :3]
    along = belief.g[1] - se2.between(o[-1], e[-1])[1]
    return belief, float(along), float(error @ np.linalg.solve(covariance, error))


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
    angle = pushing_angles(g, e, TIP, (0.0, 0.0, 0.0, grip))
    np.testing.assert_allclose(angle, np.sign(heading) * math.atan(grip), atol=0.01)
    belief, along, nees = followed(o, e, ROBUST, seed)
    assert abs(along) < 0.5 * abs(way)
    assert nees < 11.3  # 99 %
    # Of a slide the grip is learnt as well.
    assert belief.known.covariance[-1, -1] < 0.7 * ROBUST.grip[1] ** 2
    # Taken for sticking it is missed altogether, and nothing says so.
    _, along, nees = followed(o, e, STICKING, seed)
    assert abs(along) > 0.9 * abs(way)
    assert nees > 100.0


def test_a_push_that_sticks_is_not_taken_for_a_slide():
    # Well inside the cone the defaults are as sure of the place along the side as sticking says.
    g = touching(TIP, np.array([0.005])) + DEEPER
    o, e = (poses[:, 0] for poses in push(TIP, np.zeros((1, 3)), g, 60, Steering()))
    assert np.abs(pushing_angles(se2.between(o, e), e, TIP, (0.0, 0.0, 0.0, 0.4))).max() < 0.2
    for seed in range(2):
        belief, along, nees = followed(o, e, ROBUST, seed)
        assert abs(along) < 1.5e-3
        assert nees < 11.3
        assert np.sqrt(belief.covariance[1, 1]) < 1.5e-3
        np.testing.assert_allclose(belief.lasting[-1], ROBUST.grip[0], atol=0.01)
