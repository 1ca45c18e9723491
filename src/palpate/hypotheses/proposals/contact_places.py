"""Beliefs at the places of the outline where a contact may have begun.

The graph of a contact finds the best pose near the one it begins with, so each place needs its own hypothesis.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import Array, Complex, Flags, Integers
from palpate.config import UNLIKELY
from palpate.geometry import se2
from palpate.hypotheses.bank import Hypotheses, origins
from palpate.hypotheses.outline_places import WIDEST_NORMAL_STEP, is_round, outline_places
from palpate.models.pushing.belief import Belief
from palpate.models.pushing.contact_geometry import ContactModel
from palpate.models.pushing.measurements import Step
from palpate.models.pushing.variables import DEPTH, OUTLINE_SCALE
from palpate.types.estimate import Origin

MOST_PLACES = 20
"""Hypotheses with which a contact begins at most: all faces of an outline, each at several places."""
_LOG_ODDS_OF_STAYING = 3.0
"""Log of the odds that an object with a rough pose lies where it was left, and not at another place."""
_ROUGH_SIGMA = 0.006, 0.006, 0.15
"""[m, m, rad] standard deviations of a pose beyond which it leaves several places of contact."""
_PLACE_SIGMA = 0.003, 0.01, 0.157
"""[m, m, rad] standard deviations of a place: along the normal, along the outline, yaw."""
_KNOWN_YAW_SIGMA = 0.236
"""[rad] standard deviation of a yaw up to which one value is tried."""
_ANY_YAW_SIGMA = 1.7
"""[rad] standard deviation of a yaw from which all yaws are alike."""
_PLACE_COVARIANCE = np.diag(np.square(_PLACE_SIGMA))  # along the normal, along the outline, yaw
_UNKNOWN_YAW = np.diag([0.0, 0.0, 100.0**2])  # [rad^2] variance of an unknown yaw


@dataclass(frozen=True, eq=False)
class BeliefsAtPlaces:
    """N beliefs, each at a place where a contact may begin."""

    belief: Belief
    """Belief at each place, (N,)."""
    parent: Integers
    """Row of the hypothesis that it comes from, (N,)."""
    log_likelihood: Array
    """Log probability of the place in that hypothesis, (N,)."""

    def take(self, indices: Integers) -> "BeliefsAtPlaces":
        """Return some of these."""
        return BeliefsAtPlaces(self.belief.take(indices), self.parent[indices], self.log_likelihood[indices])


def most_of_rough_start(model: ContactModel) -> int:
    """Return the most places at which an object may be met whose first pose is hardly known.

    Of a hand it is twice as many with the fingers as stated, and as many again with them exchanged: at the first frame
    the right one of some hundred was the 20th to 35th of its half.
    """
    return 2 * MOST_PLACES if model.fingers else MOST_PLACES


def is_rough(belief: Belief, model: ContactModel, limit: ArrayLike = _ROUGH_SIGMA) -> Flags:
    """Return True (B,) for beliefs with larger standard deviations than the limit (3,) [m, m, rad] at the centroid.

    A round object is met alike at every yaw.
    """
    at_centroid = model.to_centroid @ belief.pose_covariance @ model.to_centroid.T
    variances = np.diagonal(at_centroid, axis1=1, axis2=2)
    is_larger = variances > np.square(limit)
    return np.any(is_larger[:, :2] if is_round(model) else is_larger, axis=1)


def is_contradicted(belief: Belief, touch_sign: Array, model: ContactModel, step: Step) -> Flags:
    """Return True (B,) where the measured direction of the contact is unlikely, as on the wrong side of a corner."""
    directions = step.directions(belief, touch_sign)
    if not directions or is_round(model):
        return np.zeros(len(touch_sign), np.bool_)
    angle, variance = directions[0]
    expected = model.directions(se2.between(belief.pose, step.sensor_pose))
    deviation = np.sqrt(variance + belief.pose_covariance[:, 2, 2])
    return np.abs(se2.wrap(angle - expected)) > UNLIKELY * deviation


def hypotheses_at(
    rows: Hypotheses, places: BeliefsAtPlaces, origin: Origin, disturbed_steps_left: Integers
) -> Hypotheses:
    """Return hypotheses at places, of this origin; they are copies of those that they come from, `rows`.

    Something else may still move the object of each for so many steps (N,).
    """
    parents = rows.take(places.parent)
    return replace(
        parents,
        belief=places.belief,
        log_prior=parents.log_prior + places.log_likelihood - _LOG_ODDS_OF_STAYING,
        weight=np.ones(len(parents)),
        disturbed_steps_left=disturbed_steps_left,
        origin=origins(len(parents), origin),
    )


def choose_beliefs(condition: Flags, chosen: Belief, other: Belief) -> Belief:
    """Return the rows of one belief where the condition (B,) holds, else those of the other."""
    count = len(condition)
    return other.joined(chosen).take(np.arange(count) + count * condition)


def beliefs_at_places(
    beliefs: Belief, searched: Integers, touch_sign: Array, model: ContactModel, step: Step, is_guess: Flags
) -> BeliefsAtPlaces:
    """Return the beliefs at all likely places, for some rows `searched` of the beliefs (B,).

    The product of both Gaussians, that of the belief and that of the place, is the belief there, and its weight the
    probability. A guess (B,) only says how likely each place is: the object is within the place's deviation of it.
    """
    prior = beliefs.take(searched)
    places = _places_of_contact(prior, touch_sign[searched], model, step)
    guess = is_guess[searched][places.parent]
    # Both Gaussians in the axes of the world. What one of them does not know of yaw, the other one tells.
    prior_covariance = prior.pose_covariance.copy()
    place_covariance = places.covariance.copy()
    if is_round(model):
        place_covariance[guess, 2, 2] = prior_covariance[places.parent[guess], 2, 2]
    else:
        prior_covariance[prior_covariance[:, 2, 2] > _ANY_YAW_SIGMA**2] += _UNKNOWN_YAW
    off = prior.pose[places.parent] - places.pose
    off[:, 2] = se2.wrap(off[:, 2])
    in_world = _in_turned_axes(prior_covariance, prior.pose[:, 2])[places.parent]
    joint = in_world + np.where(guess[:, None, None], 0.0, place_covariance)
    # Likely places: those within some deviations of the belief.
    near = np.flatnonzero(np.square(off[:, 2]) < UNLIKELY**2 * joint[:, 2, 2])  # by yaw, no more than by all three
    may_be_singular = guess[near].any()  # a guess, after a long doubt; its inverse takes seven times as long
    information = np.linalg.pinv(joint[near], hermitian=True) if may_be_singular else np.linalg.inv(joint[near])
    squared_distance = np.einsum("ni,nij,nj->n", off[near], information, off[near])  # [variances]
    is_near = squared_distance < UNLIKELY**2
    near = near[is_near]
    # Their product.
    parent = places.parent[near]
    gain = place_covariance[near] @ information[is_near]
    log_of_product = np.where(guess[near], 0.0, 0.5 * np.linalg.slogdet(gain)[1])
    log_likelihood = -0.5 * squared_distance[is_near] + log_of_product
    gain[guess[near]] = 0.0
    belief = _updated(prior.take(parent), places.pose[near], place_covariance[near], gain, off[near])
    return BeliefsAtPlaces(belief, searched[parent], log_likelihood)


def _updated(prior: Belief, place: Array, covariance: Array, gain: Array, off: Array) -> Belief:
    """Return beliefs whose poses are products of two Gaussians, that of a prior and that of a place (N, 3).

    The covariance (N, 3, 3) of the place, the gain (N, 3, 3) of the update, and the difference of the prior from the
    place, `off` (N, 3), are in the axes of the world.
    """
    pose = place + (gain @ off[..., None])[..., 0]
    covariance = covariance - gain @ covariance
    covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
    joint = prior.covariance.copy()
    joint[:, :3, :] = 0.0
    joint[:, :, :3] = 0.0
    joint[:, :3, :3] = _in_turned_axes(covariance, -pose[:, 2])
    pose[:, 2] = se2.wrap(pose[:, 2])
    return Belief(pose, prior.values, joint)


class _Places(NamedTuple):
    """Places of contact (N,)."""

    pose: Array
    """world_T_object with which the sensor touches the place, (N, 3) [m, m, rad]."""
    covariance: Array
    """Covariance (N, 3, 3) in the axes of the world."""
    parent: Integers
    """Row of the belief (N,) for which it is one."""


class _Contacts(NamedTuple):
    """Contacts that are tried, of B beliefs at P places with Y yaws of the sensor in the object frame."""

    center: Complex
    """Centre of the tip in the object frame, (B, P) [m]."""
    normal: Complex
    """Outward normal of the outline there, (B, P)."""
    yaw: Array
    """Yaw of the sensor in the object frame, (B, 1 or P, Y) [rad]."""
    is_likely: Flags
    """True for those that are likely; broadcast to (B, P, Y)."""


def _places_of_contact(belief: Belief, touch_sign: Array, model: ContactModel, step: Step) -> _Places:
    """Return the object poses at which the sensor touches the places of the outline, for beliefs (B,)."""
    contacts = _contacts(belief, touch_sign, model, step)
    tips = contacts.center[..., None] - np.exp(1j * contacts.yaw) * model.center
    parent, place, which_yaw = np.nonzero(np.broadcast_to(contacts.is_likely, tips.shape))
    position = tips[parent, place, which_yaw]
    yaw = np.broadcast_to(contacts.yaw, tips.shape)[parent, place, which_yaw]
    sensor_in_object = np.stack([position.real, position.imag, yaw], axis=-1)
    pose = se2.compose(step.sensor_pose, se2.inverse(sensor_in_object))
    normal_in_world = pose[:, 2] + np.angle(contacts.normal)[parent, place]
    if is_round(model):
        return _Places(pose, _in_turned_axes(_PLACE_COVARIANCE + _UNKNOWN_YAW, normal_in_world), parent)
    covariance = _in_turned_axes(_PLACE_COVARIANCE, normal_in_world)
    # A yaw that is off turns the object about the tip.
    tip = se2.transform(step.sensor_pose, np.array([model.center.real, model.center.imag]))
    about_tip = np.tile(np.eye(3), (len(pose), 1, 1))
    about_tip[:, :2, 2] = (pose[:, :2] - tip)[:, ::-1] * (-1.0, 1.0)
    return _Places(pose, about_tip @ covariance @ about_tip.transpose(0, 2, 1), parent)


def _contacts(belief: Belief, touch_sign: Array, model: ContactModel, step: Step) -> _Contacts:
    """Return the contacts that are tried, with the indentation that is expected of each belief."""
    center, normal = outline_places(model)
    arm = center - model.radius * normal - model.friction_center
    indentation = belief.of_finger(DEPTH, model.finger) - belief[OUTLINE_SCALE] * (normal.conjugate() * arm).real
    center = center - indentation * normal
    normal = np.broadcast_to(normal, center.shape)
    directions = step.directions(belief, touch_sign)
    yaw = (step.sensor_pose[2] - belief.pose[:, 2])[:, None, None]
    is_certain = np.ones((1, 1, 1), np.bool_)
    if is_round(model) and directions:  # the place follows from yaw
        angle, _ = directions[0]
        rotation = -np.exp(1j * (yaw[:, 0] + angle[:, None])) / normal[:, :1]
        rotated = (center[:, :1] - model.friction_center) * rotation + model.friction_center
        return _Contacts(rotated, normal[:, :1] * rotation, yaw, is_certain)
    if is_round(model):
        return _Contacts(center, normal, yaw, is_certain)
    if directions:  # yaw follows from the place
        angle, _ = directions[0]
        return _Contacts(center, normal, (np.angle(-normal) - angle[:, None])[..., None], is_certain)
    yaw_offsets, is_likely = _likely_yaw_offsets(np.sqrt(belief.pose_covariance[:, 2, 2]))
    return _Contacts(center, normal, yaw + yaw_offsets[:, None], is_likely[:, None])


def _likely_yaw_offsets(deviation: Array) -> tuple[Array, Flags]:
    """Return offsets (B, Y) [rad] of a yaw of this deviation (B,), and True where they are likely and not repeated."""
    widest = np.minimum(2.0 * deviation, np.pi)
    count = np.where(deviation < _KNOWN_YAW_SIGMA, 0, np.ceil(widest / WIDEST_NORMAL_STEP))[:, None]
    most = count.max(initial=0.0)
    steps = np.arange(-most, most + 1.0)
    is_half_a_turn = (widest[:, None] >= np.pi) & (steps == count)  # which is the same as one the other way
    is_likely = (np.abs(steps) <= count) & ~is_half_a_turn
    return widest[:, None] * steps / np.maximum(count, 1.0), is_likely


def _in_turned_axes(covariance: Array, angle: ArrayLike) -> Array:
    """Return covariances (..., 3, 3) of x, y and yaw in axes that are turned back by angles (...) [rad]."""
    rotation = np.zeros((*np.shape(angle), 3, 3))
    rotation[..., :2, :2] = se2.rotation(angle)
    rotation[..., 2, 2] = 1.0
    return rotation @ covariance @ np.swapaxes(rotation, -1, -2)
