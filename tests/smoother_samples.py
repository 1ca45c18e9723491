"""Contacts as smoothers are given them, and their solution by SciPy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from push_samples import noisy, pushed, sensor, tips_of
from scipy.optimize import least_squares

from palpate import se2
from palpate.graph import factors, make_smoother
from palpate.graph.factors import ContactModel
from palpate.graph.noise import GraphNoise
from palpate.graph.smoother import OFFSET_SIGMA, Belief, Smoother
from palpate.measurement import ContactDirection, Feeling, RelativePoses, Turn
from palpate.touch.relative import compared_frames

Array = np.ndarray
PLAIN = replace(GraphNoise(), pushing_kernel=None, contact_kernel=None, feeling_kernel=None)
ROBUST = GraphNoise()
TWO_TIPS = ((0.0, 0.025), (0.0, -0.025))


@dataclass(frozen=True)
class Contact:
    """What a smoother is given of one contact."""

    truth: Array  # g, (N, 3)
    tips: list[ContactModel]
    sensor: Array  # (N, 3)
    object_pose: Array
    covariance: Array
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
        noisy(o[0], noise.first_pose, rng),
        np.diag(np.square(noise.first_pose)) + 1e-7 * np.ones((3, 3)),
        relative,
        [None] * (steps + 1),
        [None] * (steps + 1),
    )


def felt(given: Contact, direction: bool = True, turn: bool = True, seed: int = 0, first: int = 0) -> Contact:
    """The same contact with directions and turns at most steps from the first one that has any."""
    rng = np.random.default_rng(seed)
    steps = len(given.truth)
    angle = factors.direction(given.truth, 0.0, given.tips[0])[0][:, 0] + rng.normal(0.0, FELT, steps)
    yaw = given.truth[:, 2] - OFFSET + rng.normal(0.0, FELT, steps)
    said = [t >= first and t % 4 != 3 for t in range(steps)]
    directions = [ContactDirection(angle[t], FELT**2) if direction and said[t] else None for t in range(steps)]
    turns = [Turn(se2.wrap(float(yaw[t])), FELT**2) if turn and said[t] else None for t in range(steps)]
    return replace(given, directions=directions, turns=turns)


def without_relative(given: Contact) -> Contact:
    return replace(given, relative=[None] * len(given.relative))


def fed(smoother: Smoother, given: Contact, check: bool = False) -> Smoother:
    smoother.begin(given.sensor[0], given.object_pose, given.covariance, given.feeling(0))
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


def batch(given: Contact, noise: GraphNoise) -> tuple[Array, Array, float]:
    """The whole contact at once, by SciPy, from the factors.

    Returns poses (N, 2, 3), the covariance (6, 6) of the last step and the offset of the turns.
    """
    root = np.linalg.inv(np.linalg.cholesky(given.covariance))
    moved = np.hypot(*np.diff(given.sensor[:, :2], axis=0).T)
    resting = np.broadcast_to(se2.between(given.object_pose, given.sensor[0]), given.sensor.shape)
    start = np.stack([resting, given.sensor], axis=1)
    nothing = RelativePoses(np.empty(0, int), np.empty((0, 3)), np.empty((0, 3, 3)))
    said = [(t, relative or nothing) for t, relative in enumerate(given.relative)]
    i = np.concatenate([t - relative.back for t, relative in said])
    j = np.concatenate([np.full(len(relative.back), t) for t, relative in said])
    measured = np.concatenate([relative.pose for _, relative in said])
    whiten = np.linalg.inv(np.linalg.cholesky(np.concatenate([relative.covariance for _, relative in said])))
    directed, direction = angles_of(given.directions)
    turned, turn = angles_of(given.turns)
    first_offset = resting[0, 2] - turn[0] if len(turn) else 0.0

    def residuals(offset: float, poses: Array) -> Array:
        g, e = poses[:, 0], poses[:, 1]
        rows = [root @ factors.first_pose(g[0], e[0], given.object_pose)[0]]
        rows.append(factors.prior(e, given.sensor)[0] / noise.sensor)
        for tip in given.tips:
            rows.append(factors.contact(g, tip)[0] / noise.contact)
            rows.append(factors.pushing(g[:-1], e[:-1], g[1:], e[1:], tip)[0] / noise.pushing_sigmas(moved, tip))
        rows.append(np.einsum("nij,nj->ni", whiten, factors.between(g[i], g[j], measured)[0]))
        rows.append(factors.direction(g[directed], direction, given.tips[0])[0] / FELT)
        rows.append(se2.wrap(g[turned, 2] - offset - turn) / FELT)
        rows.append(np.array([offset / OFFSET_SIGMA]))
        return np.concatenate([row.ravel() for row in rows])

    def at(change: Array) -> tuple[float, Array]:
        return first_offset + change[0], se2.compose(start, se2.exp(change[1:].reshape(start.shape)))

    zero = np.zeros(1 + start.size)
    solved = least_squares(lambda change: residuals(*at(change)), zero, method="lm", xtol=1e-11)
    offset, poses = at(solved.x)
    ends = []
    for step in (1e-6, -1e-6):
        moves = step * np.eye(start.size).reshape(-1, *start.shape)
        columns = [residuals(offset + step, poses)] + [residuals(offset, se2.compose(poses, se2.exp(m))) for m in moves]
        ends.append(np.array(columns))
    jacobian = (ends[0] - ends[1]).T / 2e-6
    return poses, np.linalg.inv(jacobian.T @ jacobian)[-6:, -6:], offset


def angles_of(said: Sequence[ContactDirection | Turn | None]) -> tuple[Array, Array]:
    """The steps (P,) at which something was said, and the angles (P,)."""
    steps = [t for t, one in enumerate(said) if one is not None]
    return np.array(steps, int), np.array([one.angle for one in said if one is not None])


def apart(poses: tuple[Array, Array], wanted: Array) -> Array:
    """Largest difference per coordinate (3,) between paths."""
    return np.abs(se2.log(se2.between(np.stack(poses, axis=1), wanted))).max(axis=(0, 1))


def scaled_difference(belief: Belief, poses: Array, covariance: Array) -> tuple[float, float]:
    """Largest difference of mean and of covariance from those wanted, in standard deviations and variances."""
    deviation = np.sqrt(np.diag(covariance))
    mean = np.concatenate([se2.log(se2.between(belief.g, poses[0])), se2.log(se2.between(belief.e, poses[1]))])
    difference = (belief.covariance - covariance) / np.outer(deviation, deviation)
    return float(np.abs(mean / deviation).max()), float(np.abs(difference).max())
