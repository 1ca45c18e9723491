"""Markers: a grid of black dots on a gel's skin, which move with it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

_SPACING, _RADIUS = (1.2e-3, 2.4e-3), (1.8e-4, 3e-4)  # [m] from dot to dot, and of a dot
_OFF_GRID = 0.05  # of the spacing, by which a dot may be off the grid
_DARK = (0.5, 0.9)  # share of the light that a dot takes away
_PRESSED_APART = 4e-4  # [m] by which a slope of 1 moves a dot outwards
_BORDER = 0.6  # [px] over which a dot's border goes over into the gel
_SHIFT = 4  # bits of a pixel to which a dot's place is drawn
_COARSE = 4e-4  # [m] over which the skin moves as one


@dataclass(frozen=True, eq=False)
class Markers:
    """The dots of one gel."""

    dots: NDArray[np.float32]
    """Columns and rows of their centres in the image at rest, (n, 2) [px]."""
    radius: float
    """[px]"""
    dark: float
    """Share of the light that they take away."""


def draw_markers(place: Image, rng: np.random.Generator) -> Markers:
    """Draw the markers of a gel of which each pixel shows this place, (2, height, width): y and z [m]."""
    _, height, width = place.shape
    pitch = float(abs(place[0, 0, 1] - place[0, 0, 0]))
    spacing = rng.uniform(*_SPACING) / pitch
    columns, rows = (np.arange(rng.uniform(0.2, 0.8) * spacing, count, spacing) for count in (width, height))
    dots = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    dots += rng.normal(0.0, _OFF_GRID * spacing, dots.shape)
    return Markers(dots.astype(np.float32), rng.uniform(*_RADIUS) / pitch, rng.uniform(*_DARK))


def visible_through(
    markers: Markers, shape: tuple[int, ...], pitch: float, height: Image | None, shear: float
) -> Image:
    """Return what the dots leave of the light at each pixel of an image of this shape, (height, width, 1).

    pitch is the width of a pixel [m], height (height, width) how far the skin is pressed in [m], None where it is not,
    and shear how far the object has moved it towards +y [m].
    """
    import cv2

    dots = markers.dots if height is None else markers.dots + _moved(markers.dots, pitch, height, shear)
    dark = np.zeros(shape[:2], np.uint8)
    parts = 2**_SHIFT
    for column, row in np.rint(dots * parts).astype(int).tolist():
        cv2.circle(dark, (column, row), round(markers.radius * parts), 255, cv2.FILLED, cv2.LINE_AA, _SHIFT)
    soft = cv2.GaussianBlur(dark, (0, 0), _BORDER).astype(np.float32)
    return 1.0 - np.float32(markers.dark / 255.0) * soft[..., None]


def _moved(dots: Image, pitch: float, height: Image, shear: float) -> Image:
    """How far dots (n, 2) are from where they are at rest, (n, 2) [px]."""
    import cv2

    smooth = cv2.GaussianBlur(height, (0, 0), _COARSE / pitch)
    slope = [cv2.Sobel(smooth, cv2.CV_32F, *by, ksize=3, scale=0.125 / pitch) for by in ((1, 0), (0, 1))]
    held = smooth / max(float(smooth.max()), 1e-6)
    way = [shear * held - _PRESSED_APART * slope[0], -_PRESSED_APART * slope[1]]
    column, row = np.ascontiguousarray(dots.T)
    return np.stack([cv2.remap(each, column, row, cv2.INTER_LINEAR)[:, 0] / pitch for each in way], axis=-1)
