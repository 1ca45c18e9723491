"""The light in a gel: three coloured lights on its skin, seen from inside.

Seen from inside, the gel at rest is hollow and an imprint in it is a bump. A light therefore makes the far side of the
hollow glow, and of a bump the flank that is turned to it: glow and bright flank of one colour lie on opposite sides
across the pad, where the gel is curved most. In a flat gel they lie on one side, as on a real GelSight Mini. Beyond a
bump its light is missing. So it is on real DIGITs, and with
M. K. Johnson, E. H. Adelson, "Retrographic sensing", 2009, which reads the slopes from three such lights.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from palpate.lab.simulate.unit import SensorUnit

Image = NDArray[np.float32]

_FOLD = 8e-4  # [m] over which a fold at the contact's rim takes light away
_FOLD_LEVELS = 3.5e5  # [grey levels per m of height above the surroundings]
_FOLD_LIMIT = 60.0  # [grey levels] that no fold exceeds
_COARSE = 4  # shadows have soft borders, for which one of so many pixels is enough
_REACH = np.linspace(4e-4, 4e-3, 8)  # [m] from a point towards a light at which something may stand in its way
_PENUMBRA = 1.5e-4  # [m] of height over which a shadow sets in
_MIDDLE = 100.0  # [grey levels] at which cameras of all responses answer alike


def shading(unit: SensorUnit, height: Image) -> Image:
    """Return what a gel pressed in by height (height, width) [m] adds to the image without contact [grey levels].

    The result is (height, width, 3), RGB.
    """
    import cv2

    rest_right, rest_up, rest_lit, strength, answer = _rest(unit)
    scale = 1.0 / (8.0 * unit.pitch)
    right = rest_right - cv2.Sobel(height, cv2.CV_32F, 1, 0, ksize=3, scale=scale)
    up = rest_up + cv2.Sobel(height, cv2.CV_32F, 0, 1, ksize=3, scale=scale)
    shrink = 1.0 / np.sqrt(right * right + up * up + 1.0)
    lit = np.empty((*height.shape, 3), np.float32)
    shadow = _shadows(unit, height)
    for index, (x, y, z) in enumerate(unit.light.astype(np.float32)):
        facing = np.maximum((x * right + y * up + z) * shrink, 0.0) * (1.0 - shadow[..., index])
        lit[..., index] = (facing - rest_lit[index]) * strength[index]
    difference = np.asarray(cv2.transform(lit, unit.colour.T.astype(np.float32)), np.float32)
    fold = np.float32(unit.fold * _FOLD_LEVELS) * (height - cv2.GaussianBlur(height, (0, 0), _FOLD / unit.pitch))
    fold /= 1.0 + np.abs(fold) / np.float32(_FOLD_LIMIT)
    return np.asarray(difference * answer + fold[..., None], np.float32)


def _shadows(unit: SensorUnit, height: Image) -> Image:
    """Return how much of each light is kept away by what stands between, (height, width, 3), 0 to unit.shadow."""
    import cv2

    size = (height.shape[1], height.shape[0])
    coarse = cv2.resize(height, (size[0] // _COARSE, size[1] // _COARSE), interpolation=cv2.INTER_AREA)
    pitch = _COARSE * unit.pitch
    shadow = np.empty((*coarse.shape, 3), np.float32)
    for index, (x, y, z) in enumerate(unit.light):
        level = math.hypot(x, y)
        above = np.zeros_like(coarse)
        for reach in _REACH:
            step = np.array([(1.0, 0.0, reach * x / level / pitch), (0.0, 1.0, -reach * y / level / pitch)])
            there = cv2.warpAffine(
                coarse, step, coarse.shape[::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderValue=0.0
            )
            above = np.maximum(above, there - coarse - np.float32(reach * z / level))
        shadow[..., index] = unit.shadow * above / (above + np.float32(_PENUMBRA))
    return np.asarray(cv2.resize(shadow, size, interpolation=cv2.INTER_LINEAR), np.float32)


@functools.lru_cache(maxsize=16)
def _rest(unit: SensorUnit) -> tuple[Image, Image, Image, Image, Image]:
    """Of the gel at rest: slopes of its normal to the right and up, how it faces the lights, their strengths, answer.

    The answer is the camera's, (height, width, 3): what a grey level of light makes of grey levels in its image.
    """
    right, up = unit.rest_slope
    shrink = 1.0 / np.sqrt(right * right + up * up + 1.0)
    light = unit.light.astype(np.float32)[:, :, None, None]
    lit = np.maximum((light[:, 0] * right + light[:, 1] * up + light[:, 2]) * shrink, 0.0)
    # Light that has been scattered in the gel fills the gaps between cones and streaks.
    strength = np.asarray(0.6 + 0.4 * np.minimum(unit.illumination, 2.5), np.float32)
    answer = np.asarray((np.maximum(unit.no_contact, 20) / _MIDDLE) ** unit.response, np.float32)
    return right, up, lit, strength, answer
