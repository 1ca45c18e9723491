"""Light in a gel: three coloured lights on its skin, seen from inside, and the dark markers on the skin.

Seen from inside, the gel at rest is hollow and an imprint is a bump. A light makes the far side of the hollow glow, but
the near flank of a bump: across a round gel, glow and bright flank of one colour lie on opposite sides. In a flat gel
they lie on one side, as on a real GelSight Mini. A bump casts a shadow. Real DIGITs look like this; M. K. Johnson,
E. H. Adelson, "Retrographic sensing", 2009 read the slopes from three such lights.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from palpate.lab.simulate.unit import Markers, SensorUnit

Image = NDArray[np.float32]

_FOLD_WIDTH = 8e-4  # [m] over which a fold at the contact's rim takes light away
_FOLD_LEVELS = 3.5e5  # [grey levels per m of height above the surroundings]
_FOLD_LIMIT = 60.0  # [grey levels] most that a fold changes
_COARSE = 4  # [px] shadows have soft borders; an image smaller by this factor is enough
_REACH = np.linspace(4e-4, 4e-3, 8)  # [m] from a point towards a light, where a bump may stand in its way
_PENUMBRA = 1.5e-4  # [m] of height over which a shadow sets in
_PRESSED_APART = 4e-4  # [m] by which a slope of 1 moves a marker outwards
_SUBPIXEL_BITS = 4  # of a marker's position as OpenCV draws it


def shading(unit: SensorUnit, height: Image) -> Image:
    """Return the change of the image (height, width, 3) [grey levels] of a gel pressed in by height [m]."""
    import cv2

    rest_right, rest_up, rest_lit, strength, response = _rest(unit)
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
    fold = np.float32(unit.fold * _FOLD_LEVELS) * (height - cv2.GaussianBlur(height, (0, 0), _FOLD_WIDTH / unit.pitch))
    fold /= 1.0 + np.abs(fold) / np.float32(_FOLD_LIMIT)
    return np.asarray(difference * response + fold[..., None], np.float32)


def marker_transmission(
    markers: Markers, shape: tuple[int, ...], pitch: float, height: Image | None, shift: float
) -> Image:
    """Return the share of light that the markers let pass at each pixel, (height, width, 1).

    pitch is the width of a pixel [m], height (height, width) the indentation of the skin [m], None for no contact, and
    shift the motion of the skin in contact towards +y [m].
    """
    import cv2

    dots = markers.dots if height is None else markers.dots + _displacement(markers.dots, pitch, height, shift)
    dark = np.zeros(shape[:2], np.uint8)
    parts = 2**_SUBPIXEL_BITS
    for column, row in np.rint(dots * parts).astype(int).tolist():
        radius = round(markers.radius * parts)
        cv2.circle(dark, (column, row), radius, 255, cv2.FILLED, cv2.LINE_AA, _SUBPIXEL_BITS)
    soft = cv2.GaussianBlur(dark, (0, 0), 0.6).astype(np.float32)  # [px] soft border of a marker
    return 1.0 - np.float32(markers.dark / 255.0) * soft[..., None]


def _displacement(dots: Image, pitch: float, height: Image, shift: float) -> Image:
    """Return the motion of markers (n, 2) away from rest, (n, 2) [px]."""
    import cv2

    smooth = cv2.GaussianBlur(height, (0, 0), 4e-4 / pitch)  # [m] over which the skin moves as one
    slope = [cv2.Sobel(smooth, cv2.CV_32F, *by, ksize=3, scale=0.125 / pitch) for by in ((1, 0), (0, 1))]
    held = smooth / max(float(smooth.max()), 1e-6)
    motion = [shift * held - _PRESSED_APART * slope[0], -_PRESSED_APART * slope[1]]
    column, row = np.ascontiguousarray(dots.T)
    return np.stack([cv2.remap(each, column, row, cv2.INTER_LINEAR)[:, 0] / pitch for each in motion], axis=-1)


def _shadows(unit: SensorUnit, height: Image) -> Image:
    """Return the share of each light that is blocked, (height, width, 3), 0 to unit.shadow."""
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
    """Return slopes of the gel at rest to the right and up, its lighting (3, ...), light strengths, camera response.

    The response (height, width, 3) is the camera's grey levels per grey level of light; it is 1 at a level of 100.
    """
    right, up = unit.rest_slope
    shrink = 1.0 / np.sqrt(right * right + up * up + 1.0)
    light = unit.light.astype(np.float32)[:, :, None, None]
    lit = np.maximum((light[:, 0] * right + light[:, 1] * up + light[:, 2]) * shrink, 0.0)
    # Light scattered in the gel fills the gaps between cones and streaks.
    strength = np.asarray(0.6 + 0.4 * np.minimum(unit.illumination, 2.5), np.float32)
    response = np.asarray((np.maximum(unit.no_contact, 20) / 100.0) ** unit.response, np.float32)
    return right, up, lit, strength, response
