"""Places all around an outline at which a sensor may meet the object, and whether the object is round."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from palpate.arrays import Array, Complex
from palpate.models.pushing.contact_geometry import ContactModel

WIDEST_NORMAL_STEP = 0.314
"""[rad] of the outline's normal from place to place: a graph finds the poses between."""
_WIDEST_SPACING = 0.015
"""[m] from place to place."""
_STEP = 6e-4
"""[m] along the outline, short at the corner of a 2 mm tip."""
_LONGEST_OUTLINE = 5.0
"""[m]"""
_ROUND_TO = 1e-4
"""[m] largest difference in distance from the centroid on a round outline."""
_TO_NEAREST_POINT = 4
"""Steps to the outline from outside: the distance is that to the nearest point, except at the grid's border."""


class OutlinePlaces(NamedTuple):
    """Places (N,) of a tip in contact, in the object frame."""

    center: Complex
    """Centre of the tip [m]."""
    normal: Complex
    """Outward normal of the outline."""


@lru_cache(maxsize=8)
def outline_places(model: ContactModel) -> OutlinePlaces:
    """Return places all around the outline, so close that a graph finds the poses between."""
    tip = replace(model, parts=np.zeros(1, np.complex128))
    pose = _on_outline(tip)
    centers: list[complex] = []
    normals: list[complex] = []
    since_place = 0.0
    for _ in range(int(_LONGEST_OUTLINE / _STEP)):
        center = complex(*pose[0, :2])
        normal = complex(tip.touching(pose[None])[0, 0]["normal"])
        since_place += _STEP
        is_around = len(centers) > 2 and abs(center - centers[0]) < 1.5 * _STEP
        if is_around:
            break
        is_far = since_place > _WIDEST_SPACING
        if not centers or is_far or abs(np.angle(normal / normals[-1])) > WIDEST_NORMAL_STEP:
            centers.append(center)
            normals.append(normal / abs(normal))  # shorter near a concave corner
            since_place = 0.0
        pose = tip.moved_along(pose, np.array([_STEP]))
    return OutlinePlaces(np.array(centers), np.array(normals))


def is_round(model: ContactModel) -> bool:
    """Return True if the outline is the same at every yaw, so that touch cannot measure it."""
    distances = np.abs(outline_places(model).center - model.friction_center)
    return bool(np.ptp(distances) < _ROUND_TO)


def _on_outline(tip: ContactModel) -> Array:
    """Return a pose (1, 3) of a tip that touches the outline, in the object frame."""
    pose = np.array([[tip.friction_center.real + 1.0, tip.friction_center.imag, 0.0]])
    for _ in range(_TO_NEAREST_POINT):
        touch = tip.touching(pose[None])[0, 0]
        pose = pose - touch["gap"] * np.array([[touch["normal"].real, touch["normal"].imag, 0.0]])
    return pose
