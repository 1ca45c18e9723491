"""The image without contact: three coloured lights on a gel, drawn for each unit, and marks on its skin.

Modelled on seventeen real DIGITs: soft or sharp cones of red, green and blue, a dim band at the top, vignette, tint and
specks. A flat gel is lit evenly from its sides, as a real GelSight Mini and a real GelSlim are.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array

Image = NDArray[np.float32]
Colours = tuple[float, float, float]

GRAIN_RADIUS = (1.2, 3.0)
"""Least and largest radius of a grain of dust or a dent [px], as on seventeen real DIGITs."""
GRAIN_LEVELS = (-25.0, 60.0)
"""Least and largest change of each colour by a grain [grey levels]."""


@dataclass(frozen=True)
class Backdrop:
    """Common properties of the untouched gels of one kind of sensor."""

    mean: tuple[Colours, Colours]
    """Least and largest mean of red, green and blue over the image [grey levels]."""
    spread: tuple[Colours, Colours]
    """Least and largest standard deviation over the image [grey levels]."""
    sharpest: float
    """Largest sharpness of the borders and streaks of a light, 0 to 1."""
    has_band: bool
    """True if a band at the top gets little light."""


ROUND = Backdrop(
    ((93.0, 97.0, 89.0), (101.0, 107.0, 99.0)), ((26.0, 15.0, 15.0), (58.0, 30.0, 30.0)), sharpest=1.0, has_band=True
)
FLAT = Backdrop(
    ((70.0, 75.0, 70.0), (125.0, 125.0, 125.0)), ((10.0, 8.0, 10.0), (38.0, 28.0, 38.0)), sharpest=0.1, has_band=False
)


def draw_illumination(glow: Array, height: int, width: int, rng: np.random.Generator, kind: Backdrop = ROUND) -> Image:
    """Draw the strength of each of three lights at each pixel, (3, height, width), about 1 in the mean.

    glow (3,) [rad] are the sides of the image that they make glow, counter-clockwise from its right.
    """
    right, up = _grid(height, width)
    horizon = up[0, 0] * rng.uniform(0.55, 0.95)
    band = _step((horizon - up + rng.uniform(-0.25, 0.25) * right) / rng.uniform(0.06, 0.3))
    dim = band if kind.has_band else np.ones_like(band)
    sharpness = rng.uniform(0.0, 1.0) * kind.sharpest
    lights = [_cone(bearing, right, up, sharpness, rng) for bearing in glow]
    dimmed = [light * (0.25 + 0.75 * dim) for light in lights[:2]]
    return np.stack([light / light.mean() for light in (*dimmed, lights[2])]).astype(np.float32)


def draw_no_contact(
    illumination: Image, colours: Array, rng: np.random.Generator, kind: Backdrop = ROUND
) -> NDArray[np.uint8]:
    """Draw the image (height, width, 3) of the gel at rest in lights of these colours (3 lights, 3 channels)."""
    _, height, width = illumination.shape
    right, up = _grid(height, width)
    strengths = rng.uniform((0.8, 0.7, 0.1), (1.3, 1.2, 0.45))
    image = np.tensordot(illumination, strengths[:, None] * colours, axes=(0, 0))
    tint = rng.uniform(0.0, 0.25, (3, 3)) * ((1.0, 1.0, 1.3), (-0.5, -0.1, 1.6), (1.0, 1.0, 1.0))
    image += tint[0] + tint[1] * up[..., None] / up[0, 0] + (tint[2] - 0.12) * right[..., None]
    image += rng.uniform(0.03, 0.12) * np.stack([_cloud((height, width), 5, rng) for _ in range(3)], axis=-1)
    image *= (1.0 - rng.uniform(0.05, 0.25) * (right**2 + up**2) / (1.0 + up[0, 0] ** 2))[..., None]
    mean = rng.uniform(*kind.mean)
    spread = rng.uniform(*kind.spread)
    image = mean + spread * (image - image.mean(axis=(0, 1))) / image.std(axis=(0, 1))
    image = np.maximum(image, 28.0 + 0.15 * image)  # stray light: nothing is black
    least, most = GRAIN_RADIUS
    for _ in range(rng.poisson(1.5)):  # dots of dust and dents, bright or dark
        row, column, radius = rng.uniform((0, 0, least), (height, width, most))
        image += grain((height, width), (row, column), radius)[..., None] * rng.uniform(*GRAIN_LEVELS, 3)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _grid(height: int, width: int) -> tuple[Image, Image]:
    """Return coordinates to the right and up from the image's middle, in half widths."""
    right = np.linspace(-1.0, 1.0, width, dtype=np.float32)
    up = np.linspace(1.0, -1.0, height, dtype=np.float32) * np.float32(height / width)
    return np.broadcast_to(right, (height, width)), np.broadcast_to(up[:, None], (height, width))


def _cone(bearing: float, right: Image, up: Image, sharpness: float, rng: np.random.Generator) -> Image:
    """Draw one light: a soft glow on its side and a cone with a curved border, both streaked away from the light."""
    side = np.array([np.cos(bearing), np.sin(bearing)]) * (1.0, up[0, 0])
    distance = np.hypot(right - 1.2 * side[0], up - 1.2 * side[1])
    glow = np.exp(-((distance / rng.uniform(0.9, 1.5)) ** 2))
    centre = side * (0.95, 0.3) + rng.uniform(-0.2, 0.2, 2)
    axes = rng.uniform((0.75, 0.85), (1.2, 1.5))
    turn = rng.uniform(-0.6, 0.6)
    along = np.cos(turn) * (right - centre[0]) + np.sin(turn) * (up - centre[1])
    across = np.cos(turn) * (up - centre[1]) - np.sin(turn) * (right - centre[0])
    border = 1.0 - np.hypot(along / axes[0], across / axes[1])
    border += rng.uniform(0.0, 0.12) * sharpness * _cloud(right.shape, 4, rng)
    cone = _step(border / (0.04 + 0.4 * (1.0 - sharpness) * rng.uniform(0.3, 1.0)))
    source = side * rng.uniform(1.5, 2.6) + rng.uniform(-0.4, 0.4, 2)
    fan = np.arctan2(up - source[1], right - source[0]) - np.arctan2(-source[1], -source[0])
    fine = np.convolve(rng.normal(size=721 + 12), np.hanning(13) / 2.1, mode="valid")
    coarse = np.convolve(rng.normal(size=721 + 34), np.hanning(35) / 3.6, mode="valid")
    stripes = np.interp(np.mod(fan + np.pi, 2.0 * np.pi), np.linspace(0.0, 2.0 * np.pi, 721), 0.4 * fine + 0.7 * coarse)
    streaks = stripes.astype(np.float32) * _step(2.5 * _cloud(right.shape, 4, rng) - 0.5)
    amount = rng.uniform(0.1, 0.9) * sharpness
    share = rng.uniform(0.3, 1.2) * (abs(side[0]) + 0.2)  # the light from below stands too far back for a cone
    return (0.6 * glow + share * cone * (0.3 + glow)) * np.maximum(1.0 + amount * streaks, 0.3)


def _cloud(size: tuple[int, ...], cells: int, rng: np.random.Generator) -> Image:
    """Draw smooth random values, about 1 in height, with about this many cells across."""
    import cv2

    height, width = size
    coarse = rng.normal(size=(round(cells * height / width) + 1, cells + 1)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)


def _step(values: Any) -> Any:
    """Return a smooth step from 0 to 1 around values of 0."""
    return 0.5 + 0.5 * np.tanh(values)


def grain(size: tuple[int, int], at: tuple[float, float], radius: float) -> Array:
    """Return the form of a grain, 0 to 1, in an image of this size (rows, columns), at this row and column."""
    rows, columns = np.ogrid[: size[0], : size[1]]
    return np.exp(-0.5 * ((rows - at[0]) ** 2 + (columns - at[1]) ** 2) / radius**2)
