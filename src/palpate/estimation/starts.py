"""Where a sensor may have met an object of which the pose is roughly known: one prior for each place on the outline.

The graph of a contact finds the best pose near the one it begins with. An object that may be anywhere within some
centimetres can be met at several places that are told apart later or never, and each of them needs a graph of its own.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.estimation.belief import Prior
from palpate.estimation.contact_model import ContactModel
from palpate.estimation.unknowns import DEPTH, DIRECTION_BIAS
from palpate.geometry import se2
from palpate.recording.measurements import ContactDirection, Measurement

Array = NDArray[np.float64]

_SPACING, _TURN = 0.015, np.radians(18.0)  # [m], [rad] of the normal from place to place of the tip's centre
_ALONG, _ACROSS, _YAW = 0.01, 0.003, np.radians(9.0)  # [m], [m], [rad] how far the object is from where it is thought
_PLACE = np.square([_ALONG, _ACROSS, _YAW])
_STEP, _LONGEST = 0.003, 5.0  # [m] at a time on the way round, and in all
_LIKELY = 4.0  # standard deviations of the prior within which a place is thought of
_ROUGH = np.array([0.006, 0.006, 0.15])  # [m, m, rad] from which a prior is rough
_IMPOSSIBLE = 12.0  # log of how unlikely anything is at most
_YAWS = 12  # directions all around, where nothing is known of yaw


def is_rough(prior: Prior) -> bool:
    """Return whether the pose is known so roughly that the sensor may meet the object at several places."""
    return bool((np.diagonal(prior.pose_covariance) > _ROUGH**2).any())


def starts(
    prior: Prior, model: ContactModel, sensor_pose: Array, measurements: Sequence[Measurement]
) -> list[tuple[Prior, float]]:
    """Return what may be known when a contact begins, likely ones first, and the log of how likely each is.

    sensor_pose (3,) is the measured world_T_sensor. Yaw follows from where touch says that the tip is touched; where
    it does not say, it is as known, or one of several.
    """
    center, normal = places(model)
    tip, center = model.centers[0], center - prior[DEPTH][0] * normal
    said = [one for one in measurements if isinstance(one, ContactDirection)]
    found: list[tuple[Prior, float]] = []
    # After a long doubt nothing may be known of some pose any more, and its covariance has no inverse.
    information = np.linalg.pinv(prior.pose_covariance, hermitian=True)
    wide = _log_share(prior.pose_covariance, _PLACE)
    for at, outward in zip(center, normal, strict=True):
        if said:
            yaws = [np.angle(-outward) - said[0].angle + float(prior[DIRECTION_BIAS][0])]
        else:
            yaws = _likely_yaws(prior, sensor_pose)
        for yaw in yaws:
            place = at - np.exp(1j * yaw) * tip
            g = np.array([place.real, place.imag, se2.wrap(yaw)])
            pose = se2.compose(sensor_pose, se2.inverse(g))
            off = se2.between(prior.pose, pose)
            off[2] = se2.wrap(off[2])
            far = float(off @ information @ off)
            if far < _LIKELY**2:
                found.append((_at(prior, pose, outward), -0.5 * far + wide))
    return sorted(found, key=lambda one: -one[1])


def log_likely(prior: Prior, model: ContactModel, sensor_pose: Array, measurements: Sequence[Measurement]) -> float:
    """Return the log of how likely the object is touched from here, and where touch says, as `starts` has it."""
    g = se2.between(prior.pose, sensor_pose)
    touch = model.touching(g[None, None])[0, 0, 0]
    by_g = [np.asarray(touch["gap_by_g"])]
    off, known = [float(touch["gap"]) + float(prior[DEPTH][0])], [_ACROSS**2]
    said = [one for one in measurements if isinstance(one, ContactDirection)]
    if said:
        normal = complex(touch["normal"])
        turned = (np.conj(normal) * touch["normal_by_g"]).imag / abs(normal) ** 2
        by_g.append(turned - [0.0, 0.0, 1.0])
        bias = float(prior[DIRECTION_BIAS][0])
        off.append(float(np.angle(-normal * np.exp(1j * (bias - said[0].angle - g[2])))))
        known.append(_YAW**2)
    by_object = -np.array(by_g) @ se2.adjoint(se2.inverse(g))
    covariance = by_object @ prior.pose_covariance @ by_object.T + np.diag(known)
    far = off @ np.linalg.solve(covariance, off)
    return max(-0.5 * float(far) + _log_share(covariance, known), -_IMPOSSIBLE)


def _log_share(covariance: Array, of: ArrayLike) -> float:
    """Log of the share that what is as exact as variances is of what is known by a covariance, one at most."""
    variance, among = np.linalg.eigvalsh(covariance), np.sort(of)
    return 0.5 * float(np.minimum(np.log(among / np.maximum(variance, 1e-30)), 0.0).sum())


def _likely_yaws(prior: Prior, sensor_pose: Array) -> list[float]:
    """Yaws of the sensor in the object frame that are likely."""
    yaw, deviation = float(sensor_pose[2] - prior.pose[2]), float(np.sqrt(prior.pose_covariance[2, 2]))
    if deviation < 1.5 * _YAW:
        return [yaw]
    reach = min(2.0 * deviation, np.pi)
    count = int(np.ceil(_YAWS * reach / np.pi))
    return [yaw + reach * step / count for step in range(-count, count + (reach < np.pi))]


def _at(prior: Prior, pose: Array, outward: complex) -> Prior:
    """The prior of a place: near it and apart from that as it was; covariance in the tangent space at the pose."""
    along, across = 1j * outward, outward
    turn = np.array([[along.real, across.real], [along.imag, across.imag]])
    joint = prior.covariance.copy()
    joint[:3, :], joint[:, :3] = 0.0, 0.0
    joint[:3, :3] = np.diag(_PLACE)
    joint[:2, :2] = turn @ joint[:2, :2] @ turn.T
    return replace(prior, pose=pose, covariance=joint)


@lru_cache(maxsize=8)
def places(model: ContactModel) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return where the centre of a tip may be when it touches and the outward normal there, all round, object frame."""
    start = np.array([[model.friction_center.real + 1.0, model.friction_center.imag, 0.0]])
    centred = replace(model, centers=np.zeros(1, np.complex128), row=np.zeros(1))
    pose, places, normals = start, [], []
    for _ in range(4):  # the distance is that to the nearest point, but for the grid's border
        touch = centred.touching(pose[None])[0, 0, 0]
        way = touch["gap"] * touch["normal"]
        pose = pose - [[way.real, way.imag, 0.0]]
    gone = 0.0
    for _ in range(int(_LONGEST / _STEP)):
        touch = centred.touching(pose[None])[0, 0, 0]
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
