"""Touch images: the inside of a gel pressed against an object.

The undeformed gel overlaps the object; the overlap is the local indentation. The gel follows around the contact, and
three coloured lights show its slopes (`optics`). Only the change against the gel at rest is added to the image without
contact. The sensor is described by W. Yuan, S. Dong, E. Adelson, "GelSight", 2017; Z. Si, W. Yuan, "Taxim", 2022
simulate it from calibration images, here the lights are a drawn model and no images are needed.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.lab.simulate.optics import marker_transmission, shading
from palpate.lab.simulate.unit import SensorUnit

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_FILLET = np.float32(5e-4)  # [m] radius of the object's upper and lower rim
_SKIRTS = (1.6e-3, 6e-4)  # [m] widths over which the gel follows around a contact, wide one first
_SKIN = 1.5e-4  # [m] thickness of the coating; no feature is finer
_COARSE = 4  # [px] the skirts are smooth enough for an image smaller by this factor
_SAG_STEP = 1e-4  # [m] between tabulated sections of the gel


@dataclass(frozen=True)
class Side:
    """The side of an object that meets the pad."""

    below: float = -0.01
    """Lower rim, relative to the sensor's origin [m]."""
    above: float = 0.01
    """Upper rim, relative to the sensor's origin [m]."""
    tilt: float = 0.0
    """Lean away from the sensor, going up [rad]."""


def draw_side(rng: np.random.Generator) -> Side:
    """Draw the side of an object 14 to 30 mm thick, up to 5 mm off the pad's middle, leaning by 1.5 degrees rms."""
    middle, thickness = rng.uniform(-0.005, 0.005), rng.uniform(0.014, 0.03)
    return Side(middle - 0.5 * thickness, middle + 0.5 * thickness, float(rng.normal(0.0, math.radians(1.5))))


def render(
    unit: SensorUnit,
    shape: Shape,
    sensor_in_object: ArrayLike,
    indentation: ArrayLike,
    shear: ArrayLike = 0.0,
    rng: np.random.Generator | None = None,
    side: Side = Side(),
) -> NDArray[np.uint8]:
    """Return the touch image (height, width, 3) RGB of a prism, or (N, height, width, 3) for N poses.

    sensor_in_object is object_T_sensor, (3,) or (N, 3) [m, m, rad]. indentation is that of the deepest point of the
    pad, () or (N,) [m]; there is no contact at 0 and below. shear is the force of the object on the gel along the
    sensor's y, () or (N,) [N]. Camera noise is added if there is an rng.
    """
    poses = np.asarray(sensor_in_object, dtype=np.float64)
    depth, force = np.asarray(indentation, dtype=np.float64), np.asarray(shear, dtype=np.float64)
    if poses.ndim == 2:
        many = zip(poses, np.broadcast_to(depth, len(poses)), np.broadcast_to(force, len(poses)), strict=True)
        images = [render(unit, shape, *each, rng=rng, side=side) for each in many]
        return np.stack(images) if images else np.empty((0, *unit.no_contact.shape), np.uint8)
    if not float(depth) > 0.0:
        return touch_image(unit, None, rng=rng)
    return touch_image(unit, prism_overlap(unit, shape, poses, float(depth), side), float(force), rng)


def prism_overlap(unit: SensorUnit, shape: Shape, sensor_in_object: ArrayLike, indentation: float, side: Side) -> Image:
    """Return the overlap of the undeformed gel with a prism at each pixel, (height, width) [m]; see `render`."""
    import cv2

    object_T_sensor = np.asarray(sensor_in_object)
    section, column, row = _sections(unit, side)
    nearest = _nearest(unit, shape, object_T_sensor)
    distance = shape.signed_distance(se2.transform(object_T_sensor, section))
    depth = (nearest + indentation - distance).astype(np.float32)
    overlap = np.asarray(cv2.remap(depth, column, row, cv2.INTER_LINEAR))
    z = unit.place[1]
    within = np.minimum(z - np.float32(side.below), np.float32(side.above) - z)
    # The depths below the side and below the rim join in a quarter circle.
    rounded = _FILLET - np.hypot(np.maximum(_FILLET - overlap, 0.0), np.maximum(_FILLET - within, 0.0))
    return np.maximum(rounded + np.maximum(np.minimum(overlap, within) - _FILLET, 0.0), 0.0)


def ball_overlap(unit: SensorUnit, radius: float, place: tuple[float, float], indentation: float) -> Image:
    """Return the overlap (height, width) [m] with a ball of a radius [m] pressed in at place (y, z) on the pad [m]."""
    y, z = unit.place
    away = np.hypot(y - place[0], z - place[1])
    inside = np.minimum(away / radius, 1.0)
    bulge = unit.sag(y) + unit.sag_along(z)
    bulge -= unit.sag(np.float32(place[0])) + unit.sag_along(np.float32(place[1]))
    beyond = np.sign(place[0]) * max(abs(place[0]) - 0.5 * unit.flat_width, 0.0)
    slope = (beyond / unit.radius, place[1] / unit.length_radius)  # the ball comes along the gel's normal
    bulge -= slope[0] * (y - place[0]) + slope[1] * (z - place[1])
    overlap = indentation - radius * (1.0 - np.sqrt(1.0 - inside**2)) - bulge
    return np.where(inside < 1.0, np.maximum(overlap, 0.0), 0.0).astype(np.float32)


def touch_image(
    unit: SensorUnit, overlap: Image | None, shear: float = 0.0, rng: np.random.Generator | None = None
) -> NDArray[np.uint8]:
    """Return the image (height, width, 3) of a gel pressed in by overlap (height, width) [m]; None is no contact."""
    import cv2

    image = unit.no_contact if unit.markers is None else unit.no_contact.astype(np.float32)
    height = None if overlap is None else gel_height(unit, overlap, shear)
    difference = np.zeros(image.shape, np.float32) if height is None else shading(unit, height)
    if unit.markers is not None:
        image = (image + difference) * marker_transmission(
            unit.markers, image.shape, unit.pitch, height, shear * unit.shear_compliance
        )
        difference = np.zeros_like(image)
    if rng is not None:
        difference = cv2.add(difference, _noise(unit, rng), dtype=cv2.CV_32F)
    return np.asarray(cv2.add(image, difference, dtype=cv2.CV_8U), np.uint8)


def gel_height(unit: SensorUnit, overlap: Image, shear: float = 0.0) -> Image:
    """Return the indentation of the gel's skin, (height, width) [m], under an overlap and a shear force [N].

    In contact the gel takes the object's form. Around it the gel follows in a skirt, which the shear force shifts:
    raised ahead of the object, lowered behind it.
    """
    import cv2

    overlap = overlap * unit.softness
    size = (overlap.shape[1], overlap.shape[0])
    contact = cv2.resize(overlap, (size[0] // _COARSE, size[1] // _COARSE), interpolation=cv2.INTER_AREA)
    shift = np.float32(shear * unit.shear_compliance / (_COARSE * unit.pitch))
    skirt = contact
    for width in _SKIRTS:
        # Each mean holds the contact fixed, which approximates a stretched membrane.
        skirt = cv2.GaussianBlur(np.maximum(contact, skirt), (0, 0), unit.halo * width / (_COARSE * unit.pitch))
        skirt = skirt - shift * cv2.Sobel(skirt, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    height = np.maximum(overlap, cv2.resize(skirt, size, interpolation=cv2.INTER_LINEAR))
    return np.asarray(cv2.GaussianBlur(height * unit.softness, (0, 0), _SKIN / unit.pitch), np.float32)


def _nearest(unit: SensorUnit, shape: Shape, object_T_sensor: Array) -> float:
    """Return the least signed distance of the pad from the outline in the sensor's plane, to a micrometre [m]."""
    low, high, nearest = -unit.half_width, unit.half_width, math.inf
    for _ in range(2):
        y = np.linspace(low, high, 201)
        points = np.stack([-unit.sag(y), y], axis=-1)
        distance = shape.signed_distance(se2.transform(object_T_sensor, points))
        best = int(distance.argmin())
        nearest = min(nearest, float(distance[best]))
        low, high = y[max(best - 1, 0)], y[min(best + 1, 200)]
    return nearest


@functools.lru_cache(maxsize=16)
def _sections(unit: SensorUnit, side: Side) -> tuple[Array, Image, Image]:
    """Return sections of the gel, (levels, columns, 2) [m], and the column and level at which each pixel reads them.

    Off the sensor's plane the gel sags and a leaning side recedes; both draw the gel back from the object. Each level
    is the section at one such distance, the first at the gel's farthest reach into the side.
    """
    y, z = unit.place
    sag = unit.sag_along(z) + np.float32(math.tan(side.tilt)) * z
    sag = np.maximum(sag - sag[(z > side.below) & (z < side.above)].min(), 0.0)
    step = 0.5 * unit.pitch
    across = np.arange(float(y.min()), float(y.max()) + 2.0 * step, step)
    levels = np.arange(math.ceil(float(sag.max()) / _SAG_STEP) + 2) * _SAG_STEP
    table = np.stack(np.broadcast_arrays(-unit.sag(across) - levels[:, None], across), axis=-1)
    return table, (y - np.float32(across[0])) / np.float32(step), sag / np.float32(_SAG_STEP)


@functools.cache
def _normal_quantiles() -> Image:
    """Return standard normal values for 256 equally likely bytes."""
    from scipy.special import ndtri

    values = ndtri((np.arange(256) + 0.5) / 256.0)
    return (values / values.std()).astype(np.float32)


def _noise(unit: SensorUnit, rng: np.random.Generator) -> Image:
    """Draw camera noise; looking up random bytes is many times faster than drawing normal values."""
    shape = unit.no_contact.shape
    draws = np.frombuffer(rng.bytes(math.prod(shape)), np.uint8)
    return np.float32(unit.noise) * _normal_quantiles()[draws].reshape(shape)
