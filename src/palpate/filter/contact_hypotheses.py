"""Hypotheses with which a contact begins: the places of the outline where the sensor may have met the object.

The graph of a contact finds the best pose near the one it begins with. An object that may be anywhere within some
centimetres can be met at several places, and each of them needs a hypothesis of its own.

Once the object was found, a rough belief is a guess of how far something moved it: it only says which places are
likely. A rough first pose is no such guess: it holds until the object is found, so that contacts from several sides add
up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.filter.consistency import is_uncertain
from palpate.geometry import se2
from palpate.graph.belief import Belief
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.contact import overlap, reaches
from palpate.graph.factors.direction import true_angle
from palpate.types.measurements import ContactDirection, Measurement

Array = NDArray[np.float64]

LOG_UNLIKELY = 1.0
"""Log of the odds that nothing else moved the object against that something did."""
MOST_YOUNG = 20
"""Largest number of hypotheses at the beginning of a contact: all faces of an outline, each at several places."""
_IMPOSSIBLE = 12.0  # largest cost of a contact where the object is not [log]
_SAME = np.array([2e-3, 2e-3, 0.02])  # [m, m, rad] within which two poses are the same
_SPACING, _TURN = 0.015, np.radians(18.0)  # [m], [rad] of the normal, from place to place
_PLACE = np.diag(np.square([0.003, 0.01, np.radians(9.0)]))  # [m, m, rad] along the normal, along the outline, yaw
_STEP, _LONGEST = 0.003, 5.0  # [m] step along the outline, and its largest length
_LIKELY = 4.0  # standard deviations of a belief within which places are considered
_ROUGH = np.array([0.006, 0.006, 0.15])  # [m, m, rad] standard deviations of a rough belief
_YAWS = 12  # directions all around, if yaw is unknown
_KNOWN_YAW, _ANY_YAW = 1.5 * np.radians(9.0), 1.7  # [rad] standard deviations of yaw for one value, and for all alike
_UNKNOWN_YAW = np.diag([0.0, 0.0, 100.0**2])  # [rad^2] variance of an unknown yaw
_ROUND = 1e-4  # [m] difference in distance from the centroid on a round outline


@dataclass(frozen=True)
class FirstContact:
    """The first frame of a contact."""

    sensor_pose: Array
    """Measured world_T_sensor (3,) [m, m, rad]."""
    measurements: Sequence[Measurement]
    """Measurements from touch and other sources."""
    from_touch: int = 0
    """Number of leading measurements from touch images."""

    def direction(self, belief: Belief, sign: float) -> float | None:
        """Return the first measured contact direction [rad] for one belief; None if there is none."""
        for index, one in enumerate(self.measurements):
            if isinstance(one, ContactDirection):
                signs = np.array([sign if index < self.from_touch else 1.0])
                return float(true_angle(one, belief, signs)[0])
        return None


@dataclass(eq=False)
class Beginning:
    """One hypothesis with which a contact may begin."""

    row: int
    """Hypothesis before the contact that it comes from."""
    log_prior: float
    """Log probability."""
    belief: Belief
    """Belief about the object, one row."""
    is_place: bool = False
    """True for one of several places on the outline, so that pushing is ignored in the first steps."""
    goes_on: bool = False
    """True if it is the hypothesis before the contact, and not a new one."""


def contact_hypotheses(
    beliefs: Belief,
    displaced: Belief,
    log_prior: Array,
    sign: Array,
    is_displaced: NDArray[np.bool_],
    was_found: bool,
    model: ContactModel,
    contact: FirstContact,
) -> list[Beginning]:
    """Return the hypotheses with which a contact begins, the likeliest first.

    Arrays are rows of the hypotheses before the contact. `beliefs` hold if nothing moved the object since, `displaced`
    are inflated by the covariance of its displacement. `was_found` is False while only a rough first pose is known.
    """
    found: list[Beginning] = []
    for row in range(len(beliefs)):
        here = beliefs.take([row]), displaced.take([row]), float(log_prior[row]), float(sign[row])
        if was_found:
            found += _found_before(row, *here, model, contact)
        else:
            found += _not_found_before(row, *here, bool(is_displaced[row]), model, contact)
    found.sort(key=lambda one: -one.log_prior)
    return (found if was_found else _merged(found))[:MOST_YOUNG]


def _found_before(
    row: int,
    belief: Belief,
    displaced: Belief,
    log_prior: float,
    sign: float,
    model: ContactModel,
    contact: FirstContact,
) -> list[Beginning]:
    poses, likely = poses_in_contact(displaced, model, contact, sign) if is_rough(displaced, model) else (displaced, [])
    first = Beginning(row, log_prior, belief if len(likely) else displaced, goes_on=not len(likely))
    places = [
        Beginning(row, log_prior + float(each) - LOG_UNLIKELY, poses.take([index]), True)
        for index, each in enumerate(likely)
    ]
    return [first, *places]


def _not_found_before(
    row: int,
    belief: Belief,
    displaced: Belief,
    log_prior: float,
    sign: float,
    is_displaced: bool,
    model: ContactModel,
    contact: FirstContact,
) -> list[Beginning]:
    poses, likely = poses_in_contact_and_belief(displaced, model, contact, sign)
    as_left = poses_in_contact_and_belief(belief, model, contact, sign)[1] if is_displaced else likely
    as_expected = log_prior + max(log_sum(as_left), -_IMPOSSIBLE)
    if not is_rough(displaced, model):
        return [Beginning(row, as_expected, displaced)]
    is_guess = is_uncertain(displaced.pose_covariance[0])  # too far off for one graph to find it
    first = [] if is_guess and len(likely) and not is_displaced else [Beginning(row, as_expected, belief)]
    places = [
        Beginning(row, log_prior + float(each) - LOG_UNLIKELY, poses.take([index]), True)
        for index, each in enumerate(likely)
    ]
    return [*first, *places]


def _merged(beginnings: Sequence[Beginning]) -> list[Beginning]:
    """Return the hypotheses, likeliest first, with those at the same pose put together."""
    kept: list[Beginning] = []
    for one in beginnings:
        same = [other for other in kept if are_near(other.belief.pose[0], one.belief.pose[0])]
        if same:
            same[0].log_prior = log_sum([same[0].log_prior, one.log_prior])
        elif len(kept) < MOST_YOUNG:
            kept.append(one)
    return kept


def log_sum(logs: ArrayLike) -> float:
    """Return the log of the sum of numbers whose logs are given."""
    return float(np.logaddexp.reduce(logs))


def are_near(pose: Array, others: Array) -> NDArray[np.bool_]:
    """Return True (...) where poses (..., 3) and others (..., 3) are the same for all that matters."""
    return np.all(np.abs(se2.log(se2.between(pose, others))) < _SAME, axis=-1)


def is_rough(belief: Belief, model: ContactModel) -> bool:
    """Return True if the first belief leaves several places where the sensor may meet the object.

    A round object is met alike at every yaw.
    """
    rough = np.diagonal(belief.pose_covariance[0]) > _ROUGH**2
    return bool(rough[: 2 if is_round(model) else 3].any())


def is_round(model: ContactModel) -> bool:
    """Return True if the outline is the same at every yaw, so that touch cannot measure it."""
    return bool(np.ptp(np.abs(outline_places(model)[0] - model.friction_center)) < _ROUND)


def poses_in_contact(belief: Belief, model: ContactModel, contact: FirstContact, sign: float) -> tuple[Belief, Array]:
    """Return beliefs (N rows) at places where a contact may begin, likeliest first, and their log probabilities (N,).

    Yaw follows from the contact direction; without one it is as believed, or one of several. The belief only says how
    likely each place is: the object is within _PLACE of it.
    """
    pose, around = _at_places(belief, model, contact, sign)
    covariance = belief.pose_covariance[0]
    if is_round(model):
        around[:, 2, 2] = covariance[2, 2]
    off = se2.log(se2.between(belief.pose[0], pose))
    # After a long doubt a covariance may be singular.
    far = np.einsum("ni,ij,nj->n", off, np.linalg.pinv(covariance, hermitian=True), off)
    return _likely_first(belief, pose, around, far, -0.5 * far)


def poses_in_contact_and_belief(
    belief: Belief, model: ContactModel, contact: FirstContact, sign: float
) -> tuple[Belief, Array]:
    """Return the same if the belief is no guess, so that it counts as much as the contact.

    The product of both Gaussians is the belief at each place, and its weight the place's probability.
    """
    pose, around = _at_places(belief, model, contact, sign)
    off = belief.pose[0] - pose
    off[:, 2] = se2.wrap(off[:, 2])
    known = belief.pose_covariance[0]
    if known[2, 2] > _ANY_YAW**2 and not is_round(model):
        known = known + _UNKNOWN_YAW
    known = _turned(known, belief.pose[0, 2])
    gain = around @ np.linalg.pinv(around + known, hermitian=True)
    by_gain = (gain @ off[..., None])[..., 0]
    far = np.einsum("ni,ni->n", off, np.linalg.solve(around, by_gain[..., None])[..., 0])
    likely = 0.5 * (np.linalg.slogdet(gain)[1] - far)
    return _likely_first(belief, pose + by_gain, around - gain @ around, far, likely)


def _at_places(belief: Belief, model: ContactModel, contact: FirstContact, sign: float) -> tuple[Array, Array]:
    """Return object poses (N, 3) at which the sensor touches each place, and covariances (N, 3, 3) in the world."""
    center, normal = outline_places(model)
    center = center - overlap(belief, reaches(model, center - model.radius * normal, normal)) * normal
    direction, sensor_pose = contact.direction(belief, sign), contact.sensor_pose
    around = _PLACE
    if is_round(model):
        yaw = np.array([[sensor_pose[2] - belief.pose[0, 2]]])
        if direction is not None:  # the place follows from yaw
            turn = -np.exp(1j * (yaw[0] + direction)) / normal[:1]
            center, normal = (center[:1] - model.friction_center) * turn + model.friction_center, normal[:1] * turn
        around = _PLACE + _UNKNOWN_YAW
    elif direction is not None:
        yaw = (np.angle(-normal) - direction)[:, None]
    else:
        yaw = np.array(_likely_yaws(belief, sensor_pose))[None]
    place = center[:, None] - np.exp(1j * yaw) * model.center
    seen = np.stack([place.real, place.imag, np.broadcast_to(yaw, place.shape)], axis=-1).reshape(-1, 3)
    pose = se2.compose(sensor_pose, se2.inverse(seen))
    return pose, _turned(around, pose[:, 2] + np.repeat(np.angle(normal), yaw.shape[1]))


def _likely_first(belief: Belief, pose: Array, covariance: Array, far: Array, likely: Array) -> tuple[Belief, Array]:
    """Return the belief at those poses (N, 3) that are not too far [variances]; covariances are along world axes."""
    order = np.array([index for index in np.argsort(-likely, kind="stable") if far[index] < _LIKELY**2], np.int64)
    here = belief.take(np.zeros(len(order), np.int64))
    joint, turned = here.covariance, pose[order]
    joint[:, :3, :], joint[:, :, :3] = 0.0, 0.0
    known = covariance[order]
    joint[:, :3, :3] = _turned(0.5 * (known + known.transpose(0, 2, 1)), -turned[:, 2])
    turned[:, 2] = se2.wrap(turned[:, 2])
    return replace(here, pose=turned, covariance=joint), likely[order]


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
    start = np.array([[model.friction_center.real + 1.0, model.friction_center.imag, 0.0]])
    centred = replace(model, parts=np.zeros(1, np.complex128))

    def touching(pose: Array) -> np.void:
        return centred.touching(pose[None])[0, 0]

    pose, places, normals = start, [], []
    for _ in range(4):  # the distance is that to the nearest point, except at the grid's border
        touch = touching(pose)
        way = touch["gap"] * touch["normal"]
        pose = pose - [[way.real, way.imag, 0.0]]
    gone = 0.0
    for _ in range(int(_LONGEST / _STEP)):
        touch = touching(pose)
        place = complex(*pose[0, :2])
        normal = complex(touch["normal"])
        gone += _STEP
        if len(places) > 2 and abs(place - places[0]) < 1.5 * _STEP:
            break
        if not places or gone > _SPACING or abs(np.angle(normal / normals[-1])) > _TURN:
            places.append(place)
            normals.append(normal / abs(normal))  # shorter near a concave corner
            gone = 0.0
        pose = centred.moved_along(pose, np.array([_STEP]))
    return np.array(places), np.array(normals)
