"""Hypotheses with which a contact begins: the places of the outline where the sensor may have met the object.

The graph of a contact finds the best pose near the one it begins with, so each place needs its own hypothesis. A rough
first pose holds until the object is found, so that contacts from several sides add up. Later, places are considered if
a belief is rough, or contradicts the direction of the contact as it does on the wrong side of a corner. If something
moved the object, its belief is a guess of how far and only says which places are likely.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array, Complex, Flags, Integers
from palpate.config import AHEAD, ANY_YAW, HOPELESS, KNOWN_YAW, LOG_ODDS, MOST_YOUNG, PLACE_SIGMA, POOR, ROUGH, UNLIKELY
from palpate.filter.hypotheses import Hypotheses, are_near
from palpate.geometry import se2
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.measurements import Step
from palpate.models.pushing.variables import DEPTH, OUTLINE_SCALE

_STEP, _LONGEST = 6e-4, 5.0  # [m] step along the outline, short at the corner of a 2 mm tip, and its largest length
_SPACING, _TURN = 0.015, 0.314  # [m], [rad] of the normal, from place to place: a graph finds those between
_ROUND = 1e-4  # [m] difference in distance from the centroid on a round outline
_PLACE = np.diag(np.square(PLACE_SIGMA))
_UNKNOWN_YAW = np.diag([0.0, 0.0, 100.0**2])  # [rad^2] variance of an unknown yaw


def contact_hypotheses(
    rows: Hypotheses, rest: Belief, displaced: Belief, was_found: bool, model: ContactModel, step: Step
) -> tuple[Hypotheses, Integers]:
    """Return the hypotheses with which a contact begins, likeliest first, and the row each of them comes from.

    Those that take images as mirrored come last. The beliefs `rest` hold if nothing moved the object since, `displaced`
    are inflated by the covariance of its displacement. `was_found` is False while only a rough first pose is known.
    """
    is_displaced = rows.displacement > 0.0
    rough = is_rough(displaced, model) | _is_contradicted(displaced, rows.sign, model, step)
    searched = np.flatnonzero(rough | (not was_found))
    poses, origin, likely = poses_in_contact(displaced, searched, rows.sign, model, step, is_displaced & was_found)
    log_prior = rows.log_prior
    if not was_found:
        anywhere = np.full(len(rough), np.log(POOR))  # even where no place is likely
        np.logaddexp.at(anywhere, origin, likely)
        log_prior = log_prior + anywhere
        of_rough = np.flatnonzero(rough[origin])
        poses, origin, likely = poses.take(of_rough), origin[of_rough], likely[of_rough]
    has_places = np.bincount(origin, minlength=len(rough)) > 0
    stays = rough & (has_places | (not was_found))
    belief = displaced.joined(rest).take(np.arange(len(rough)) + len(rough) * stays)
    weight = np.where(stays | (not was_found), 1.0, rows.weight)
    stayed = replace(rows, belief=belief, log_prior=log_prior, weight=weight)
    is_hopeless = is_rough(displaced, model, HOPELESS) & has_places & ~is_displaced & (not was_found)
    places = replace(
        rows.take(origin),
        belief=poses,
        log_prior=rows.log_prior[origin] + likely - LOG_ODDS,
        weight=np.ones(len(likely)),
        disturbed_steps_left=np.where(is_displaced[origin] | (not was_found), AHEAD + 1, 0),  # it may still be moved
    )
    begun, origin = stayed.take(~is_hopeless).joined(places), np.concatenate([np.flatnonzero(~is_hopeless), origin])
    likeliest = np.argsort(-begun.log_prior, kind="stable")
    is_mirror = (begun.sign != rows.sign[0])[likeliest]
    groups = likeliest[~is_mirror], likeliest[is_mirror]
    chosen = np.concatenate([group[:MOST_YOUNG] if was_found else _merged(begun, group) for group in groups])
    return begun.take(chosen), origin[chosen]


def _merged(rows: Hypotheses, order: Integers) -> Integers:
    """Return the rows of different poses, and add to their log probabilities those of the same poses.

    `order` are some rows, the likeliest first.
    """
    kept = []
    while len(order) and len(kept) < MOST_YOUNG:
        is_same = are_near(rows.belief.pose[order[0]], rows.belief.pose[order])
        kept.append(order[0])
        rows.log_prior[order[0]] = np.logaddexp.reduce(rows.log_prior[order[is_same]])
        order = order[~is_same]
    return np.array(kept, np.int64)


def _is_contradicted(belief: Belief, sign: Array, model: ContactModel, step: Step) -> Flags:
    """Return True (B,) where the measured direction of the contact is unlikely at the believed poses."""
    directions = step.directions(belief, sign)
    if not directions or is_round(model):
        return np.zeros(len(sign), np.bool_)
    (angle, variance), g = directions[0], se2.between(belief.pose, step.sensor_pose)
    normal = model.touching(g[:, None])["normal"][:, 0] * np.exp(-1j * g[:, 2])
    return np.abs(se2.wrap(angle - np.angle(-normal))) > UNLIKELY * np.sqrt(variance + belief.pose_covariance[:, 2, 2])


def is_rough(belief: Belief, model: ContactModel, limits: ArrayLike = ROUGH) -> Flags:
    """Return True (B,) where beliefs leave several places at which the sensor may meet the object.

    These are beliefs with larger deviations (3,) than the limits [m, m, rad]. A round object is met alike at every yaw.
    """
    rough = np.diagonal(belief.pose_covariance, axis1=1, axis2=2) > np.square(limits)
    return np.any(rough[:, : 2 if is_round(model) else 3], axis=1)


def is_round(model: ContactModel) -> bool:
    """Return True if the outline is the same at every yaw, so that touch cannot measure it."""
    return bool(np.ptp(np.abs(outline_places(model)[0] - model.friction_center)) < _ROUND)


def poses_in_contact(
    beliefs: Belief, rows: Integers, sign: Array, model: ContactModel, step: Step, is_guess: Flags
) -> tuple[Belief, Integers, Array]:
    """Return beliefs (N rows) at places where a contact may begin, their rows and their log probabilities (N,).

    They come from some rows of `beliefs`. A guess (B,) only says how likely each place is: the object is within _PLACE
    of it. Otherwise the product of both Gaussians is the belief there, and its weight the probability.
    """
    belief = beliefs.take(rows)
    pose, around, origin = _at_places(belief, sign[rows], model, step)
    known, guess = belief.pose_covariance.copy(), is_guess[rows][origin]
    if is_round(model):
        around[guess, 2, 2] = known[origin[guess], 2, 2]
    else:
        known[known[:, 2, 2] > ANY_YAW**2] += _UNKNOWN_YAW
    off = belief.pose[origin] - pose
    off[:, 2] = se2.wrap(off[:, 2])
    joint = _turned(known, belief.pose[:, 2])[origin] + np.where(guess[:, None, None], 0.0, around)
    near = np.flatnonzero(np.square(off[:, 2]) < UNLIKELY**2 * joint[:, 2, 2])  # by yaw, no more than by all three
    inverse = np.linalg.pinv(joint[near], hermitian=True)  # a guess may be singular after a long doubt
    far = np.einsum("ni,nij,nj->n", off[near], inverse, off[near])
    is_near = far < UNLIKELY**2
    near, inverse, far = near[is_near], inverse[is_near], far[is_near]
    pose, around, origin, off, guess = pose[near], around[near], origin[near], off[near], guess[near]
    gain = around @ inverse
    likely = -0.5 * far + np.where(guess, 0.0, 0.5 * np.linalg.slogdet(gain)[1])
    gain[guess] = 0.0
    pose, around = pose + (gain @ off[..., None])[..., 0], around - gain @ around
    here = belief.take(origin)
    here.covariance[:, :3, :], here.covariance[:, :, :3] = 0.0, 0.0
    here.covariance[:, :3, :3] = _turned(0.5 * (around + around.transpose(0, 2, 1)), -pose[:, 2])
    pose[:, 2] = se2.wrap(pose[:, 2])
    return replace(here, pose=pose), rows[origin], likely


def _at_places(belief: Belief, sign: Array, model: ContactModel, step: Step) -> tuple[Array, Array, Integers]:
    """Return object poses (N, 3) at which the sensor touches each place, covariances (N, 3, 3) in the world, and rows.

    Places of B beliefs are (B, P, 1), with Y yaws of the sensor in the object frame (B, 1 or P, Y).
    """
    center, normal = outline_places(model)
    arm = center - model.radius * normal - model.friction_center
    indentation = belief[DEPTH] - belief[OUTLINE_SCALE] * (normal.conjugate() * arm).real
    center = center - indentation * normal
    normal = np.broadcast_to(normal, center.shape)
    directions, around = step.directions(belief, sign), _PLACE
    yaw = (step.sensor_pose[2] - belief.pose[:, 2])[:, None, None]
    is_likely = np.ones((1, 1, 1), np.bool_)
    if is_round(model):
        around = _PLACE + _UNKNOWN_YAW
        if directions:  # the place follows from yaw
            turn = -np.exp(1j * (yaw[:, 0] + directions[0][0][:, None])) / normal[:, :1]
            center, normal = (
                (center[:, :1] - model.friction_center) * turn + model.friction_center,
                normal[:, :1] * turn,
            )
    elif directions:
        yaw = (np.angle(-normal) - directions[0][0][:, None])[..., None]
    else:
        turns, is_likely = _likely_turns(np.sqrt(belief.pose_covariance[:, 2, 2]))
        yaw, is_likely = yaw + turns[:, None], is_likely[:, None]
    place = center[..., None] - np.exp(1j * yaw) * model.center
    origin, at, which = np.nonzero(np.broadcast_to(is_likely, place.shape))
    place, yaw = place[origin, at, which], np.broadcast_to(yaw, place.shape)[origin, at, which]
    pose = se2.compose(step.sensor_pose, se2.inverse(np.stack([place.real, place.imag, yaw], axis=-1)))
    around = _turned(around, pose[:, 2] + np.angle(normal)[origin, at])
    if not is_round(model):  # the object turns about the tip
        tip = se2.transform(step.sensor_pose, np.array([model.center.real, model.center.imag]))
        moves = np.tile(np.eye(3), (len(pose), 1, 1))
        moves[:, :2, 2] = (pose[:, :2] - tip)[:, ::-1] * (-1.0, 1.0)
        around = moves @ around @ moves.transpose(0, 2, 1)
    return pose, around, origin


def _turned(covariance: Array, angle: ArrayLike) -> Array:
    """Return covariances (..., 3, 3) of x, y and yaw in axes that are turned back by angles (...) [rad]."""
    turn = np.zeros((*np.shape(angle), 3, 3))
    turn[..., :2, :2], turn[..., 2, 2] = se2.rotation(angle), 1.0
    return turn @ covariance @ np.swapaxes(turn, -1, -2)


def _likely_turns(deviation: Array) -> tuple[Array, Flags]:
    """Return turns (B, Y) [rad] of a yaw of this deviation (B,), and True where they are likely and not repeated."""
    reach = np.minimum(2.0 * deviation, np.pi)
    count = np.where(deviation < KNOWN_YAW, 0, np.ceil(reach / _TURN))[:, None]
    most = count.max(initial=0.0)
    steps = np.arange(-most, most + 1.0)
    is_likely = (np.abs(steps) <= count) & ~((reach[:, None] >= np.pi) & (steps == count))
    return reach[:, None] * steps / np.maximum(count, 1.0), is_likely


@lru_cache(maxsize=8)
def outline_places(model: ContactModel) -> tuple[Complex, Complex]:
    """Return centres of a tip in contact, all around the outline, and outward normals there (N,), object frame."""
    centred = replace(model, parts=np.zeros(1, np.complex128))
    pose = np.array([[model.friction_center.real + 1.0, model.friction_center.imag, 0.0]])
    for _ in range(4):  # the distance is that to the nearest point, except at the grid's border
        touch = centred.touching(pose[None])[0, 0]
        pose = pose - touch["gap"] * np.array([[touch["normal"].real, touch["normal"].imag, 0.0]])
    places, normals, gone = [], [], 0.0
    for _ in range(int(_LONGEST / _STEP)):
        place, normal = complex(*pose[0, :2]), complex(centred.touching(pose[None])[0, 0]["normal"])
        gone += _STEP
        if len(places) > 2 and abs(place - places[0]) < 1.5 * _STEP:
            break
        if not places or gone > _SPACING or abs(np.angle(normal / normals[-1])) > _TURN:
            places.append(place)
            normals.append(normal / abs(normal))  # shorter near a concave corner
            gone = 0.0
        pose = centred.moved_along(pose, np.array([_STEP]))
    return np.array(places), np.array(normals)
