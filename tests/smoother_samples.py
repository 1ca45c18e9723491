"""Contacts as smoothers are given them, and their solution by SciPy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from push_samples import contact_directions, distance_at, model_of, noisy, pushed, sensor, with_settings
from scipy.optimize import least_squares

from palpate import ContactDirection, Measurement, NoiseSettings, Turn
from palpate.config import Priors
from palpate.estimation.window import LAG
from palpate.geometry import se2
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.contact_geometry import ContactModel
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
    TURN_OFFSET,
)
from palpate.models.pushing.window import ContactWindow

Array = np.ndarray
ROBUST = with_settings(
    NoiseSettings(
        priors=Priors(depth=(3e-4, 4e-4), friction_ratio=(0.2, 0.3), friction_center=(0.0, 0.12), grip=(-0.92, 0.3)),
    ),
    first_pose={"deviation": NoiseSettings().first_pose.truth},
    sticking={"share": 0.03, "sliding_share": 3.0, "margin": 0.05, "kernel": 5.0},
    balance={"share": 0.03},
    friction_cone={"share": 0.2},
    direction={"share": 0.8},
    turn={"share": 20.0},
)
"""With all kernels and weights that depend on the estimate, as the defaults have them, but with numbers that tests of
smoothing may rely on: the defaults move with what `palpate tune` finds."""
PLAIN = with_settings(
    ROBUST,
    contact={"kernel": None},
    direction={"share": 0.4, "kernel": None},
    turn={"share": 4.0, "kernel": None},
    sticking={"sliding_share": ROBUST.sticking.share, "expected_share": 0.0, "kernel": None},
    balance={"kernel": None},
    friction_cone={"share": None, "kernel": None},
)
"""No weight depends on the estimate, so that what is solved is one least-squares problem."""
TWO_TIPS = ((0.0, 0.025), (0.0, -0.025))
SOFT = 2e-4
"""[m] See `contact_model`."""


@dataclass(frozen=True)
class Contact:
    """What a smoother is given of one contact."""

    truth: Array  # g, (N, 3)
    model: ContactModel
    sensor: Array  # (N, 3)
    prior: Belief
    directions: list[ContactDirection | None]
    turns: list[Turn | None]

    def said(self, t: int) -> tuple[Measurement, ...]:
        return tuple(one for one in (self.directions[t], self.turns[t]) if one is not None)

    def step(self, t: int) -> Step:
        return Step(self.sensor[t], self.said(t), times=[t / 30])


OFFSET = math.pi - 0.06  # [rad]; the sensor's yaw on the object, about 0.05, makes turns fall on both sides of +-pi
FELT = 0.01  # [rad], the standard deviation of directions and turns


def contact(steps: int, noise: NoiseSettings, tips: Any = ((0.0, 0.0),)) -> Contact:
    """A push of the rectangle; `felt` adds touch."""
    rng = np.random.default_rng(0)
    o, e = pushed("rectangle", steps, tips=tips)
    return Contact(
        se2.between(o, e),
        model_of("rectangle", sensor(tips=tuple(tips))),
        noisy(e, noise.sensor_pose.deviation, rng),
        belief_at(noisy(o[0], noise.first_pose.deviation, rng), noise, 1e-7 * np.ones((3, 3))),
        [None] * (steps + 1),
        [None] * (steps + 1),
    )


def belief_at(pose: ArrayLike, noise: NoiseSettings, more: ArrayLike = 0.0) -> Belief:
    """What is known of an object before its first contact, its pose with some more covariance (3, 3)."""
    covariance = np.diag(np.square(np.concatenate([noise.first_pose.deviation, object_prior(noise.priors).deviation])))
    known = Belief(np.array([pose], np.float64), object_prior(noise.priors).mean[None], covariance[None])
    return known.inflated(np.broadcast_to(more, (3, 3)))


def felt(given: Contact, direction: bool = True, turn: bool = True) -> Contact:
    """The same contact with directions and turns at three of four steps."""
    rng = np.random.default_rng(0)
    steps = len(given.truth)
    angle = contact_directions(given.truth, given.model) + rng.normal(0.0, FELT, steps)
    yaw = given.truth[:, 2] - OFFSET + rng.normal(0.0, FELT, steps)
    said = [t % 4 != 3 for t in range(steps)]
    directions = [ContactDirection(angle[t], FELT**2) if direction and said[t] else None for t in range(steps)]
    turns = [Turn(se2.wrap(float(yaw[t])), FELT**2) if turn and said[t] else None for t in range(steps)]
    return replace(given, directions=directions, turns=turns)


def settled(given: Contact, steps: int = 4) -> Contact:
    """The same contact, at the end of which the sensor stands still: each step takes another Gauss-Newton step."""
    nothing = [None] * steps
    return replace(
        given,
        truth=np.concatenate([given.truth, np.repeat(given.truth[-1:], steps, axis=0)]),
        sensor=np.concatenate([given.sensor, np.repeat(given.sensor[-1:], steps, axis=0)]),
        directions=given.directions + nothing,
        turns=given.turns + nothing,
    )


def window_of(given: Contact, noise: NoiseSettings, lag: int = LAG, belief: Belief | None = None) -> ContactWindow:
    """The window of a whole contact, by default of one hypothesis."""
    factors = settings_record(noise, given.model)
    known = given.prior if belief is None else belief
    window = ContactWindow(Graph(factors, given.model), known, given.step(0), lag)
    for t in range(1, len(given.sensor)):
        window.add(given.step(t))
    return window


@dataclass(frozen=True)
class Solved:
    poses: Array  # g and e, (N, 2, 3)
    values: Array  # (OBJECT_SIZE,)
    offset: float  # of the turns
    covariance: Array  # (3 + OBJECT_SIZE, 3 + OBJECT_SIZE), of the object's last pose and variables


def batch(given: Contact, noise: NoiseSettings) -> Solved:
    """The whole contact at once, by SciPy and residuals of its own; with weights that do not depend on the estimate."""
    prior, model = given.prior, given.model
    root = np.linalg.inv(np.linalg.cholesky(prior.covariance[0]))
    moved = np.hypot(*np.diff(given.sensor[:, :2], axis=0).T)
    slip_sigma = np.hypot(noise.sticking.still, noise.sticking.share * moved)[:, None]
    of_c, of_width = noise.balance.share * model.friction_radius, noise.balance.load * model.span
    torque_sigma = np.sqrt(noise.balance.still**2 + (of_c * moved) ** 2 + (of_width * moved) ** 2)
    start = np.stack(
        [np.broadcast_to(se2.between(prior.pose[0], given.sensor[0]), given.sensor.shape), given.sensor], 1
    )
    directed, direction = angles_of(given.directions)
    turned, turn = angles_of(given.turns)
    direction_sigma = max(FELT, noise.direction.floor) * np.sqrt(noise.direction.share)
    turn_sigma = FELT * np.sqrt(noise.turn.share)
    first_offset = start[0, 0, 2] - turn[0] if len(turn) else 0.0

    def residuals(offset: Array, values: Array, poses: Array) -> Array:
        """Of K guesses at once (K, rows): offset (K,), values (K, OBJECT_SIZE), poses (K, N, 2, 3)."""
        g, e = poses[:, :, 0], poses[:, :, 1]
        known = se2.log(se2.between(prior.pose[0], se2.compose(e[:, 0], se2.inverse(g[:, 0]))))
        rows = [np.concatenate([known, values - prior.values[0]], axis=-1) @ root.T]
        rows.append(se2.log(se2.between(given.sensor, e)) / noise.sensor_pose.deviation)
        gap, normal, point = outline_at(g, model)
        reach = np.sum(normal * (point - [model.friction_center.real, model.friction_center.imag]), axis=-1) - gap
        overlap = values[:, IN_OBJECT[DEPTH]] - values[:, IN_OBJECT[OUTLINE_SCALE]] * reach
        rows.append((gap + overlap) / noise.contact.deviation)
        before = se2.transform(g[:, :-1], se2.transform(se2.inverse(g[:, 1:]), point[:, 1:]))
        rows.append((before - point[:, 1:]) / slip_sigma)
        rows.append(imbalance(g, e, point, model, values) / torque_sigma)
        _, normal, _ = outline_at(g[:, directed], model)
        touched = np.arctan2(-normal[..., 1], -normal[..., 0]) - g[:, directed, 2]
        bias, scale = values[:, IN_OBJECT[DIRECTION_BIAS]], values[:, IN_OBJECT[DIRECTION_SCALE]]
        rows.append(se2.wrap(touched + scale * np.sin(touched) + bias - direction) / direction_sigma)
        rows.append(se2.wrap(g[:, turned, 2] - offset[:, None] - turn) / turn_sigma)
        rows.append(offset / TURN_OFFSET.prior[1])
        return np.concatenate([row.reshape(len(poses), -1) for row in rows], axis=1)

    size = 1 + OBJECT_SIZE + start.size

    def around(change: Array, poses: Array) -> tuple[Array, Array, Array]:
        """Guesses that are off by changes (K, size), the poses from those given."""
        moves = change[:, 1 + OBJECT_SIZE :].reshape(-1, *start.shape)
        values = prior.values[0] + change[:, 1 : 1 + OBJECT_SIZE]
        return first_offset + change[:, 0], values, se2.compose(poses, se2.exp(moves))

    def jacobian(change: Array, poses: Array) -> Array:
        """Central differences, of all columns in one go: one after the other takes ten times as long."""
        ends = [residuals(*around(change + step * np.eye(size), poses)) for step in (1e-6, -1e-6)]
        return (ends[0] - ends[1]).T / 2e-6

    # Depth and bias are far smaller than poses: without a scale the end of the search would be hard to tell.
    solved = least_squares(
        lambda change: residuals(*around(change[None], start))[0],
        np.zeros(size),
        lambda change: jacobian(change, start),  # pyright: ignore[reportArgumentType]
        method="lm",
        x_scale="jac",
        xtol=1e-11,
    ).x
    (offset,), (values,), (poses,) = around(solved[None], start)
    solved[1 + OBJECT_SIZE :] = 0.0  # from where the poses are
    slopes = jacobian(solved, poses)
    last = [*range(size - 6, size), *range(1, 1 + OBJECT_SIZE)]
    covariance = np.linalg.inv(slopes.T @ slopes)[np.ix_(last, last)]
    by_all = np.eye(3 + OBJECT_SIZE, 6 + OBJECT_SIZE, 3)
    by_all[:, 3:6] = 0.0
    by_g = se2.adjoint(poses[-1, 0])
    by_all[:3, :3], by_all[:3, 3:6] = -by_g, by_g
    return Solved(poses, values, float(offset), by_all @ covariance @ by_all.T)


def outline_at(g: Array, model: ContactModel) -> tuple[Array, Array, Array]:
    """Gap (...), outward normal and the sensor's nearest point (..., 2) at sensor poses (..., 3) in the object frame.

    A part bears more the nearer it is.
    """
    center = se2.transform(g[..., None, :], np.column_stack([model.parts.real, model.parts.imag]))
    distance, normal = distance_at(model, center)
    bears = np.exp(-(distance - distance.min(axis=-1, keepdims=True)) / SOFT)
    gap = distance.min(axis=-1) - SOFT * np.log(bears.mean(axis=-1)) - model.radius
    share = (bears / bears.sum(axis=-1, keepdims=True))[..., None]
    return gap, np.sum(share * normal, axis=-2), np.sum(share * (center - model.radius * normal), axis=-2)


def imbalance(g: Array, e: Array, point: Array, model: ContactModel, values: Array) -> Array:
    """`p x v - c^2 omega` (K, N - 1) [m^2] of all steps (K, N, 3), touched at points p (K, N, 2)."""
    aside = values[:, IN_OBJECT[FRICTION_CENTER]] * model.friction_radius
    center = (np.array([model.friction_center.real, model.friction_center.imag]) + aside)[:, None]
    o = se2.compose(e, se2.inverse(g))
    before = se2.transform(se2.inverse(o[:, 1:]), se2.transform(o[:, :-1], center))
    arm, way, omega = point[:, 1:] - center, center - before, se2.wrap(o[:, 1:, 2] - o[:, :-1, 2])
    c_squared = model.friction_radius**2 * np.exp(values[:, IN_OBJECT[FRICTION_RATIO]])
    return arm[..., 0] * way[..., 1] - arm[..., 1] * way[..., 0] - c_squared * omega


def angles_of(said: Sequence[ContactDirection | Turn | None]) -> tuple[Array, Array]:
    """The steps (P,) at which something was said, and the angles (P,)."""
    steps = [t for t, one in enumerate(said) if one is not None]
    return np.array(steps, int), np.array([one.angle for one in said if one is not None])


def scaled_difference(belief: Belief, other: Solved) -> tuple[float, float]:
    """Largest difference of mean and of covariance from the other's, in its standard deviations and variances."""
    g, e = other.poses[-1]
    deviation = np.sqrt(np.diag(other.covariance))
    off = se2.log(se2.between(belief.pose[0], se2.compose(e, se2.inverse(g))))
    mean = np.concatenate([off, other.values - belief.values[0]]) / deviation
    difference = (belief.covariance[0] - other.covariance) / np.outer(deviation, deviation)
    return float(np.abs(mean).max()), float(np.abs(difference).max())
