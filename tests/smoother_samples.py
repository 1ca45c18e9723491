"""Contacts as smoothers are given them, and their solution by SciPy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from push_samples import contact_rows, direction_rows, noisy, pushed, pushing_rows, sensor, tips_of
from scipy.optimize import least_squares

from palpate.geometry import se2
from palpate.graph import factors, make_smoother
from palpate.graph.factors import ContactModel
from palpate.graph.noise import GraphNoise
from palpate.graph.smoother import LASTING, OFFSET_SIGMA, Belief, Known, Smoother
from palpate.recording.measurements import ContactDirection, Feeling, RelativePoses, Turn
from palpate.touch.relative import compared_frames

Array = np.ndarray
ROBUST = GraphNoise(
    tactile=(1.0, 1.0, 0.02),
    sticking_share=0.03,
    sliding_share=3.0,
    cone_margin=0.05,
    cone_share=0.2,
    sticking_kernel=5.0,
    turning_share=0.03,
    friction_ratio=(0.2, 0.3),
    friction_center=0.12,
    grip=(0.4, 0.12),
    direction_share=0.8,
    turn_share=20.0,
)
"""With all kernels and weights that depend on the estimate, as the defaults have them, but with numbers that tests of
smoothing may rely on: the defaults move with what `palpate tune` finds."""
PLAIN = replace(
    ROBUST,
    sliding_share=ROBUST.sticking_share,
    cone_share=None,
    sticking_kernel=None,
    turning_kernel=None,
    contact_kernel=None,
    feeling_kernel=None,
    direction_share=0.4,
    turn_share=4.0,
)
"""No weight depends on the estimate, so that what is solved is one least-squares problem."""
POSES = slice(0, 6)
"""Of a belief's unknowns, g and e."""
TWO_TIPS = ((0.0, 0.025), (0.0, -0.025))


@dataclass(frozen=True)
class Contact:
    """What a smoother is given of one contact."""

    truth: Array  # g, (N, 3)
    tips: list[ContactModel]
    sensor: Array  # (N, 3)
    known: Known
    relative: list[RelativePoses | None]
    directions: list[ContactDirection | None]
    turns: list[Turn | None]

    def feeling(self, t: int) -> Feeling:
        return Feeling(self.relative[t], self.directions[t], self.turns[t])


OFFSET = math.pi - 0.06  # [rad]; the sensor's yaw on the object, about 0.05, makes turns fall on both sides of +-pi
FELT = 0.01  # [rad], the standard deviation of directions and turns


def contact(
    steps: int,
    noise: GraphNoise,
    seed: int = 0,
    tips: Any = ((0.0, 0.0),),
    name: str = "rectangle",
) -> Contact:
    """A push with relative poses at most steps; `felt` adds the rest."""
    rng = np.random.default_rng(seed)
    o, e = pushed(name, steps)
    if len(tips) > 1:  # two points on one side hold the object as they are
        o = se2.compose(e, se2.inverse(np.array([-0.2363 / 2, 0.01, 0.0])))
    g = se2.between(o, e)
    covariance = np.diag(np.square(noise.tactile))
    covariance[0, 2] = covariance[2, 0] = 0.3 * noise.tactile[0] * noise.tactile[2]  # not every one is diagonal
    relative: list[RelativePoses | None] = [None]
    for t in range(1, steps + 1):
        back = np.append(compared_frames(t), 2 if t > 2 else [])[:].astype(int)
        pose = noisy(se2.between(g[t - back], g[t]), (0.5, 0.5, noise.tactile[2]), rng)
        said = RelativePoses(back, pose, np.broadcast_to(covariance, (len(back), 3, 3)))
        relative.append(said if len(back) and t % 7 else None)
    return Contact(
        g,
        tips_of(name, sensor(tips=tuple(tips))),
        noisy(e, noise.sensor, rng),
        known_at(noisy(o[0], noise.first_pose, rng), noise, 1e-7 * np.ones((3, 3))),
        relative,
        [None] * (steps + 1),
        [None] * (steps + 1),
    )


def known_at(pose: Array, noise: GraphNoise, more: Array | float = 0.0, lasting: Array | None = None) -> Known:
    """What is known of an object before its first contact, its pose with some more covariance (3, 3)."""
    mean, deviation = noise.lasting
    covariance = np.diag(np.square(np.concatenate([noise.first_pose, deviation])))
    return Known(pose, mean if lasting is None else lasting, covariance).loosened(np.broadcast_to(more, (3, 3)))


def felt(given: Contact, direction: bool = True, turn: bool = True, seed: int = 0, first: int = 0) -> Contact:
    """The same contact with directions and turns at most steps from the first one that has any."""
    rng = np.random.default_rng(seed)
    steps = len(given.truth)
    angle = direction_rows(given.truth, 0.0, 0.0, given.tips[0])[0][:, 0] + rng.normal(0.0, FELT, steps)
    yaw = given.truth[:, 2] - OFFSET + rng.normal(0.0, FELT, steps)
    said = [t >= first and t % 4 != 3 for t in range(steps)]
    directions = [ContactDirection(angle[t], FELT**2) if direction and said[t] else None for t in range(steps)]
    turns = [Turn(se2.wrap(float(yaw[t])), FELT**2) if turn and said[t] else None for t in range(steps)]
    return replace(given, directions=directions, turns=turns)


def without_relative(given: Contact) -> Contact:
    return replace(given, relative=[None] * len(given.relative))


def fed(smoother: Smoother, given: Contact, check: bool = False) -> Smoother:
    smoother.begin(given.sensor[0], given.known, given.feeling(0))
    for t in range(1, len(given.sensor)):
        smoother.add(given.sensor[t], given.feeling(t))
        if check:
            covariance = smoother.belief().covariance
            np.testing.assert_allclose(covariance, covariance.T, rtol=1e-6, atol=1e-18)
            assert np.linalg.eigvalsh(covariance).min() > 0.0
            g, e = smoother.path()
            assert g.shape == e.shape == (t + 1, 3)
            np.testing.assert_allclose(g[-1], smoother.belief().g, atol=1e-12)
            np.testing.assert_allclose(e[-1], smoother.belief().e, atol=1e-12)
    return smoother


def make(name: str, given: Contact, noise: GraphNoise) -> Smoother:
    chosen: Any = name
    return make_smoother(chosen, given.tips, noise)


@dataclass(frozen=True)
class Solved:
    """A contact solved at once."""

    poses: Array  # (N, 2, 3)
    lasting: Array  # (LASTING,)
    offset: float  # of the turns
    covariance: Array  # (6 + LASTING, 6 + LASTING), of the last step and what lasts


def batch(given: Contact, noise: GraphNoise) -> Solved:
    """The whole contact at once, by SciPy, from the factors; with weights that do not depend on the estimate."""
    known = given.known
    root = np.linalg.inv(np.linalg.cholesky(known.covariance))
    moved = np.hypot(*np.diff(given.sensor[:, :2], axis=0).T)
    resting = np.broadcast_to(se2.between(known.pose, given.sensor[0]), given.sensor.shape)
    start = np.stack([resting, given.sensor], axis=1)
    nothing = RelativePoses(np.empty(0, int), np.empty((0, 3)), np.empty((0, 3, 3)))
    said = [(t, relative or nothing) for t, relative in enumerate(given.relative)]
    i = np.concatenate([t - relative.back for t, relative in said])
    j = np.concatenate([np.full(len(relative.back), t) for t, relative in said])
    measured = np.concatenate([relative.pose for _, relative in said])
    whiten = np.linalg.inv(np.linalg.cholesky(np.concatenate([relative.covariance for _, relative in said])))
    directed, direction = angles_of(given.directions)
    turned, turn = angles_of(given.turns)
    direction_sigma, turn_sigma = FELT * np.sqrt([noise.direction_share, noise.turn_share])
    first_offset = resting[0, 2] - turn[0] if len(turn) else 0.0
    still, ahead = np.zeros((len(moved), 4)), np.zeros(len(moved))
    roots = [np.sqrt(noise.pushing_weight(still, moved, tip, ahead, grip=1.0)) for tip in given.tips]

    def residuals(offset: float, lasting: Array, poses: Array) -> Array:
        g, e = poses[:, 0], poses[:, 1]
        bias, depth, *friction = lasting
        rows = [root @ factors.known(g[0], e[0], lasting, known.pose, known.lasting)[0]]
        rows.append(factors.prior(e, given.sensor)[0] / noise.sensor)
        for tip, of_pushing in zip(given.tips, roots, strict=True):
            rows.append(contact_rows(g, depth, tip)[0] / noise.contact)
            rows.append(of_pushing * pushing_rows(g[:-1], e[:-1], g[1:], e[1:], tip, friction, 1.0)[0])
        rows.append(np.einsum("nij,nj->ni", whiten, factors.between(g[i], g[j], measured)[0]))
        rows.append(direction_rows(g[directed], direction, bias, given.tips[0])[0] / direction_sigma)
        rows.append(se2.wrap(g[turned, 2] - offset - turn) / turn_sigma)
        rows.append(np.array([offset / OFFSET_SIGMA]))
        return np.concatenate([row.ravel() for row in rows])

    def at(change: Array) -> tuple[float, Array, Array]:
        poses = se2.compose(start, se2.exp(change[1 + LASTING :].reshape(start.shape)))
        return first_offset + change[0], known.lasting + change[1 : 1 + LASTING], poses

    size = 1 + LASTING + start.size
    # Depth and bias are far smaller than poses: without a scale the end of the search would be hard to tell.
    solved = least_squares(
        lambda change: residuals(*at(change)), np.zeros(size), method="lm", x_scale="jac", xtol=1e-11
    )
    offset, lasting, poses = at(solved.x)

    def near(step: Array) -> Array:
        moves = step[1 + LASTING :].reshape(start.shape)
        return residuals(offset + step[0], lasting + step[1 : 1 + LASTING], se2.compose(poses, se2.exp(moves)))

    jacobian = np.stack([(near(step) - near(-step)) / 2e-6 for step in 1e-6 * np.eye(size)], axis=-1)
    last = [*range(size - 6, size), *range(1, 1 + LASTING)]
    covariance = np.linalg.inv(jacobian.T @ jacobian)[np.ix_(last, last)]
    return Solved(poses, lasting, offset, covariance)


def angles_of(said: Sequence[ContactDirection | Turn | None]) -> tuple[Array, Array]:
    """The steps (P,) at which something was said, and the angles (P,)."""
    steps = [t for t, one in enumerate(said) if one is not None]
    return np.array(steps, int), np.array([one.angle for one in said if one is not None])


def apart(poses: tuple[Array, Array], wanted: Array) -> Array:
    """Largest difference per coordinate (3,) between paths."""
    return np.abs(se2.log(se2.between(np.stack(poses, axis=1), wanted))).max(axis=(0, 1))


def scaled_difference(belief: Belief, other: Solved | Belief, unknowns: slice = slice(None)) -> tuple[float, float]:
    """Largest difference of mean and of covariance from the other's, in its standard deviations and variances."""
    g, e = other.poses[-1] if isinstance(other, Solved) else (other.g, other.e)
    deviation = np.sqrt(np.diag(other.covariance))
    poses = [se2.log(se2.between(belief.g, g)), se2.log(se2.between(belief.e, e))]
    mean = np.concatenate([*poses, other.lasting - belief.lasting]) / deviation
    difference = (belief.covariance - other.covariance) / np.outer(deviation, deviation)
    return float(np.abs(mean[unknowns]).max()), float(np.abs(difference[unknowns, unknowns]).max())
