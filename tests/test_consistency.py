"""Whether the covariance means what it says, on pushes drawn from the estimator's own model.

The graph has two Gaussians on the gap between tip and outline: contact says what it is, the normal row of sticking how
it changes in a step. A draw of one alone would contradict the other, so `draw_residuals` draws from their product.
Kernels are off, for a Cauchy kernel is not the likelihood of the Gaussians drawn.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from push_samples import noisy, tips_of, touching

from palpate import se2
from palpate.evaluation.metrics import nees
from palpate.graph import factors
from palpate.graph.fixed_lag import FixedLagSmoother
from palpate.graph.isam2 import Isam2Smoother
from palpate.graph.noise import GraphNoise
from palpate.measurement import ContactDirection, Feeling, RelativePoses, Turn
from palpate.simulation.limit_surface import Steering, draw_residuals, push
from palpate.touch.relative import compared_frames

Array = np.ndarray
TOLD = replace(GraphNoise(), pushing_kernel=None, contact_kernel=None, feeling_kernel=None)
FELT = 0.01  # [rad], what directions and turns are told to be known to
STEPS, LAG = 16, 13  # the last steps marginalise, and drop pairs, which costs information but not consistency


@dataclass(frozen=True)
class Draw:
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
    gap, slip, torque = draw_residuals(tip, noise, steering.speed, np.pi, STEPS, count, rng)
    g = touching(tip, rng.uniform(-0.03, 0.03, count), rng.uniform(-0.2, 0.2, count))
    g[:, 0] -= gap
    anywhere = rng.uniform(-np.pi, np.pi, (count, 3))
    o, e = push(tip, anywhere, g, STEPS, steering, rng.uniform(0, 2 * np.pi, count), slip, torque)
    g = se2.between(o, e)
    relative = [noisy(se2.between(g[t - compared_frames(t)], g[t]), noise.tactile, rng) for t in range(STEPS + 1)]
    first, measured = noisy(o[0], noise.first_pose, rng), noisy(e, noise.sensor, rng)
    directions = factors.direction(g, 0.0, tip)[0][..., 0] + rng.normal(0.0, direction, g.shape[:-1])
    turns = g[..., 2] - rng.uniform(-np.pi, np.pi, count) + rng.normal(0.0, turn, g.shape[:-1])
    return Draw(o, e, first, measured, relative, directions, se2.wrap(turns))


def last_nees(name: str, drawn: Draw, felt: bool = False) -> Array:
    """NEES (count,) of the object pose at the last step, of sequences drawn with any noise and estimated with TOLD.

    Touch says relative poses, or directions and turns.
    """
    tactile = np.diag(np.square(TOLD.tactile))
    poses, covariances = [], []
    for k in range(len(drawn.first)):
        tips = tips_of("rectangle")
        smoother = Isam2Smoother(tips, TOLD) if name == "isam2" else FixedLagSmoother(tips, TOLD, LAG)
        feelings = [
            Feeling(None, ContactDirection(direction, FELT**2), Turn(turn, FELT**2)) if felt else Feeling()
            for direction, turn in zip(drawn.direction[:, k], drawn.turn[:, k], strict=True)
        ]
        smoother.begin(drawn.sensor[0, k], drawn.first[k], np.diag(np.square(TOLD.first_pose)), feelings[0])
        for t in range(1, STEPS + 1):
            back = compared_frames(t)
            covariance = np.broadcast_to(tactile, (len(back), 3, 3))
            relative = RelativePoses(back, drawn.relative[t][:, k], covariance)
            smoother.add(drawn.sensor[t, k], feelings[t] if felt else Feeling(relative))
        belief = smoother.belief()
        by_both = np.hstack([-se2.adjoint(belief.g), se2.adjoint(belief.g)])  # o = e g^-1
        poses.append(se2.compose(belief.e, se2.inverse(belief.g)))
        covariances.append(by_both @ belief.covariance @ by_both.T)
    return nees(np.array(poses), np.array(covariances), drawn.object_poses[-1])


def interval(count: int) -> tuple[float, float]:
    """95 % of the means of count NEES of 3 degrees of freedom lie here: chi^2 of 3 count degrees, over count."""
    from scipy.stats import chi2

    low, high = chi2.ppf([0.025, 0.975], 3 * count) / count
    return float(low), float(high)


@pytest.mark.parametrize("name", ["fixed-lag", "isam2"])
def test_mean_nees_lies_in_its_interval(name):
    found = last_nees(name, draw(TOLD, 200, 0))
    low, high = interval(200)  # 2.67 to 3.35
    assert low < found.mean() < high
    # Not only the mean: 95 % of them below the 95 % point of chi^2_3, 7.81, within 3.1 binomial deviations of 1.5 %.
    assert 0.90 < np.mean(found < 7.815) <= 1.0


LARGER = {
    # After 16 steps the first pose decides most of where the object is; of the rest it takes more.
    "first pose": replace(TOLD, first_pose=tuple(2 * np.array(TOLD.first_pose))),
    "sticking": replace(TOLD, sticking=4 * TOLD.sticking, sticking_share=4 * TOLD.sticking_share),
    "tactile": replace(TOLD, tactile=(1.0, 1.0, 5 * TOLD.tactile[2])),
    "sensor": replace(TOLD, sensor=tuple(5 * np.array(TOLD.sensor))),
}


@pytest.mark.parametrize("what", LARGER)
def test_noise_larger_than_told_shows(what):
    found = last_nees("fixed-lag", draw(LARGER[what], 40, 1))
    assert found.mean() > interval(40)[1]


@pytest.mark.parametrize("name", ["fixed-lag", "isam2"])
def test_mean_nees_with_direction_and_turn_lies_in_its_interval(name):
    found = last_nees(name, draw(TOLD, 80, 2), felt=True)
    low, high = interval(80)  # 2.49 to 3.56
    assert low < found.mean() < high
    assert 0.87 < np.mean(found < 7.815) <= 1.0  # 95 %, less 3.1 binomial deviations of 2.4 %


@pytest.mark.parametrize(("direction", "turn"), [(0.05, FELT), (FELT, 0.05)])
def test_angles_noisier_than_told_show(direction, turn):
    found = last_nees("fixed-lag", draw(TOLD, 40, 3, direction, turn), felt=True)
    assert found.mean() > interval(40)[1]
