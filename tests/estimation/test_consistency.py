"""Whether the covariance means what it says, on pushes drawn from the estimator's own model.

The graph has two Gaussians on the gap between tip and outline: contact says what it is, the normal row of sticking how
it changes in a step. A draw of one alone would contradict the other, so `draw_residuals` draws from their product.
Kernels are off, for a Cauchy kernel is not the likelihood of the Gaussians drawn. What lasts is drawn from its prior as
well, but that the contact always sticks, at whatever angle it is pushed.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from push_samples import direction_rows, noisy, tips_of, touching
from smoother_samples import PLAIN, known_at

from palpate.geometry import se2
from palpate.graph.fixed_lag import FixedLagSmoother
from palpate.graph.isam2 import Isam2Smoother
from palpate.graph.noise import GraphNoise
from palpate.graph.smoother import DEPTH, FRICTION, LASTING, Belief
from palpate.recording.measurements import ContactDirection, Feeling, RelativePoses, Turn
from palpate.simulation.limit_surface import Steering, draw_residuals, push
from palpate.touch.relative import compared_frames
from palpate.tracking.metrics import nees

Array = np.ndarray
TOLD = PLAIN
FELT = 0.01  # [rad], what directions and turns are told to be known to
STEPS, LAG = 16, 13  # the last steps marginalise, and drop pairs, which costs information but not consistency


@dataclass(frozen=True)
class Draw:
    lasting: Array  # (count, LASTING)
    object_poses: Array  # (N, count, 3)
    sensor_poses: Array
    first: Array  # (count, 3), measured
    sensor: Array  # (N, count, 3), measured
    relative: list[Array]  # for each step the measured poses (P, count, 3)
    direction: Array  # (N, count), measured
    turn: Array  # (N, count), measured, with an offset for each of count


@cache
def draw(noise: GraphNoise, count: int, seed: int, direction: float = FELT, turn: float = FELT) -> Draw:
    """Count pushes on the rectangle's left side and all that is measured in them, with this noise."""
    rng = np.random.default_rng(seed)
    tip, steering = tips_of("rectangle")[0], Steering()
    mean, deviation = noise.lasting
    lasting = mean + rng.normal(size=(count, LASTING)) * deviation
    gap, slip, torque = draw_residuals(tip, noise, steering.speed, np.pi, STEPS, count, rng)
    g = touching(tip, rng.uniform(-0.03, 0.03, count), rng.uniform(-0.2, 0.2, count))
    g[:, 0] -= gap - lasting[:, DEPTH]
    anywhere, phase = rng.uniform(-np.pi, np.pi, (count, 3)), rng.uniform(0, 2 * np.pi, count)
    o, e = push(tip, anywhere, g, STEPS, steering, phase, slip, torque, lasting[:, FRICTION])
    g = se2.between(o, e)
    relative = [noisy(se2.between(g[t - compared_frames(t)], g[t]), noise.tactile, rng) for t in range(STEPS + 1)]
    first, measured = noisy(o[0], noise.first_pose, rng), noisy(e, noise.sensor, rng)
    directions = direction_rows(g, 0.0, lasting[:, 0], tip)[0][..., 0]
    directions += rng.normal(0.0, direction * np.sqrt(noise.direction_share), g.shape[:-1])
    turns = g[..., 2] - rng.uniform(-np.pi, np.pi, count)
    turns += rng.normal(0.0, turn * np.sqrt(noise.turn_share), g.shape[:-1])
    return Draw(lasting, o, e, first, measured, relative, directions, se2.wrap(turns))


def estimated(name: str, drawn: Draw, felt: bool = False) -> list[Belief]:
    """Beliefs at the last step, of sequences drawn with any noise and estimated with TOLD.

    Touch says relative poses, or directions and turns.
    """
    tactile = np.diag(np.square(TOLD.tactile))
    found = []
    for k in range(len(drawn.first)):
        tips = tips_of("rectangle")
        smoother = Isam2Smoother(tips, TOLD) if name == "isam2" else FixedLagSmoother(tips, TOLD, LAG)
        feelings = [
            Feeling(None, ContactDirection(direction, FELT**2), Turn(turn, FELT**2)) if felt else Feeling()
            for direction, turn in zip(drawn.direction[:, k], drawn.turn[:, k], strict=True)
        ]
        smoother.begin(drawn.sensor[0, k], known_at(drawn.first[k], TOLD), feelings[0])
        for t in range(1, STEPS + 1):
            back = compared_frames(t)
            covariance = np.broadcast_to(tactile, (len(back), 3, 3))
            relative = RelativePoses(back, drawn.relative[t][:, k], covariance)
            smoother.add(drawn.sensor[t, k], feelings[t] if felt else Feeling(relative))
        found.append(smoother.belief())
    return found


@cache
def last_beliefs(name: str, count: int, seed: int, felt: bool) -> list[Belief]:
    """The same, of sequences drawn with TOLD."""
    return estimated(name, draw(TOLD, count, seed), felt)


def last_nees(beliefs: list[Belief], drawn: Draw) -> Array:
    """NEES (count,) of the object pose at the last step."""
    known = [belief.known for belief in beliefs]
    covariances = np.array([each.covariance[:3, :3] for each in known])
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


LARGER = {
    # After 16 steps the first pose decides most of where the object is; of the rest it takes more.
    "first pose": replace(TOLD, first_pose=tuple(2 * np.array(TOLD.first_pose))),
    "sticking": replace(TOLD, sticking_share=4 * TOLD.sticking_share, sliding_share=4 * TOLD.sliding_share),
    "tactile": replace(TOLD, tactile=(1.0, 1.0, 5 * TOLD.tactile[2])),
    "sensor": replace(TOLD, sensor=tuple(5 * np.array(TOLD.sensor))),
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
def test_what_lasts_is_known_as_well_as_said(count, seed, felt):
    drawn, beliefs = draw(TOLD, count, seed), last_beliefs("fixed-lag", count, seed, felt)
    error = np.array([belief.lasting for belief in beliefs]) - drawn.lasting
    covariance = np.array([belief.covariance[6:, 6:] for belief in beliefs])
    # But the grip: nothing tells of it where the contact sticks at whatever angle.
    found = nees_of(error[:, :-1], covariance[:, :-1, :-1])
    low, high = interval(count, LASTING - 1)  # 4.57 to 5.45, 4.33 to 5.72
    assert low < found.mean() < high
    prior = np.square(TOLD.lasting[1])
    np.testing.assert_allclose(covariance[:, -1, -1], prior[-1], rtol=1e-6)
    # Something has been learnt: of the depth from the contact, of where the centre of friction is along the side from
    # which way the object turned, of the bias where directions are felt.
    learnt = np.diagonal(covariance, axis1=1, axis2=2).mean(axis=0) / prior
    assert learnt[DEPTH] < 0.8
    assert learnt[FRICTION][2] < 0.6
    assert learnt[0] < 0.5 if felt else learnt[0] == pytest.approx(1.0)
