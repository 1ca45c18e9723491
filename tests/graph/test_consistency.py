"""NEES of the window on pushes drawn from the estimator's own model.

Kernels are off, for a Cauchy kernel is not the likelihood of the Gaussians drawn. The object's variables are drawn from
their priors, but that the contact always sticks.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from limit_surface import Steering, push
from push_samples import contact_directions, draw_residuals, model_of, noisy, touching, with_settings
from scipy.stats import chi2
from smoother_samples import FELT, PLAIN, belief_at

from palpate import ContactDirection, NoiseSettings, Turn
from palpate.geometry import se2
from palpate.models.pushing.graph import Graph
from palpate.models.pushing.layout import IN_OBJECT, OBJECT_SIZE
from palpate.models.pushing.measurements import Step
from palpate.models.pushing.priors import object_prior
from palpate.models.pushing.settings import settings_record
from palpate.models.pushing.variables import (
    DEPTH,
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    FRICTION_CENTER,
    FRICTION_RATIO,
    OUTLINE_SCALE,
)
from palpate.models.pushing.window import ContactWindow

Array = np.ndarray
STEPS, LAG = 16, 13  # the last steps marginalise
MODEL = model_of("rectangle")


@dataclass(frozen=True)
class DrawOf:
    """Noise of the pushes, their number, the seed, and deviations of directions and turns [rad]."""

    noise: NoiseSettings
    count: int
    seed: int
    direction: float = FELT
    turn: float = FELT


@dataclass(frozen=True)
class Draw:
    """Pushes on the rectangle's left side and the measurements of them."""

    values: Array  # (count, OBJECT_SIZE)
    object_poses: Array  # (N, count, 3)
    first: Array  # (count, 3), measured
    sensor: Array  # (N, count, 3), measured
    direction: Array  # (N, count), measured
    turn: Array  # (N, count), measured, with an offset for each of count


def draw(of: DrawOf) -> Draw:
    noise, count, rng = of.noise, of.count, np.random.default_rng(of.seed)
    steering = Steering()
    values = (
        object_prior(noise.priors).mean + rng.normal(size=(count, OBJECT_SIZE)) * object_prior(noise.priors).deviation
    )
    friction = {variable: values[:, IN_OBJECT[variable]].T for variable in (FRICTION_RATIO, FRICTION_CENTER)}
    gap, slip, torque = draw_residuals(MODEL, noise, steering.speed, np.pi, STEPS, count, rng)
    g = touching(MODEL, rng.uniform(-0.03, 0.03, count), rng.uniform(-0.2, 0.2, count))
    reach = 0.5 * 0.2363  # from the centre to the left side
    g[:, 0] -= gap - values[:, IN_OBJECT[DEPTH]][:, 0] + values[:, IN_OBJECT[OUTLINE_SCALE]][:, 0] * reach
    anywhere, phase = rng.uniform(-np.pi, np.pi, (count, 3)), rng.uniform(0, 2 * np.pi, count)
    o, e = push(MODEL, anywhere, g, STEPS, steering, phase, slip, torque, friction)
    g = se2.between(o, e)
    first, measured = noisy(o[0], noise.first_pose.deviation, rng), noisy(e, noise.sensor_pose.deviation, rng)
    directions = contact_directions(g, MODEL)
    directions += values[:, IN_OBJECT[DIRECTION_SCALE]][:, 0] * np.sin(directions)
    directions += values[:, IN_OBJECT[DIRECTION_BIAS]][:, 0]
    directions += rng.normal(0.0, of.direction * np.sqrt(noise.direction.share), g.shape[:-1])
    turns = g[..., 2] - rng.uniform(-np.pi, np.pi, count)
    turns += rng.normal(0.0, of.turn * np.sqrt(noise.turn.share), g.shape[:-1])
    return Draw(values, o, first, measured, directions, se2.wrap(turns))


def estimated(drawn: DrawOf, touch: bool) -> tuple[Array, Array]:
    """Return the NEES (count,) of the object pose, and of the object's variables over their number, by PLAIN."""
    given = draw(drawn)
    factors = settings_record(PLAIN, MODEL)

    def said(t: int, k: int) -> tuple[ContactDirection | Turn, ...]:
        if not touch:
            return ()
        return ContactDirection(given.direction[t, k], FELT**2), Turn(given.turn[t, k], FELT**2)

    of_pose, of_variables = [], []
    told = [IN_OBJECT[one].start for one in (DEPTH, FRICTION_RATIO, DIRECTION_BIAS, DIRECTION_SCALE, OUTLINE_SCALE)]
    told += range(*IN_OBJECT[FRICTION_CENTER].indices(OBJECT_SIZE))
    for k in range(drawn.count):
        steps = [Step(given.sensor[t, k], said(t, k)) for t in range(STEPS + 1)]
        window = ContactWindow(Graph(factors, MODEL), belief_at(given.first[k], PLAIN), steps[0], LAG)
        for step in steps[1:]:
            window.add(step)
        belief = window.belief()
        covariance = belief.covariance[0]
        off = se2.log(se2.between(belief.pose[0], given.object_poses[-1, k]))
        of_pose.append(off @ np.linalg.solve(covariance[:3, :3], off))
        off = (given.values[k] - belief.values[0])[told]
        of_variables.append(off @ np.linalg.solve(covariance[3:, 3:][np.ix_(told, told)], off) / len(told))
    return np.array(of_pose), np.array(of_variables)


def interval(count: int, freedom: int = 3) -> tuple[float, float]:
    """Return where 95 % of the means of count NEES of so many degrees of freedom lie."""
    low, high = chi2.ppf([0.025, 0.975], freedom * count) / count
    return float(low), float(high)


@pytest.mark.parametrize("touch", [False, True], ids=["none", "directions and turns"])
def test_nees_of_the_object_pose_is_that_of_three_degrees_of_freedom(touch):
    count = 100
    found, of_variables = estimated(DrawOf(PLAIN, count, 0), touch)
    low, high = interval(count)
    assert low < found.mean() < high
    # Not only the mean: 95 % of them below the 95 % point, within 3.1 binomial deviations.
    assert np.mean(found < chi2.ppf(0.95, 3)) > 0.95 - 3.1 * np.sqrt(0.95 * 0.05 / count)
    # Linearised, deviations are some per cent too small.
    low, high = np.array(interval(count, 7)) / 7
    assert low < of_variables.mean() < 1.1**2 * high


@pytest.mark.parametrize(
    "drawn",
    [
        DrawOf(with_settings(PLAIN, first_pose={"deviation": tuple(2 * x for x in PLAIN.first_pose.deviation)}), 40, 1),
        DrawOf(
            with_settings(PLAIN, sensor_pose={"deviation": tuple(5 * x for x in PLAIN.sensor_pose.deviation)}), 40, 1
        ),
        DrawOf(PLAIN, 40, 3, direction=5 * FELT),
        DrawOf(PLAIN, 40, 3, turn=10 * FELT),
    ],
    ids=["first pose", "sensor pose", "direction", "turn"],
)
def test_noise_larger_than_stated_shows_in_nees(drawn):
    found, _ = estimated(drawn, True)
    assert found.mean() > interval(drawn.count)[1]
