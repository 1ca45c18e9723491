"""Where a sensor may have met an object of which the pose is roughly known: one prior for each place on the outline.

The graph of a contact finds the best pose near the one it begins with. An object that may be anywhere within some
centimetres can be met at several places that are told apart later or never, and each of them needs a graph of its own.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.filter.belief import Prior
from palpate.geometry import se2
from palpate.graph.contact_geometry import ContactModel
from palpate.graph.factors.contact import overlap, reaches
from palpate.graph.factors.direction import true_angle
from palpate.types.measurements import ContactDirection, Measurement

Array = NDArray[np.float64]

_SPACING, _TURN = 0.015, np.radians(18.0)  # [m], [rad] of the normal from place to place of the tip's centre
_ALONG, _ACROSS, _YAW = 0.01, 0.003, np.radians(9.0)  # [m], [m], [rad] how far the object is from where it is thought
_PLACE = np.diag(np.square([_ACROSS, _ALONG, _YAW]))  # along the outline's normal, and along it
_STEP, _LONGEST = 0.003, 5.0  # [m] at a time on the way round, and in all
_LIKELY = 4.0  # standard deviations of the prior within which a place is thought of
_ROUGH = np.array([0.006, 0.006, 0.15])  # [m, m, rad] from which a prior is rough
_YAWS = 12  # directions all around, where nothing is known of yaw
_ANY_YAW = 1.7  # [rad] from which yaw may be any; that of all yaws alike is pi / sqrt(3)
_NOTHING = np.diag([0.0, 0.0, 100.0**2])  # [rad^2] by which nothing is known of yaw
_ROUND = 1e-4  # [m] by which places are not equally far from the middle of a round outline


def is_rough(prior: Prior, model: ContactModel) -> bool:
    """Return whether the pose is known so roughly that the sensor may meet the object at several places.

    A round object is met alike at every yaw.
    """
    rough = np.diagonal(prior.pose_covariance) > _ROUGH**2
    return bool(rough[: 2 if is_round(model) else 3].any())


def is_round(model: ContactModel) -> bool:
    """Return whether the outline looks the same at every yaw, so that no touch tells it."""
    return bool(np.ptp(np.abs(outline_places(model)[0] - model.friction_center)) < _ROUND)


def starts(
    prior: Prior, model: ContactModel, sensor_pose: Array, measurements: Sequence[Measurement]
) -> list[tuple[Prior, float]]:
    """Return what may be known when a contact begins, likely ones first, and the log of how likely each is.

    sensor_pose (3,) is the measured world_T_sensor. Yaw follows from where touch says that the tip is touched; where
    it does not say, it is as known, or one of several. The object is within _PLACE of each, whatever was known of it:
    that only says how likely a place is, for it may be a guess of how far something moved the object.
    """
    pose, around = _at_places(prior, model, sensor_pose, measurements)
    if is_round(model):
        around[:, 2, 2] = prior.pose_covariance[2, 2]
    off = se2.log(se2.between(prior.pose, pose))
    # After a long doubt nothing may be known of some pose any more, and its covariance has no inverse.
    far = np.einsum("ni,ij,nj->n", off, np.linalg.pinv(prior.pose_covariance, hermitian=True), off)
    return _likely_first(prior, pose, around, far, -0.5 * far)


def expected_starts(
    prior: Prior, model: ContactModel, sensor_pose: Array, measurements: Sequence[Measurement]
) -> list[tuple[Prior, float]]:
    """Return the same where what was known is no guess, so that it counts as much as the touch.

    A place is as likely as the prior says that the object is within _PLACE of it, and both together are what is known
    there: normal distributions of x, y and yaw in the world.
    """
    pose, around = _at_places(prior, model, sensor_pose, measurements)
    off = prior.pose - pose
    off[:, 2] = se2.wrap(off[:, 2])
    known = prior.pose_covariance
    if known[2, 2] > _ANY_YAW**2 and not is_round(model):
        known = known + _NOTHING  # it can hardly tell yaws apart
    known = _turned(known, prior.pose[2])
    gain = around @ np.linalg.pinv(around + known, hermitian=True)
    by_gain = (gain @ off[..., None])[..., 0]
    far = np.einsum("ni,ni->n", off, np.linalg.solve(around, by_gain[..., None])[..., 0])
    likely = 0.5 * (np.linalg.slogdet(gain)[1] - far)
    return _likely_first(prior, pose + by_gain, around - gain @ around, far, likely)


def _at_places(
    prior: Prior, model: ContactModel, sensor_pose: Array, measurements: Sequence[Measurement]
) -> tuple[Array, Array]:
    """Poses of the object (N, 3) at which the sensor touches it at each place, and _PLACE there in the world."""
    center, normal = outline_places(model)
    center = center - overlap(prior, reaches(model, center - model.radius * normal, normal)) * normal
    said = [one for one in measurements if isinstance(one, ContactDirection)]
    around = _PLACE
    if is_round(model):
        yaw = np.array([[sensor_pose[2] - prior.pose[2]]])
        if said:  # the place follows from yaw
            turn = -np.exp(1j * (yaw[0] + true_angle(said[0], prior))) / normal[:1]
            center, normal = (center[:1] - model.friction_center) * turn + model.friction_center, normal[:1] * turn
        around = _PLACE + _NOTHING
    elif said:
        yaw = (np.angle(-normal) - true_angle(said[0], prior))[:, None]
    else:
        yaw = np.array(_likely_yaws(prior, sensor_pose))[None]
    place = center[:, None] - np.exp(1j * yaw) * model.center
    seen = np.stack([place.real, place.imag, np.broadcast_to(yaw, place.shape)], axis=-1).reshape(-1, 3)
    pose = se2.compose(sensor_pose, se2.inverse(seen))
    return pose, _turned(around, pose[:, 2] + np.repeat(np.angle(normal), yaw.shape[1]))


def _likely_first(prior: Prior, pose: Array, covariance: Array, far: Array, likely: Array) -> list[tuple[Prior, float]]:
    """The prior at poses (N, 3) that are not too far [variances], known so along the world's axes."""
    order = [index for index in np.argsort(-likely, kind="stable") if far[index] < _LIKELY**2]
    return [(_at(prior, pose[index], covariance[index]), float(likely[index])) for index in order]


def _turned(covariance: Array, angle: ArrayLike) -> Array:
    """Covariances (..., 3, 3) of x, y and yaw, seen from axes that are turned back by angles [rad]."""
    turn = np.zeros((*np.shape(angle), 3, 3))
    turn[..., :2, :2], turn[..., 2, 2] = se2.rotation(angle), 1.0
    return turn @ covariance @ np.swapaxes(turn, -1, -2)


def _likely_yaws(prior: Prior, sensor_pose: Array) -> list[float]:
    """Yaws of the sensor in the object frame that are likely."""
    yaw, deviation = float(sensor_pose[2] - prior.pose[2]), float(np.sqrt(prior.pose_covariance[2, 2]))
    if deviation < 1.5 * _YAW:
        return [yaw]
    reach = min(2.0 * deviation, np.pi)
    count = int(np.ceil(_YAWS * reach / np.pi))
    return [yaw + reach * step / count for step in range(-count, count + (reach < np.pi))]


def _at(prior: Prior, pose: Array, covariance: Array) -> Prior:
    """The prior with another pose, of which this (3, 3) is known along the world's axes; apart from that as it was."""
    joint = prior.covariance.copy()
    joint[:3, :], joint[:, :3] = 0.0, 0.0
    joint[:3, :3] = _turned(0.5 * (covariance + covariance.T), -pose[2])
    pose[2] = se2.wrap(pose[2])
    return replace(prior, pose=pose, covariance=joint)


@lru_cache(maxsize=8)
def outline_places(model: ContactModel) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return where the centre of a tip may be when it touches and the outward normal there, all round, object frame."""
    start = np.array([[model.friction_center.real + 1.0, model.friction_center.imag, 0.0]])
    centred = replace(model, parts=np.zeros(1, np.complex128))
    pose, places, normals = start, [], []
    for _ in range(4):  # the distance is that to the nearest point, but for the grid's border
        touch = centred.touching_at(pose[0])
        way = touch["gap"] * touch["normal"]
        pose = pose - [[way.real, way.imag, 0.0]]
    gone = 0.0
    for _ in range(int(_LONGEST / _STEP)):
        touch = centred.touching_at(pose[0])
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
