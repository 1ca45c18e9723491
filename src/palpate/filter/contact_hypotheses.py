"""Hypotheses with which a contact begins: the places of the outline where the sensor may have met the object.

The graph of a contact finds the best pose near the one it begins with, so each place needs its own hypothesis. A rough
first pose holds until the object is found, so that contacts from several sides add up. Later a rough belief is a guess
of how far something moved the object: it only says which places are likely.
"""

from dataclasses import replace
from functools import lru_cache, reduce

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.filter.consistency import is_uncertain, true_directions
from palpate.filter.hypotheses import AHEAD, MOST_YOUNG, Hypotheses, are_near, branched
from palpate.geometry import se2
from palpate.graph.belief import Belief, overlap
from palpate.graph.contact_geometry import ContactModel, reaches
from palpate.graph.factors import Step

Array = NDArray[np.float64]

LOG_UNLIKELY = 1.0
"""Log of the odds that nothing else moved the object against that something did."""
_IMPOSSIBLE = 12.0  # largest cost of a contact where the object is not [log]
_SPACING, _TURN = 0.015, np.radians(18.0)  # [m], [rad] of the normal, from place to place
_PLACE = np.diag(np.square([0.003, 0.01, np.radians(9.0)]))  # [m, m, rad] along the normal, along the outline, yaw
_STEP, _LONGEST = 0.003, 5.0  # [m] step along the outline, and its largest length
_LIKELY = 4.0  # standard deviations of a belief within which places are considered
_ROUGH = np.array([0.006, 0.006, 0.15])  # [m, m, rad] standard deviations of a rough belief
_YAWS = 12  # directions all around, if yaw is unknown
_KNOWN_YAW, _ANY_YAW = 1.5 * np.radians(9.0), 1.7  # [rad] standard deviations of yaw for one value, and for all alike
_UNKNOWN_YAW = np.diag([0.0, 0.0, 100.0**2])  # [rad^2] variance of an unknown yaw
_ROUND = 1e-4  # [m] difference in distance from the centroid on a round outline


def contact_hypotheses(
    rows: Hypotheses, rest: Belief, displaced: Belief, was_found: bool, model: ContactModel, step: Step
) -> tuple[Hypotheses, NDArray[np.int64]]:
    """Return the hypotheses with which a contact begins, likeliest first, and the row each of them comes from.

    Those that take images as mirrored come last. The beliefs `rest` hold if nothing moved the object since, `displaced`
    are inflated by the covariance of its displacement. `was_found` is False while only a rough first pose is known.
    """
    origins, groups = [], []
    for is_mirror in np.unique(rows.is_mirror):
        group = np.flatnonzero(rows.is_mirror == is_mirror)
        parts = ((rows.take([row]), rest.take([row]), displaced.take([row])) for row in group.tolist())
        each = [_begun(*part, was_found, model, step) for part in parts]
        begun = reduce(Hypotheses.joined, each)
        log_prior, order = begun.log_prior, np.argsort(-begun.log_prior, kind="stable")
        if not was_found:
            log_prior, order = _merged(begun, order)
        origins.append(np.repeat(group, [len(one.age) for one in each])[order[:MOST_YOUNG]])
        groups.append(replace(begun, log_prior=log_prior).take(order[:MOST_YOUNG]))
    return reduce(Hypotheses.joined, groups), np.concatenate(origins)


def _begun(
    row: Hypotheses, rest: Belief, displaced: Belief, was_found: bool, model: ContactModel, step: Step
) -> Hypotheses:
    """Return the hypotheses that come from one: that it is where it was, or at one of several places."""
    if was_found and not is_rough(displaced, model):
        return replace(row, belief=displaced)
    poses, likely = poses_in_contact(displaced, model, step, row.sign, is_guess=was_found)
    places = branched(row, poses, row.log_prior + likely - LOG_UNLIKELY)  # pushing is ignored in their first steps
    places = replace(places, disturbed_steps_left=np.full(len(likely), AHEAD + 1))
    if was_found:
        if not len(likely):
            return replace(row, belief=displaced)
        return branched(row, rest, row.log_prior).joined(places)
    is_displaced = row.displacement[0] > 0.0
    as_left = poses_in_contact(rest, model, step, row.sign, is_guess=False)[1] if is_displaced else likely
    as_expected = row.log_prior + max(np.logaddexp.reduce(as_left), -_IMPOSSIBLE)
    if not is_rough(displaced, model):
        return branched(row, displaced, as_expected)
    is_too_far = is_uncertain(displaced.pose_covariance[0])  # for one graph to find it
    if is_too_far and len(likely) and not is_displaced:
        return places
    return branched(row, rest, as_expected).joined(places)


def _merged(rows: Hypotheses, order: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Return log probabilities (B,) and the rows of different poses, of rows in the order of likelihood."""
    log_prior, kept = rows.log_prior.copy(), []
    for row in order:
        same = [other for other in kept if are_near(rows.belief.pose[other], rows.belief.pose[row])]
        if same:
            log_prior[same[0]] = np.logaddexp(log_prior[same[0]], log_prior[row])
        elif len(kept) < MOST_YOUNG:
            kept.append(row)
    return log_prior, np.array(kept)


def is_rough(belief: Belief, model: ContactModel) -> bool:
    """Return True if the first belief leaves several places where the sensor may meet the object.

    A round object is met alike at every yaw.
    """
    rough = np.diagonal(belief.pose_covariance[0]) > _ROUGH**2
    return bool(rough[: 2 if is_round(model) else 3].any())


def is_round(model: ContactModel) -> bool:
    """Return True if the outline is the same at every yaw, so that touch cannot measure it."""
    return bool(np.ptp(np.abs(outline_places(model)[0] - model.friction_center)) < _ROUND)


def poses_in_contact(
    belief: Belief, model: ContactModel, step: Step, sign: Array, is_guess: bool = True
) -> tuple[Belief, Array]:
    """Return beliefs (N rows) at places where a contact may begin, likeliest first, and their log probabilities (N,).

    A belief that is a guess only says how likely each place is: the object is within _PLACE of it. Another counts as
    much as the contact: the product of both Gaussians is the belief at each place, its weight the probability.
    """
    pose, around = _at_places(belief, model, step, sign)
    known = belief.pose_covariance[0]
    if is_guess:
        if is_round(model):
            around[:, 2, 2] = known[2, 2]
        off = se2.log(se2.between(belief.pose[0], pose))
        # After a long doubt a covariance may be singular.
        far = np.einsum("ni,ij,nj->n", off, np.linalg.pinv(known, hermitian=True), off)
        likely = -0.5 * far
    else:
        off = belief.pose[0] - pose
        off[:, 2] = se2.wrap(off[:, 2])
        if known[2, 2] > _ANY_YAW**2 and not is_round(model):
            known = known + _UNKNOWN_YAW
        known = _turned(known, belief.pose[0, 2])
        gain = around @ np.linalg.pinv(around + known, hermitian=True)
        by_gain = (gain @ off[..., None])[..., 0]
        far = np.einsum("ni,ni->n", off, np.linalg.solve(around, by_gain[..., None])[..., 0])
        likely = 0.5 * (np.linalg.slogdet(gain)[1] - far)
        pose, around = pose + by_gain, around - gain @ around
    order = np.array([index for index in np.argsort(-likely, kind="stable") if far[index] < _LIKELY**2], np.int64)
    here = belief.take(np.zeros(len(order), np.int64))
    joint, pose, around = here.covariance, pose[order], around[order]
    joint[:, :3, :], joint[:, :, :3] = 0.0, 0.0
    joint[:, :3, :3] = _turned(0.5 * (around + around.transpose(0, 2, 1)), -pose[:, 2])
    pose[:, 2] = se2.wrap(pose[:, 2])
    return replace(here, pose=pose, covariance=joint), likely[order]


def _at_places(belief: Belief, model: ContactModel, step: Step, sign: Array) -> tuple[Array, Array]:
    """Return object poses (N, 3) at which the sensor touches each place, and covariances (N, 3, 3) in the world."""
    center, normal = outline_places(model)
    center = center - overlap(belief, reaches(model, center - model.radius * normal, normal)) * normal
    directions, sensor_pose = true_directions(step, belief, sign), step.sensor_pose
    around = _PLACE
    if is_round(model):
        yaw = np.array([[sensor_pose[2] - belief.pose[0, 2]]])
        if directions:  # the place follows from yaw
            turn = -np.exp(1j * (yaw[0] + directions[0][0])) / normal[:1]
            center, normal = (center[:1] - model.friction_center) * turn + model.friction_center, normal[:1] * turn
        around = _PLACE + _UNKNOWN_YAW
    elif directions:
        yaw = (np.angle(-normal) - directions[0][0])[:, None]
    else:
        yaw = np.array(_likely_yaws(belief, sensor_pose))[None]
    place = center[:, None] - np.exp(1j * yaw) * model.center
    seen = np.stack([place.real, place.imag, np.broadcast_to(yaw, place.shape)], axis=-1).reshape(-1, 3)
    pose = se2.compose(sensor_pose, se2.inverse(seen))
    return pose, _turned(around, pose[:, 2] + np.repeat(np.angle(normal), yaw.shape[1]))


def _turned(covariance: Array, angle: ArrayLike) -> Array:
    """Return covariances (..., 3, 3) of x, y and yaw in axes that are turned back by angles (...) [rad]."""
    turn = np.zeros((*np.shape(angle), 3, 3))
    turn[..., :2, :2], turn[..., 2, 2] = se2.rotation(angle), 1.0
    return turn @ covariance @ np.swapaxes(turn, -1, -2)


def _likely_yaws(belief: Belief, sensor_pose: Array) -> list[float]:
    """Return likely yaws of the sensor in the object frame [rad]."""
    yaw, deviation = float(sensor_pose[2] - belief.pose[0, 2]), float(np.sqrt(belief.pose_covariance[0, 2, 2]))
    if deviation < _KNOWN_YAW:
        return [yaw]
    reach = min(2.0 * deviation, np.pi)
    count = int(np.ceil(_YAWS * reach / np.pi))
    return [yaw + reach * step / count for step in range(-count, count + (reach < np.pi))]


@lru_cache(maxsize=8)
def outline_places(model: ContactModel) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return centres of a tip in contact, all around the outline, and outward normals there (N,), object frame."""
    centred = replace(model, parts=np.zeros(1, np.complex128))
    pose = np.array([[model.friction_center.real + 1.0, model.friction_center.imag, 0.0]])
    for _ in range(4):  # the distance is that to the nearest point, except at the grid's border
        touch = centred.touching(pose[None])[0, 0]
        way = touch["gap"] * touch["normal"]
        pose = pose - [[way.real, way.imag, 0.0]]
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
