"""Where the contact patch is and what ellipse it makes: engineered features, without learning (paper Sec. V-B)."""

import math

import numpy as np
from numpy.typing import NDArray

from palpate.touch.background import Background, Image, check_image

Array = NDArray[np.float64]
Outline = NDArray[np.float32]

_SIDE = 120  # pixels of the shorter side at which the patch is sought: enough for a patch, and little noise is left
_BLUR = 1.5  # [px of these]
_CLOSE = 11  # [px] gaps that are closed: ball and dome show as rings, their middle is as flat as the untouched gel
_LEAST_LEVELS = 3.0  # [grey levels] by which the faintest part of a patch differs; blurred noise does by less than 1
_LEAST_AREA = 40.0  # [px^2] 0.2 % of the image, 0.9 mm^2 of a DIGIT's pad


def patch_outline(image: Image, background: Background) -> Outline | None:
    """Return the convex outline of the contact patch, (N, 2) pixels (column, row), or None where there is no patch.

    The change from the untouched gel, less what has shifted all of a channel, is averaged over the channels and split
    by Otsu's threshold. The hull of the largest contour is the patch: it fills what a ring or the shading of a slope
    leaves open. Raises SettingError on an image of another size or type than the background's.
    """
    import cv2

    height, width = background.mean.shape[:2]
    check_image(image, height, width)
    scale = max(min(height, width) / _SIDE, 1.0)
    columns, rows = round(width / scale), round(height / scale)
    change = cv2.subtract(image, background.mean, dtype=cv2.CV_32F)
    change = cv2.GaussianBlur(cv2.resize(change, (columns, rows), interpolation=cv2.INTER_AREA), (0, 0), _BLUR)
    levels = np.abs(change - np.median(change, axis=(0, 1))).mean(axis=-1)
    step = max(float(levels.max()) / 255.0, 1e-6)
    otsu, _ = cv2.threshold((levels / step).astype(np.uint8), 0.0, 1.0, cv2.THRESH_OTSU)
    patch = (levels > max((otsu + 0.5) * step, _LEAST_LEVELS)).astype(np.uint8)
    for operation, size in ((cv2.MORPH_OPEN, 3), (cv2.MORPH_CLOSE, _CLOSE)):
        patch = cv2.morphologyEx(patch, operation, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
    contours, _ = cv2.findContours(patch, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    hull = cv2.convexHull(max(contours, key=cv2.contourArea))
    if cv2.contourArea(hull) < _LEAST_AREA:
        return None
    stretch = (width / columns, height / rows)
    return ((hull[:, 0] + 0.5) * stretch - 0.5).astype(np.float32)


def ellipse_features(image: Image, background: Background) -> Array:
    """Return what ellipse fits the contact patch best, (6,), all NaN where there is no patch.

    Column and row of the centre, in widths and heights of the image; the full major and minor axes, in widths; cosine
    and sine of the major axis' angle from the columns' direction (right) to the rows' (down). An axis has no sign: its
    angle is from 0 to below pi, so that it jumps where a patch lies along the rows, and not where it stands along the
    columns, as those of an upright sensor do. The angle of a round patch means nothing.
    """
    import cv2

    outline = patch_outline(image, background)
    if outline is None:
        return np.full(6, np.nan)
    (column, row), axes, degrees = cv2.fitEllipse(_evenly(outline))
    height, width = background.mean.shape[:2]
    # OpenCV gives the angle of the first axis, which is the minor one.
    angle = math.radians(degrees + (90.0 if axes[1] >= axes[0] else 0.0)) % math.pi
    center = (column + 0.5) / width, (row + 0.5) / height
    return np.array([*center, max(axes) / width, min(axes) / width, math.cos(angle), math.sin(angle)])


def _evenly(outline: Outline, count: int = 64) -> Outline:
    """As many points at even steps along a closed outline: a fit would lean to where corners are dense."""
    closed = np.concatenate([outline, outline[:1]])
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(closed, axis=0).T)))
    at = np.linspace(0.0, way[-1], count, endpoint=False)
    return np.stack([np.interp(at, way, closed[:, 0]), np.interp(at, way, closed[:, 1])], axis=-1).astype(np.float32)
