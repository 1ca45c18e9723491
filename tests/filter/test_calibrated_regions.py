"""Whether the covariance means what it says, on pushes drawn from the estimator's own model.

The graph has two Gaussians on the gap between tip and outline: contact says what it is, the normal row of sticking how
it changes in a step. A draw of one alone would contradict the other, so `draw_residuals` draws from their product.
Kernels are off, for a Cauchy kernel is not the likelihood of the Gaussians drawn. What belongs to the object is drawn
from its prior as well, but that the contact always sticks, at whatever angle it is pushed.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from push_samples import contact_directions, model_of, noisy, touching, with_settings
from smoother_samples import FELT, PLAIN, lagged_begin, prior_at

from palpate.config import NoiseSettings
from palpate.filter.belief import Belief
from palpate.geometry import se2
from palpate.graph.smoother import make_smoother
from palpate.graph.variables import (
    DEPTH,
    DIRECTION_BIAS,
    DIRECTION_SCALE,
    FRICTION_CENTER,
    FRICTION_RATIO,
    GRIP,
    IN_OBJECT,
    OBJECT_SIZE,
    OUTLINE_SCALE,
    PLACE_BIAS,
)
from palpate.lab.simulate.limit_surface import Steering, draw_residuals, push
from palpate.pipeline.metrics import nees
from palpate.touch.relative import compared_frames
from palpate.types.measurements import ContactDirection, Measurement, RelativePoses, Turn

Array = np.ndarray
TOLD = PLAIN
STEPS, LAG = 16, 13  # the last steps marginalise, and drop pairs, which costs information but not consistency


@dataclass(frozen=True)
class Draw:
    values: Array  # (count, OBJECT_SIZE)
    object_poses: Array  # (N, count, 3)
    sensor_poses: Array
    first: Array  # (count, 3), measured
    sensor: Array  # (N, count, 3), measured
    relative: list[Array]  # for each step the measured poses (P, count, 3)
    direction: Array  # (N, count), measured
    turn: Array  # (N, count), measured, with an offset for each of count


@cache
def draw(noise: NoiseSettings, count: int, seed: int, direction: float = FELT, turn: float = FELT) -> Draw:
    """Count pushes on the rectangle's left side and all that is measured in them, with this noise."""
    rng = np.random.default_rng(seed)
    model, steering = model_of("rectangle"), Steering()
    values = noise.priors.mean + rng.normal(size=(count, OBJECT_SIZE)) * noise.priors.deviation
    friction = {unknown: values[:, IN_OBJECT[unknown]].T for unknown in (FRICTION_RATIO, FRICTION_CENTER)}
    gap, slip, torque = draw_residuals(model, noise, steering.speed, np.pi, STEPS, count, rng)
    g = touching(model, rng.uniform(-0.03, 0.03, count), rng.uniform(-0.2, 0.2, count))
    reach = 0.5 * 0.2363
    g[:, 0] -= gap - values[:, IN_OBJECT[DEPTH]][:, 0] + values[:, IN_OBJECT[OUTLINE_SCALE]][:, 0] * reach
    anywhere, phase = rng.uniform(-np.pi, np.pi, (count, 3)), rng.uniform(0, 2 * np.pi, count)
    o, e = push(model, anywhere, g, STEPS, steering, phase, slip, torque, friction)
    g = se2.between(o, e)
    pairs = noise.relative_pose.oracle
    relative = [noisy(se2.between(g[t - compared_frames(t)], g[t]), pairs, rng) for t in range(STEPS + 1)]
    first, measured = noisy(o[0], noise.first_pose.deviation, rng), noisy(e, noise.sensor_pose.deviation, rng)
    directions = contact_directions(g, model) + values[:, IN_OBJECT[DIRECTION_BIAS]][:, 0]
    directions /= 1.0 - values[:, IN_OBJECT[DIRECTION_SCALE]][:, 0]
    directions += rng.normal(0.0, direction * np.sqrt(noise.direction.share), g.shape[:-1])
    turns = g[..., 2] - rng.uniform(-np.pi, np.pi, count)
    turns += rng.normal(0.0, turn * np.sqrt(noise.turn.share), g.shape[:-1])
    return Draw(values, o, e, first, measured, relative, directions, se2.wrap(turns))


def estimated(name: str, drawn: Draw, felt: bool = False) -> list[Belief]:
    """Beliefs at the last step, of sequences drawn with any noise and estimated with TOLD.

    Touch says relative poses, or directions and turns.
    """
    pair = np.diag(np.square(TOLD.relative_pose.oracle))
    model = model_of("rectangle")
    begin = make_smoother("isam2", TOLD, model) if name == "isam2" else lagged_begin(LAG, TOLD, model)

    def said(t: int, k: int) -> tuple[Measurement, ...]:
        if felt:
            return ContactDirection(drawn.direction[t, k], FELT**2), Turn(drawn.turn[t, k], FELT**2)
        back = compared_frames(t)
        covariance = np.broadcast_to(pair, (len(back), 3, 3))
        return (RelativePoses(back, drawn.relative[t][:, k], covariance),) if t else ()

    found = []
    for k in range(len(drawn.first)):
        smoother = begin(prior_at(drawn.first[k], TOLD), drawn.sensor[0, k], said(0, k), 0.0)
        for t in range(1, STEPS + 1):
            smoother.add(drawn.sensor[t, k], said(t, k), t / 30)
        found.append(smoother.belief())
    return found


@cache
def last_beliefs(name: str, count: int, seed: int, felt: bool) -> list[Belief]:
    """The same, of sequences drawn with TOLD."""
    return estimated(name, draw(TOLD, count, seed), felt)


def last_nees(beliefs: list[Belief], drawn: Draw) -> Array:
    """NEES (count,) of the object pose at the last step."""
    known = [belief.prior for belief in beliefs]
    covariances = np.array([each.pose_covariance for each in known])
    return nees(np.array([each.pose for each in known]), covariances, drawn.object_poses[-1])


def nees_of(error: Array, covariance: Array) -> Array:
    """NEES (N,) of errors (N, K) with covariances (N, K, K)."""
    return np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])


def interval(count: int, freedom: int = 3) -> tuple[float, float]:
    """95 % of the means of count NEES of so many degrees of freedom lie here: chi^2 of that times count, over count."""
    from scipy.stats import chi2

    low, high = chi2.ppf([0.025, 0.975], freedom * count) / count
    return float(low), float(high)


@pytest.mark.parametrize(("name", "count"), [("fixed-lag", 200), ("isam2", 100)])
def test_mean_nees_lies_in_its_interval(name, count):
    found = last_nees(last_beliefs(name, count, 0, False), draw(TOLD, count, 0))
    low, high = interval(count)  # 2.67 to 3.35, 2.54 to 3.50
    assert low < found.mean() < high
    # Not only the mean: 95 % of them below the 95 % point of chi^2_3, 7.81, within 3.1 binomial deviations.
    assert 0.95 - 3.1 * np.sqrt(0.95 * 0.05 / count) < np.mean(found < 7.815) <= 1.0


def times(factor: float, deviations: tuple[float, ...]) -> tuple[float, ...]:
    return tuple((factor * np.array(deviations)).tolist())


LARGER = {
    # After 16 steps the first pose decides most of where the object is; of the rest it takes more.
    "first pose": with_settings(TOLD, first_pose={"deviation": times(2, TOLD.first_pose.deviation)}),
    "sticking": with_settings(
        TOLD, sticking={"share": 4 * TOLD.sticking.share, "sliding_share": 4 * TOLD.sticking.sliding_share}
    ),
    "relative pose": with_settings(TOLD, relative_pose={"oracle": (1.0, 1.0, 5 * TOLD.relative_pose.oracle[2])}),
    "sensor pose": with_settings(TOLD, sensor_pose={"deviation": times(5, TOLD.sensor_pose.deviation)}),
}


@pytest.mark.parametrize("what", LARGER)
def test_noise_larger_than_told_shows(what):
    drawn = draw(LARGER[what], 40, 1)
    found = last_nees(estimated("fixed-lag", drawn), drawn)
    assert found.mean() > interval(40)[1]


@pytest.mark.parametrize("name", ["fixed-lag", "isam2"])
def test_mean_nees_with_direction_and_turn_lies_in_its_interval(name):
    found = last_nees(last_beliefs(name, 80, 2, True), draw(TOLD, 80, 2))
    low, high = interval(80)  # 2.49 to 3.56
    assert low < found.mean() < high
    assert 0.87 < np.mean(found < 7.815) <= 1.0  # 95 %, less 3.1 binomial deviations of 2.4 %


@pytest.mark.parametrize(("direction", "turn"), [(0.05, FELT), (FELT, 0.1)])
def test_angles_noisier_than_told_show(direction, turn):
    drawn = draw(TOLD, 40, 3, direction, turn)
    found = last_nees(estimated("fixed-lag", drawn, felt=True), drawn)
    assert found.mean() > interval(40)[1]


@pytest.mark.parametrize(("count", "seed", "felt"), [(200, 0, False), (80, 2, True)])
def test_what_belongs_to_the_object_is_known_as_well_as_said(count, seed, felt):
    drawn, beliefs = draw(TOLD, count, seed), last_beliefs("fixed-lag", count, seed, felt)
    error = np.array([belief.values for belief in beliefs]) - drawn.values
    covariance = np.array([belief.covariance[6:, 6:] for belief in beliefs])
    # But grip and places: nothing tells of the one where the contact sticks at whatever angle, and a round tip tells
    # none of the others.
    untold = [IN_OBJECT[GRIP].start, IN_OBJECT[PLACE_BIAS].start]
    rest = np.delete(np.arange(OBJECT_SIZE), untold)
    found = nees_of(error[:, rest], covariance[:, rest[:, None], rest])
    low, high = interval(count, len(rest))  # 6.49 to 7.53, 6.20 to 7.84
    assert low < found.mean() < 1.1**2 * high  # linearised, deviations are some per cent too small
    prior = np.square(TOLD.priors.deviation)
    np.testing.assert_allclose(covariance[:, untold, untold] / prior[untold], 1.0, rtol=1e-6)
    # Something has been learnt: of the depth from the contact, of where the centre of friction is along the side from
    # which way the object turned, of the bias where directions are felt.
    learnt = np.diagonal(covariance, axis1=1, axis2=2).mean(axis=0) / prior
    depth, scale = IN_OBJECT[DEPTH].start, IN_OBJECT[OUTLINE_SCALE].start
    apart = np.array([1.0, -0.5 * 0.2363])  # by the depth and by what the object is larger
    together = np.ix_(range(count), [depth, scale], [depth, scale])
    assert (covariance[together] @ apart @ apart).mean() < 0.6 * (prior[[depth, scale]] @ apart**2)
    assert learnt[IN_OBJECT[FRICTION_CENTER]][1] < 0.6
    bias = learnt[IN_OBJECT[DIRECTION_BIAS]]
    assert bias < 0.5 if felt else bias == pytest.approx(1.0)
