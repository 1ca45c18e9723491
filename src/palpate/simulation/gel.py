"""Touch images: how a gel looks from inside when an object is pressed into it.

The undeformed gel overlaps the object; the overlap is the depth to which the object presses the gel where they touch.
Around it the gel follows, and three coloured lights show the slopes. Only what differs from the gel at rest is added
to the image without contact, as W. Yuan, S. Dong, E. Adelson, "GelSight", 2017 describe the sensor and
Z. Si, W. Yuan, "Taxim", 2022 a simulation by examples; here lights are a model and drawn, so no examples are needed.
"""

import functools
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate.simulation.unit import SensorUnit

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_FILLET = 5e-4  # [m] of the object's upper and lower rim
_SKIRTS = (1.6e-3, 6e-4)  # [m] over which the gel follows around a contact, far to near
_COARSE = 4  # skirts are smooth enough for one of so many pixels
_SKIN = 1.5e-4  # [m] no feature is finer than the gel's coating
_FOLD = 8e-4  # [m] over which a fold at the contact's rim takes light away
_FOLD_LEVELS = 3.5e5  # [grey levels per m of height above the surroundings]
_FOLD_LIMIT = 60.0  # [grey levels] that no fold exceeds
_SAG_STEP = 1e-4  # [m]


def render(
    unit: SensorUnit,
    shape: Shape,
    sensor_in_object: ArrayLike,
    indentation: ArrayLike,
    shear: ArrayLike = 0.0,
    rng: np.random.Generator | None = None,
    span: tuple[float, float] = (-0.01, 0.01),
) -> NDArray[np.uint8]:
    """Return the touch image (height, width, 3) RGB, or (N, height, width, 3) for N poses.

    sensor_in_object is object_T_sensor, (3,) or (N, 3) [m, m, rad]; it says where on the pad the object is. How deep
    it is pressed there is the indentation, () or (N,) [m], at the deepest point of the pad; none at 0 and below. shear
    is the force of the object on the gel along the sensor's y, () or (N,) [N]. The object is a prism from span[0] below
    to span[1] above the sensor's origin [m]. Camera noise is drawn only where there is an rng.
    """
    poses = np.asarray(sensor_in_object, dtype=np.float64)
    depth, force = np.asarray(indentation, dtype=np.float64), np.asarray(shear, dtype=np.float64)
    if poses.ndim == 2:
        many = zip(poses, np.broadcast_to(depth, len(poses)), np.broadcast_to(force, len(poses)), strict=True)
        images = [render(unit, shape, *each, rng=rng, span=span) for each in many]
        return np.stack(images) if images else np.empty((0, *unit.no_contact.shape), np.uint8)
    if not span[0] < 0.0 < span[1]:
        raise SettingError(f"span is {span!r}; it must reach from below to above the sensor's origin [m]")
    if not float(depth) > 0.0:
        return touch_image(unit, None, rng=rng)
    return touch_image(unit, prism_overlap(unit, shape, poses, float(depth), span), float(force), rng)


def prism_overlap(
    unit: SensorUnit, shape: Shape, sensor_in_object: ArrayLike, indentation: float, span: tuple[float, float]
) -> Image:
    """Return how deep each pixel's piece of gel lies in the object, (height, width) [m]; see `render`."""
    import cv2

    object_T_sensor = np.asarray(sensor_in_object)
    section, column, row = _section(unit)
    nearest = _nearest(unit, shape, object_T_sensor)
    distance = shape.signed_distance(se2.transform(object_T_sensor, section))
    depth = (nearest + indentation - distance).astype(np.float32)
    overlap = np.asarray(cv2.remap(depth, column, row, cv2.INTER_LINEAR))
    z = unit.place[1]
    # The depth in a prism with rounded rims: the two depths join in a quarter circle.
    within = np.minimum(z - np.float32(span[0]), np.float32(span[1]) - z)
    fillet = np.float32(_FILLET)
    rounded = fillet - np.hypot(np.maximum(fillet - overlap, 0.0), np.maximum(fillet - within, 0.0))
    return np.maximum(rounded + np.maximum(np.minimum(overlap, within) - fillet, 0.0), 0.0)


def ball_overlap(unit: SensorUnit, radius: float, place: tuple[float, float], indentation: float) -> Image:
    """Return the overlap (height, width) [m] with a ball of a radius [m] pressed in at place (y, z) on the pad [m]."""
    y, z = unit.place
    away = np.hypot(y - place[0], z - place[1])
    inside = np.minimum(away / radius, 1.0)
    bulge = _sag(y, unit.radius) + _sag(z, unit.length_radius)
    bulge -= _sag(np.float32(place[0]), unit.radius) + _sag(np.float32(place[1]), unit.length_radius)
    slope = (place[0] / unit.radius, place[1] / unit.length_radius)  # the ball comes along the gel's normal
    bulge -= slope[0] * (y - place[0]) + slope[1] * (z - place[1])
    overlap = indentation - radius * (1.0 - np.sqrt(1.0 - inside**2)) - bulge
    return np.where(inside < 1.0, np.maximum(overlap, 0.0), 0.0).astype(np.float32)


def touch_image(
    unit: SensorUnit, overlap: Image | None, shear: float = 0.0, rng: np.random.Generator | None = None
) -> NDArray[np.uint8]:
    """Return the image (height, width, 3) of a gel pressed in by overlap (height, width) [m]; None is no contact."""
    import cv2

    image = unit.no_contact
    if overlap is None:
        if rng is None:
            return image.copy()
        return np.asarray(cv2.add(image, _noise(unit, rng), dtype=cv2.CV_8U), np.uint8)
    difference = shading(unit, gel_height(unit, overlap, shear))
    if rng is not None:
        difference = cv2.add(difference, _noise(unit, rng), dtype=cv2.CV_32F)
    return np.asarray(cv2.add(image, difference, dtype=cv2.CV_8U), np.uint8)


def gel_height(unit: SensorUnit, overlap: Image, shear: float = 0.0) -> Image:
    """Return how far the gel's skin is pressed in, (height, width) [m], under an overlap and a shear force [N].

    Where it touches the object it takes its form. Around it the gel follows, less and less; this skirt is shifted by
    the shear force, which raises it before and lowers it behind the object.
    """
    import cv2

    overlap = overlap * unit.softness
    size = (overlap.shape[1], overlap.shape[0])
    contact = cv2.resize(overlap, (size[0] // _COARSE, size[1] // _COARSE), interpolation=cv2.INTER_AREA)
    shift = np.float32(shear * unit.shear_compliance / (_COARSE * unit.pitch))
    skirt = contact
    for width in _SKIRTS:
        # Each mean holds the contact fixed, so the form nears that of a stretched membrane.
        skirt = cv2.GaussianBlur(np.maximum(contact, skirt), (0, 0), width / (_COARSE * unit.pitch))
        skirt = skirt - shift * cv2.Sobel(skirt, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    height = np.maximum(overlap, cv2.resize(skirt, size, interpolation=cv2.INTER_LINEAR))
    return np.asarray(cv2.GaussianBlur(height * unit.softness, (0, 0), _SKIN / unit.pitch), np.float32)


def shading(unit: SensorUnit, height: Image) -> Image:
    """Return what a pressed-in gel adds to the image without contact, (height, width, 3) [grey levels]."""
    import cv2

    rest_right, rest_up, rest_lit, strength = _rest(unit)
    scale = 1.0 / (8.0 * unit.pitch)
    right = rest_right - cv2.Sobel(height, cv2.CV_32F, 1, 0, ksize=3, scale=scale)
    up = rest_up + cv2.Sobel(height, cv2.CV_32F, 0, 1, ksize=3, scale=scale)
    shrink = 1.0 / np.sqrt(right * right + up * up + 1.0)
    lit = np.empty((*height.shape, 3), np.float32)
    for index, (x, y, z) in enumerate(unit.light.astype(np.float32)):
        facing = np.maximum((x * right + y * up + z) * shrink, 0.0)
        lit[..., index] = (facing - rest_lit[index]) * strength[index]
    difference = np.asarray(cv2.transform(lit, unit.colour.T.astype(np.float32)), np.float32)
    fold = np.float32(_FOLD_LEVELS) * (height - cv2.GaussianBlur(height, (0, 0), _FOLD / unit.pitch))
    fold /= 1.0 + np.abs(fold) / np.float32(_FOLD_LIMIT)
    return np.asarray(difference + fold[..., None], np.float32)


def _nearest(unit: SensorUnit, shape: Shape, object_T_sensor: Array) -> float:
    """Return the least signed distance of the pad from the outline in the sensor's plane, to a micrometre [m]."""
    low, high, nearest = -unit.half_width, unit.half_width, math.inf
    for _ in range(2):
        y = np.linspace(low, high, 201)
        points = np.stack([-_sag(y, unit.radius), y], axis=-1)
        distance = shape.signed_distance(se2.transform(object_T_sensor, points))
        best = int(distance.argmin())
        nearest = min(nearest, float(distance[best]))
        low, high = y[max(best - 1, 0)], y[min(best + 1, 200)]
    return nearest


@functools.lru_cache(maxsize=16)
def _section(unit: SensorUnit) -> tuple[Array, Image, Image]:
    """Points of the gel near the sensor's plane, (levels, columns, 2) [m], and where each pixel lies among them.

    Away from the sensor's plane the gel sags, as if it were drawn back from the object: one level for each such sag.
    """
    y, z = unit.place
    sag = _sag(z, unit.length_radius)
    step = 0.5 * unit.pitch
    across = np.arange(float(y.min()), float(y.max()) + 2.0 * step, step)
    levels = np.arange(math.ceil(float(sag.max()) / _SAG_STEP) + 2) * _SAG_STEP
    table = np.stack(np.broadcast_arrays(-_sag(across, unit.radius) - levels[:, None], across), axis=-1)
    return table, (y - np.float32(across[0])) / np.float32(step), sag / np.float32(_SAG_STEP)


@functools.lru_cache(maxsize=16)
def _rest(unit: SensorUnit) -> tuple[Image, Image, Image, Image]:
    """Of the gel at rest: slopes of the normal to the right and up, how it faces each light, the lights' strengths."""
    y, z = unit.place
    right, up = y / np.float32(unit.radius), z / np.float32(unit.length_radius)
    right, up = -right, -up  # seen from inside the gel is hollow
    shrink = 1.0 / np.sqrt(right * right + up * up + 1.0)
    light = unit.light.astype(np.float32)[:, :, None, None]
    lit = np.maximum((light[:, 0] * right + light[:, 1] * up + light[:, 2]) * shrink, 0.0)
    # Light that has been scattered in the gel fills the gaps between cones and streaks.
    strength = np.float32(0.6) + np.float32(0.4) * np.minimum(unit.illumination, np.float32(2.5))
    return right, up, lit, strength


def _sag(away: Any, radius: float) -> Any:
    """How far an arc falls back at this distance from its apex."""
    return radius - np.sqrt(np.maximum(radius * radius - away * away, 0.0))


@functools.cache
def _bell() -> NDArray[np.float32]:
    """Standard normal values for 256 equally likely bytes."""
    from scipy.special import ndtri

    values = ndtri((np.arange(256) + 0.5) / 256.0)
    return (values / values.std()).astype(np.float32)


def _noise(unit: SensorUnit, rng: np.random.Generator) -> Image:
    """Camera noise; looking values up by random bytes is many times faster than drawing normal ones."""
    shape = unit.no_contact.shape
    draws = np.frombuffer(rng.bytes(math.prod(shape)), np.uint8)
    return np.float32(unit.noise) * _bell()[draws].reshape(shape)
