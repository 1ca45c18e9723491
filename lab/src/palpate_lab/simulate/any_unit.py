"""Units that differ from the usual ones of a profile in all that a touch model may have to bear.

Other lights, one of them dead, another pitch and radius, dots, dirt, and a camera that blurs, balances white otherwise
and lies turned or mirrored. `draw_unit` draws the usual ones, which models are trained on.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Image
from palpate.types.images import AS_IT_IS, CameraView
from palpate.types.sensor import SensorProfile
from palpate_lab.simulate import backdrop
from palpate_lab.simulate.unit import SensorUnit, draw_markers, draw_unit


@dataclass(frozen=True)
class Faults:
    """Properties of one unit beyond the usual."""

    lights: int = 3
    """Number of lights, 2 to 4; with 3 they are the usual ones."""
    is_any_light: bool = False
    """True if lights have any colours and places."""
    has_dead_light: bool = False
    """True if one light is dead."""
    pitch: float | None = None
    """Pixel pitch, as a share of the profile's; None for that of the usual unit."""
    radius: float = 1.0
    """Radius of the gel, as a share of the unit's."""
    has_dots: bool = False
    """True if dots are on the gel."""
    grains: int = 0
    """Grains of dirt on the gel."""
    blur: float = 0.0
    """Standard deviation of the camera's blur [px]."""
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Factors of the camera on red, green and blue."""
    view: CameraView = AS_IT_IS
    """Steps that turn the camera's images into those of the profile."""


def draw_faults(rng: np.random.Generator) -> Faults:
    """Draw the properties of a unit: each fault is on a fourth to a half of all units."""

    def has(share: float) -> bool:
        return bool(rng.random() < share)

    return Faults(
        lights=int(rng.integers(2, 5)),
        is_any_light=has(0.5),
        has_dead_light=has(0.25),
        pitch=math.exp(rng.uniform(-0.35, 0.35)) if has(0.5) else None,
        radius=rng.uniform(0.85, 1.15),
        has_dots=has(0.5),
        grains=int(rng.poisson(4.0)) if has(0.5) else 0,
        blur=rng.uniform(0.5, 2.0) if has(0.5) else 0.0,
        white_balance=tuple(rng.uniform(0.7, 1.4, 3).tolist()) if has(0.5) else (1.0, 1.0, 1.0),
        view=CameraView(int(rng.choice([0, 2])), has(0.5)) if has(0.5) else AS_IT_IS,
    )


def with_faults(profile: SensorProfile, seed: int, faults: Faults) -> SensorUnit:
    """Return the usual unit of a seed with other lights, pitch, radius, dots and dirt; `through_camera` does the rest.

    Raises SettingError for a sensor without images or a pad.
    """
    rng = np.random.default_rng([seed, 64])
    unit = draw_unit(profile, seed)
    assert profile.pixel_pitch is not None  # draw_unit takes no other
    pitch = faults.pitch * profile.pixel_pitch if faults.pitch else unit.pitch
    unit = replace(unit, pitch=pitch, radius=faults.radius * unit.radius, markers=None)
    if faults.is_any_light or faults.lights != 3:
        unit = _in_other_lights(unit, faults, rng)
    if faults.has_dead_light:
        unit = _without_light(unit, int(rng.integers(len(unit.light))))
    image = unit.no_contact.astype(np.float32)
    size = image.shape[:2]
    for _ in range(faults.grains):
        row, column, radius = rng.uniform((0, 0, backdrop.GRAIN_RADIUS[0]), (*size, backdrop.GRAIN_RADIUS[1]))
        image += backdrop.grain(size, (row, column), radius)[..., None] * rng.uniform(*backdrop.GRAIN_LEVELS, 3)
    no_contact = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    markers = draw_markers(unit.place, rng) if faults.has_dots else None
    return replace(unit, no_contact=no_contact, markers=markers)


def through_camera(faults: Faults) -> Callable[[Image], Image]:
    """Return the function that makes of a unit's image (height, width, 3) the one that its camera delivers."""
    import cv2

    view = faults.view
    gain = np.array(faults.white_balance, np.float32)

    def delivered(image: Image) -> Image:
        seen = cv2.GaussianBlur(image, (0, 0), faults.blur) if faults.blur else image
        balanced = np.clip(np.rint(seen * gain), 0, 255).astype(np.uint8)
        mirrored = balanced[:, ::-1] if view.mirrored else balanced
        return np.ascontiguousarray(np.rot90(mirrored, -view.quarter_turns))

    return delivered


def _in_other_lights(unit: SensorUnit, faults: Faults, rng: np.random.Generator) -> SensorUnit:
    """Return a unit with another number of lights, or with lights of any colours at any places."""
    count = faults.lights
    height, width = unit.no_contact.shape[:2]
    bearing = 2.0 * math.pi * (np.arange(count) + rng.uniform(-0.25, 0.25, count)) / count + rng.uniform(0.0, 7.0)
    elevation = rng.uniform(math.radians(12.0), math.radians(40.0), count)
    level = np.cos(elevation)
    light = np.stack([level * np.cos(bearing), level * np.sin(bearing), np.sin(elevation)], axis=-1)
    if faults.is_any_light:
        colour = rng.uniform(10.0, 200.0, (count, 3))
    else:
        colour = np.eye(3)[rng.permutation(4) % 3][:count] * 150.0 + rng.uniform(0.0, 50.0, (count, 3))
    glow = bearing if unit.flat_width else math.pi - bearing
    kind = backdrop.FLAT if unit.flat_width else backdrop.ROUND
    sides = np.resize(glow, 6)
    drawn = [backdrop.draw_illumination(three, height, width, rng, kind) for three in (sides[:3], sides[3:])]
    illumination = np.concatenate(drawn)
    shade = 0.7 + 0.3 * np.sqrt(unit.softness)[..., None]
    of_three = np.concatenate([colour, np.zeros((1, 3))])[:3]  # the fourth light hardly shows on gel at rest
    untouched = backdrop.draw_no_contact(illumination[:3], of_three / 200.0, rng, kind)
    return replace(
        unit,
        light=light,
        colour=colour,
        illumination=illumination[:count],
        no_contact=np.rint(untouched * shade).astype(np.uint8),
    )


def _without_light(unit: SensorUnit, dead: int) -> SensorUnit:
    """Return a unit with one dead light; what it lit becomes darker, but for stray light."""
    colour = unit.colour.copy()
    colour[dead] = 0.0
    lit = np.maximum(np.tensordot(unit.illumination, unit.colour, axes=(0, 0)), 1e-6)
    left = np.tensordot(unit.illumination, colour, axes=(0, 0)) / lit
    image = unit.no_contact * (0.15 + 0.85 * left)
    return replace(unit, colour=colour, no_contact=np.clip(np.rint(image), 0, 255).astype(np.uint8))
