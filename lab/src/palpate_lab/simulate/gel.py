"""Touch images: the inside of a gel pressed against an object.

The undeformed gel overlaps the object; the overlap is the local indentation, around which the gel follows. Three
coloured lights show the slopes, and only the change against the gel at rest is added to the image without contact. Seen
from inside, a round gel at rest is hollow and an imprint is a bump: a light makes the far side of the hollow glow, but
the near flank of the bump, which casts a shadow. The sensor is described by W. Yuan, S. Dong, E. Adelson, "GelSight",
2017, the lights by M. K. Johnson, E. H. Adelson, "Retrographic sensing", 2009.
"""

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import Array
from palpate.compiled import compiled
from palpate.geometry import se2
from palpate.geometry.shapes import Shape
from palpate_lab.simulate.unit import Markers, SensorUnit

Image = NDArray[np.float32]

_COARSE = 4  # [px] skirts and shadows are smooth enough for an image smaller by this factor


@dataclass(frozen=True)
class Side:
    """The side of an object that meets the pad."""

    below: float = -0.01
    """Lower rim, relative to the sensor's origin [m]."""
    above: float = 0.01
    """Upper rim, relative to the sensor's origin [m]."""
    tilt: float = 0.0
    """Lean away from the sensor, going up [rad]."""
    roll: float = 0.0
    """Lean towards the sensor's +y, going up [rad]; the middle stays where it is."""
    bulge: float = 0.0
    """Curvature from rim to rim, out in the middle [1/m]: 0 of a prism, above it of a bottle or a ball."""


def draw_side(rng: np.random.Generator) -> Side:
    """Draw the side of an object 8 to 30 mm thick, up to 5 mm off the pad's middle, leaning by 3 degrees rms both ways.

    Two in five are round from rim to rim, as bottles and balls are, with a radius of 4 to 100 mm.
    """
    middle = rng.uniform(-0.005, 0.005)
    thickness = rng.uniform(0.008, 0.03)
    tilt, roll = rng.normal(0.0, math.radians(3.0), 2).tolist()
    bulge = math.exp(rng.uniform(math.log(10.0), math.log(250.0))) if rng.random() < 0.4 else 0.0
    return Side(middle - 0.5 * thickness, middle + 0.5 * thickness, tilt, roll, bulge)


def render(
    unit: SensorUnit,
    shape: Shape,
    sensor_in_object: ArrayLike,
    indentation: ArrayLike,
    shear: float = 0.0,
    rng: np.random.Generator | None = None,
    side: Side = Side(),
) -> NDArray[np.uint8]:
    """Return the touch image (height, width, 3) RGB of a prism, or (N, height, width, 3) for N poses.

    sensor_in_object is object_T_sensor, (3,) or (N, 3) [m, m, rad]. indentation is that of the deepest point of the
    pad, () or (N,) [m]; there is no contact at 0 and below. shear is the force of the object on the gel along the
    sensor's y [N]. Camera noise is added if there is an rng.
    """
    poses = np.asarray(sensor_in_object, dtype=np.float64)
    depth = np.asarray(indentation, dtype=np.float64)
    if poses.ndim == 2:
        many = zip(poses, np.broadcast_to(depth, len(poses)), strict=True)
        return np.stack([render(unit, shape, *each, shear, rng, side) for each in many])
    if not float(depth) > 0.0:
        return touch_image(unit, None, rng=rng)
    return touch_image(unit, prism_overlap(unit, shape, poses, float(depth), side), float(shear), rng)


def prism_overlap(unit: SensorUnit, shape: Shape, sensor_in_object: ArrayLike, indentation: float, side: Side) -> Image:
    """Return the overlap of the undeformed gel with a prism at each pixel, (height, width) [m]; see `render`."""
    import cv2

    object_T_sensor = np.asarray(sensor_in_object)
    section, column, row, within = _sections(unit, side)
    nearest = _nearest(unit, shape, object_T_sensor)
    distance = shape.signed_distance(se2.transform(object_T_sensor, section))
    depth = (nearest + indentation - distance).astype(np.float32)
    overlap = np.asarray(cv2.remap(depth, column, row, cv2.INTER_LINEAR), np.float32)
    rounded = np.empty_like(overlap)
    _write_rounded(overlap, within, 5e-4, rounded)
    return rounded


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


_MAP = np.zeros((1, 1), np.float32)  # examples of arrays that compiled functions take
_MAPS = np.zeros((1, 1, 1), np.float32)


@compiled(_MAP, _MAP, 0.0, _MAP)
def _write_rounded(overlap: Image, within: Image, radius: float, depth: Image) -> None:
    """Join the depths below the side and below the rim in a quarter circle of this radius [m]."""
    fillet = np.float32(radius)
    zero = np.float32(0.0)
    for row in range(overlap.shape[0]):
        for column in range(overlap.shape[1]):
            below_side = overlap[row, column]
            below_rim = within[row, column]
            x = max(fillet - below_side, zero)
            y = max(fillet - below_rim, zero)
            rounded = fillet - np.float32(math.sqrt(np.float64(x) * x + np.float64(y) * y))
            depth[row, column] = max(rounded + max(min(below_side, below_rim) - fillet, zero), zero)


def touch_image(
    unit: SensorUnit, overlap: Image | None, shear: float = 0.0, rng: np.random.Generator | None = None
) -> NDArray[np.uint8]:
    """Return the image (height, width, 3) of a gel pressed in by overlap (height, width) [m]; None is no contact."""
    import cv2

    image = unit.no_contact if unit.markers is None else unit.no_contact.astype(np.float32)
    height = None if overlap is None else gel_height(unit, overlap, shear)
    difference = None if height is None else shading(unit, height)
    if unit.markers is not None:
        shift = shear * unit.shear_compliance
        bare = image if difference is None else image + difference
        image = bare * _marker_transmission(unit.markers, image.shape, unit.pitch, height, shift)
        difference = None
    if rng is not None:
        # Looking up random bytes is many times faster than drawing normal values.
        draws = np.frombuffer(rng.bytes(math.prod(image.shape)), np.uint8).reshape(image.shape)
        noise = cv2.LUT(draws, np.float32(unit.noise) * _normal_quantiles())
        difference = noise if difference is None else cv2.add(difference, noise, dst=noise)
    change = np.zeros_like(image) if difference is None else difference
    return np.asarray(cv2.add(image, change, dtype=cv2.CV_8U), np.uint8)


def gel_height(unit: SensorUnit, overlap: Image, shear: float = 0.0) -> Image:
    """Return the indentation of the gel's skin, (height, width) [m], under an overlap and a shear force [N].

    In contact the gel takes the object's form. Around it the gel follows in a skirt, which the shear force shifts:
    raised ahead of the object, lowered behind it.
    """
    import cv2

    overlap = overlap * unit.softness
    contact, size = _smaller(overlap)
    shift = np.float32(shear * unit.shear_compliance / (_COARSE * unit.pitch))
    skirt = contact
    for width in (1.6e-3, 6e-4):  # [m] over which the gel follows, wide one first
        # Each mean holds the contact fixed, which approximates a stretched membrane.
        skirt = cv2.GaussianBlur(np.maximum(contact, skirt), (0, 0), unit.halo * width / (_COARSE * unit.pitch))
        skirt = skirt - shift * cv2.Sobel(skirt, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    height = np.maximum(overlap, cv2.resize(skirt, size, interpolation=cv2.INTER_LINEAR))
    skin = 1.5e-4  # [m] thickness of the coating; no feature is finer
    return np.asarray(cv2.GaussianBlur(height * unit.softness, (0, 0), skin / unit.pitch), np.float32)


def shading(unit: SensorUnit, height: Image) -> Image:
    """Return the change of the image (height, width, 3) [grey levels] of a gel pressed in by height [m]."""
    import cv2

    scale = 1.0 / (8.0 * unit.pitch)
    right = np.asarray(cv2.Sobel(height, cv2.CV_32F, 1, 0, ksize=3, scale=scale), np.float32)
    up = np.asarray(cv2.Sobel(height, cv2.CV_32F, 0, 1, ksize=3, scale=scale), np.float32)
    light = unit.light.astype(np.float32)
    shadow = _shadows(unit, height)
    surroundings = np.asarray(cv2.GaussianBlur(height, (0, 0), 8e-4 / unit.pitch), np.float32)
    lit = np.empty_like(shadow)
    at_rest = _rest(unit)
    _write_lit(right, up, at_rest, light, shadow, lit)
    difference = np.asarray(cv2.transform(cv2.merge(list(lit)), unit.colour.T.astype(np.float32)), np.float32)
    _add_fold(difference, at_rest.response, height, surroundings, unit.fold * 3.5e5)
    return difference


class _AtRest(NamedTuple):
    """What a unit's gel and camera are without contact."""

    right: Image
    """Slope of the gel to the right, (height, width)."""
    up: Image
    """Slope of the gel upwards, (height, width)."""
    lit: Image
    """Share of each light that the gel takes by its slope, (lights, height, width)."""
    strength: Image
    """Strength of each light, (lights, height, width)."""
    response: Image
    """Grey levels of the camera per grey level of light, (height, width, 3); it is 1 at a level of 100."""


@compiled(_MAP, _MAP, _AtRest(_MAP, _MAP, _MAPS, _MAPS, _MAPS), _MAP, _MAPS, _MAPS)
def _write_lit(right: Image, up: Image, at_rest: _AtRest, light: Image, shadow: Image, lit: Image) -> None:
    """Write the change of each light on the gel, (lights, height, width), by its slopes to the right and down."""
    one = np.float32(1.0)
    for k in range(len(light)):  # not inside the columns, of which an instruction takes several
        for row in range(right.shape[0]):
            for column in range(right.shape[1]):
                normal_right = at_rest.right[row, column] - right[row, column]
                normal_up = at_rest.up[row, column] + up[row, column]
                shrink = one / np.sqrt(normal_right * normal_right + normal_up * normal_up + one)
                facing = (light[k, 0] * normal_right + light[k, 1] * normal_up + light[k, 2]) * shrink
                facing = max(facing, np.float32(0.0)) * (one - shadow[k, row, column])
                lit[k, row, column] = (facing - at_rest.lit[k, row, column]) * at_rest.strength[k, row, column]


@compiled(_MAPS, _MAPS, _MAP, _MAP, 0.0)
def _add_fold(difference: Image, response: Image, height: Image, surroundings: Image, slope: float) -> None:
    """Apply the camera's response, and a fold at the contact's rim: up to 60 grey levels darker, over 0.8 mm."""
    strength = np.float32(slope)
    one = np.float32(1.0)
    most = np.float32(60.0)
    for row in range(height.shape[0]):
        for column in range(height.shape[1]):
            fold = strength * (height[row, column] - surroundings[row, column])
            fold /= one + abs(fold) / most
            for k in range(3):
                difference[row, column, k] = difference[row, column, k] * response[row, column, k] + fold


def _shadows(unit: SensorUnit, height: Image) -> Image:
    """Return the share of each light that is blocked, (lights, height, width), 0 to unit.shadow."""
    import cv2

    coarse, size = _smaller(height)
    pitch = _COARSE * unit.pitch
    reach = np.linspace(4e-4, 4e-3, 8)  # [m] from a point towards a light
    away = reach[:, None] * (unit.light / np.hypot(unit.light[:, 0], unit.light[:, 1])[:, None])[:, None]
    margin = math.ceil(reach[-1] / pitch) + 1
    padded = np.pad(coarse, margin)
    shadow = np.zeros((len(unit.light), *coarse.shape), np.float32)
    _write_shadows(padded, margin, away * (1.0 / pitch, -1.0 / pitch, 1.0), unit.shadow, shadow)
    whole = np.empty((len(shadow), *height.shape), np.float32)
    for k in range(len(shadow)):
        cv2.resize(shadow[k], size, whole[k], interpolation=cv2.INTER_LINEAR)
    return whole


@compiled(_MAP, 0, np.zeros((1, 1, 1)), 0.0, _MAPS)
def _write_shadows(height: Image, margin: int, away: Array, most: float, shadow: Image) -> None:
    """Raise each light's shadow, (lights, rows, columns), to the share `most` where gel towards the light is higher.

    height has a margin all round [m]; away (lights, places, 3) are the columns and rows from a point to the places
    where it is looked at, and how much higher the way to the light is there [m].
    """
    one = np.float32(1.0)
    for k in range(len(away)):
        above = shadow[k]
        for place in range(away.shape[1]):
            first_column = math.floor(away[k, place, 0])
            first_row = math.floor(away[k, place, 1])
            right = np.float32(away[k, place, 0] - first_column)
            down = np.float32(away[k, place, 1] - first_row)
            rise = np.float32(away[k, place, 2])
            for row in range(above.shape[0]):
                there = margin + first_row + row
                for column in range(above.shape[1]):
                    left = margin + first_column + column
                    upper = (one - right) * height[there, left] + right * height[there, left + 1]
                    lower = (one - right) * height[there + 1, left] + right * height[there + 1, left + 1]
                    seen = (one - down) * upper + down * lower - height[margin + row, margin + column] - rise
                    above[row, column] = max(above[row, column], seen)
        for row in range(above.shape[0]):
            for column in range(above.shape[1]):  # a shadow sets in over 0.15 mm of height
                above[row, column] = np.float32(most) * above[row, column] / (above[row, column] + np.float32(1.5e-4))


def _smaller(image: Image) -> tuple[Image, tuple[int, int]]:
    """Return an image smaller by `_COARSE`, and its own size as OpenCV has it, columns first."""
    import cv2

    size = (image.shape[1], image.shape[0])
    small = cv2.resize(image, (size[0] // _COARSE, size[1] // _COARSE), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32), size


@functools.lru_cache(maxsize=16)
def _rest(unit: SensorUnit) -> _AtRest:
    """Return what a unit's gel and camera are without contact."""
    import cv2

    y, z = unit.place
    beyond = np.sign(y) * np.maximum(np.abs(y) - np.float32(0.5 * unit.flat_width), 0.0)
    right = -beyond / np.float32(unit.radius)
    up = -z / np.float32(unit.length_radius)
    shrink = 1.0 / np.sqrt(right * right + up * up + 1.0)
    light = unit.light.astype(np.float32)[:, :, None, None]
    lit = np.maximum((light[:, 0] * right + light[:, 1] * up + light[:, 2]) * shrink, 0.0)
    # Light scattered in the gel fills the gaps between cones and streaks.
    even = np.float32(unit.scattered)
    strength = np.asarray(even + (1.0 - even) * np.minimum(unit.illumination, 2.5), np.float32)
    by_level = ((np.maximum(np.arange(256), 20) / 100.0) ** unit.response).astype(np.float32)
    response = np.asarray(cv2.LUT(unit.no_contact, by_level), np.float32)
    return _AtRest(right, up, lit, strength, response)


def _marker_transmission(
    markers: Markers, shape: tuple[int, ...], pitch: float, height: Image | None, shift: float
) -> Image:
    """Return the share of light that the markers let pass at each pixel, (height, width, 1).

    pitch is the width of a pixel [m], height (height, width) the indentation of the skin [m], None for no contact, and
    shift the motion of the skin in contact towards +y [m].
    """
    import cv2

    dots = markers.dots if height is None else _moved_dots(markers.dots, pitch, height, shift)
    dark = np.zeros(shape[:2], np.uint8)
    bits = 4  # of a position below a pixel, as OpenCV draws it
    for column, row in np.rint(dots * 2**bits).astype(int).tolist():
        cv2.circle(dark, (column, row), round(markers.radius * 2**bits), 255, cv2.FILLED, cv2.LINE_AA, bits)
    soft = cv2.GaussianBlur(dark, (0, 0), 0.6).astype(np.float32)  # [px] soft border of a marker
    return 1.0 - np.float32(markers.dark / 255.0) * soft[..., None]


def _moved_dots(dots: Image, pitch: float, height: Image, shift: float) -> Image:
    """Return the markers' places (M, 2), column and row, on a skin pressed in by height [m] and shifted [m] to +y."""
    import cv2

    smooth = np.asarray(cv2.GaussianBlur(height, (0, 0), 4e-4 / pitch), np.float32)  # [m] the skin moves as one
    slope_right = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=0.125 / pitch), np.float32)
    slope_down = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=0.125 / pitch), np.float32)
    held = smooth / max(float(smooth.max()), 1e-6)
    outwards = 4e-4  # [m] by which a slope of 1 moves a marker
    column, row = np.ascontiguousarray(dots.T)
    right = cv2.remap(shift * held - outwards * slope_right, column, row, cv2.INTER_LINEAR)[:, 0]
    down = cv2.remap(-outwards * slope_down, column, row, cv2.INTER_LINEAR)[:, 0]
    return dots + np.asarray(np.stack([right, down], axis=-1) / pitch, np.float32)


def _nearest(unit: SensorUnit, shape: Shape, object_T_sensor: Array) -> float:
    """Return the least signed distance of the pad from the outline in the sensor's plane, to a micrometre [m]."""
    low = -unit.half_width
    high = unit.half_width
    nearest = math.inf
    for _ in range(2):
        y = np.linspace(low, high, 201)
        points = np.stack([-unit.sag(y), y], axis=-1)
        distance = shape.signed_distance(se2.transform(object_T_sensor, points))
        best = int(distance.argmin())
        nearest = min(nearest, float(distance[best]))
        low = y[max(best - 1, 0)]
        high = y[min(best + 1, 200)]
    return nearest


@functools.lru_cache(maxsize=16)
def _sections(unit: SensorUnit, side: Side) -> tuple[Array, Image, Image, Image]:
    """Return sections of the gel, (levels, columns, 2) [m], at which column and level each pixel reads them, and its
    distance from the nearer rim of the side [m].

    Off the sensor's plane the gel sags, a leaning side recedes, and so does a round one; all draw the gel back from the
    object. Each level is the section at one such distance, the first at the gel's farthest reach into the side.
    """
    y, z = unit.place
    off = z - np.float32(0.5 * (side.below + side.above))
    beside = y - np.float32(math.tan(side.roll)) * off  # the place along a leaning side that a pixel shows
    back = unit.sag_along(z) + np.float32(math.tan(side.tilt)) * z + np.float32(0.5 * side.bulge) * off * off
    back = back - back[(z > side.below) & (z < side.above)].min() + unit.sag(y) - unit.sag(beside)
    column_step = 0.5 * unit.pitch  # [m]
    level_step = 1e-4  # [m]
    untouched = 2.5e-3  # [m] no object reaches so deep
    back = np.minimum(back, np.float32(untouched))
    across = np.arange(float(beside.min()), float(beside.max()) + 2.0 * column_step, column_step)
    first = math.floor(float(back.min()) / level_step)
    levels = np.arange(first, math.ceil(float(back.max()) / level_step) + 2) * level_step
    table = np.stack(np.broadcast_arrays(-unit.sag(across) - levels[:, None], across), axis=-1)
    within = np.minimum(z - np.float32(side.below), np.float32(side.above) - z)
    column = (beside - np.float32(across[0])) / np.float32(column_step)
    level = back / np.float32(level_step) - first
    return table, column, level, within


@functools.cache
def _normal_quantiles() -> Image:
    """Return standard normal values for 256 equally likely bytes."""
    from scipy.special import ndtri

    values = ndtri((np.arange(256) + 0.5) / 256.0)
    return (values / values.std()).astype(np.float32)
