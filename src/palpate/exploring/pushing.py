"""Motion of the object while it is pushed: quasi-static, on an ellipsoidal limit surface, with a Coulomb contact.

The motion needs no outline: where a tip touches, and along which normal, are known in the world. Source: Lynch and
Mason, 1996, as in `models.pushing`.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Complex
from palpate.exploring.rows import CENTER, CENTER_IN_OBJECT, Place, Rows


@dataclass(frozen=True)
class _Settings:
    """Settings of the motion."""

    along_normal: float = 0.1
    """Error of the motion along the normal, as a share of the sensor's motion, new in each frame."""
    across_normal: float = 0.2
    """The same across the normal."""
    turn: float = 0.2
    """Error of the turn, as a share of the sensor's motion over the friction radius."""
    friction: float = 0.2
    """Change from contact to contact of the logarithms of grip and of the squared friction radius."""
    center: float = 0.03
    """Change from contact to contact of the centre of friction, as a share of the friction radius."""
    steepest: float = 0.05
    """Least share of a sliding contact's motion that goes along its normal."""


_SETTINGS = _Settings()
_VARIABLES = np.array((CENTER.start, CENTER.start + 1, Place.FRICTION_RADIUS, Place.GRIP))  # that the motion depends on
_MOVED = np.array((CENTER.start, CENTER.start + 1, Place.YAW))


class Push(NamedTuple):
    """Motion of a tip that touches, in the world."""

    point: complex
    """Contact point [m]."""
    normal: complex
    """Inward normal of the outline there, a unit vector."""
    motion: complex
    """Motion of the sensor's surface there [m]."""


def begin_contact(rows: Rows) -> None:
    """Let friction change, as pressure and place on the gel do from contact to contact."""
    radius = np.exp(0.5 * rows.mean[:, Place.FRICTION_RADIUS])
    for place in (Place.FRICTION_RADIUS, Place.GRIP):
        rows.covariance[:, place, place] += _SETTINGS.friction**2
    to_world = np.stack((rows.rotation, 1j * rows.rotation), axis=1)
    turned = np.stack((to_world.real, to_world.imag), axis=1)  # (B, 2, 2)
    variance = np.square(_SETTINGS.center * radius)
    both = variance[:, None, None] * turned
    for axes in (CENTER, CENTER_IN_OBJECT):
        rows.covariance[:, axes, axes] += variance[:, None, None] * np.eye(2)
    rows.covariance[:, CENTER, CENTER_IN_OBJECT] += both
    rows.covariance[:, CENTER_IN_OBJECT, CENTER] += both.transpose(0, 2, 1)


def move(rows: Rows, push: Push) -> None:
    """Move the object of each row with a push, and widen its covariance."""
    values = rows.mean[:, _VARIABLES]
    moved = _moved(values, push)
    steps = np.sqrt(rows.covariance[:, _VARIABLES, _VARIABLES])
    # Differences over a standard deviation each way, as a derivative at the mean does not see where sliding begins.
    steps = np.clip(steps, 1e-5, np.array((0.02, 0.02, 0.5, 0.5)))
    change = np.empty((len(values), 3, 4))
    for variable in range(4):
        apart = np.zeros(values.shape)
        apart[:, variable] = steps[:, variable]
        difference = _moved(values + apart, push) - _moved(values - apart, push)
        change[:, :, variable] = difference / (2.0 * steps[:, variable, None])
    rows.mean[:, _MOVED] += moved
    _spread(rows, change)
    _widen(rows, push)


def carry(rows: Rows, push: Push, turn: float) -> None:
    """Move the object of each row with several tips that touch at once: it turns [rad] with them and does not slide."""
    lever = rows.center - push.point
    rolled = np.exp(1j * turn) - 1.0
    shift = push.motion + rolled * lever
    rows.mean[:, _MOVED] += np.column_stack((shift.real, shift.imag, np.full(len(shift), turn)))
    change = np.zeros((3, 4))
    change[:2, :2] = ((rolled.real, -rolled.imag), (rolled.imag, rolled.real))
    _spread(rows, change)
    _widen(rows, push)


def _spread(rows: Rows, change: Array) -> None:
    """Take a change of the motion with each variable, (B, 3, 4) or (3, 4), to the covariance."""
    rows.covariance[:, _MOVED, :] += change @ rows.covariance[:, _VARIABLES, :]
    rows.covariance[:, :, _MOVED] += rows.covariance[:, :, _VARIABLES] @ np.swapaxes(change, -1, -2)


def _moved(values: Array, push: Push) -> Array:
    """Return the motion (B, 3) [m, m, rad] of the object about its centre of friction, by variables (B, 4)."""
    center = values[:, 0] + 1j * values[:, 1]
    radius_squared = np.exp(values[:, 2])
    widest = np.arctan(np.exp(values[:, 3]))  # angle of the friction cone
    forward = (push.motion * push.normal.conjugate()).real
    if forward <= 0.0:
        return np.zeros((len(values), 3))
    lever = 1j * (push.point - center)
    sticking = push.motion - lever * _dot(lever, push.motion) / (radius_squared + np.abs(lever) ** 2)
    angle = np.angle(sticking * push.normal.conjugate())
    edge = push.normal * np.exp(1j * np.sign(angle) * widest)
    at_contact = edge + lever * _dot(lever, edge) / radius_squared
    along_normal = np.maximum((at_contact * push.normal.conjugate()).real, _SETTINGS.steepest)
    shift: Complex = np.where(np.abs(angle) > widest, edge * forward / along_normal, sticking)
    turn = _dot(lever, shift) / radius_squared
    return np.column_stack((shift.real, shift.imag, turn))


def _dot(left: Complex, right: Complex | complex) -> Array:
    """Return the scalar products of vectors, (B,)."""
    return (left.conjugate() * right).real


def _widen(rows: Rows, push: Push) -> None:
    """Add the errors of a motion to the covariance."""
    length = abs(push.motion)
    normal = np.array((push.normal.real, push.normal.imag))
    across = np.array((-push.normal.imag, push.normal.real))
    along = (_SETTINGS.along_normal * length) ** 2 * np.outer(normal, normal)
    rows.covariance[:, CENTER, CENTER] += along + (_SETTINGS.across_normal * length) ** 2 * np.outer(across, across)
    radius_squared = np.exp(rows.mean[:, Place.FRICTION_RADIUS])
    rows.covariance[:, Place.YAW, Place.YAW] += (_SETTINGS.turn * length) ** 2 / radius_squared
