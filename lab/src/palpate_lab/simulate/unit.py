"""One simulated sensor: its gel, camera, lights and markers, all drawn from a seed."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.types.sensor import SensorProfile
from palpate_lab.simulate import backdrop

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Markers:
    """A grid of dark dots on a gel's skin, which move with it."""

    dots: NDArray[np.float32]
    """Columns and rows of their centres in the image at rest, (n, 2) [px]."""
    radius: float
    """Radius of a dot [px]."""
    dark: float
    """Share of the light that a dot absorbs."""


@dataclass(frozen=True, eq=False)
class SensorUnit:
    """The individual properties of one unit of a profile; `draw_unit` makes it."""

    profile: SensorProfile
    """Properties that all units share."""
    radius: float
    """Radius of curvature of the gel across the pad [m]."""
    length_radius: float
    """Radius of curvature of the gel along the pad [m]."""
    pitch: float
    """Width and height of a pixel on the gel [m]."""
    offset: tuple[float, float]
    """The image's middle on the pad, (y, z) in the sensor frame [m]."""
    roll: float
    """Rotation of the image on the pad, about the sensor's x [rad]."""
    flat_width: float
    """Width of the flat part of the gel across the pad [m]; 0 for a round gel."""
    markers: Markers | None
    """Dots on the skin; None without."""
    light: Array
    """Direction towards each light, (lights, 3): to the image's right, up, and into the camera."""
    colour: Array
    """Levels of red, green and blue from each light on gel that faces it, (lights, 3) [grey levels]."""
    shear_compliance: float
    """Shift of the gel's skin under a tangential force [m/N]."""
    response: float
    """Exponent of the camera's response: above 0 it answers more strongly where the image is bright."""
    halo: float
    """Distance over which the gel follows around a contact, relative to the usual."""
    shadow: float
    """Share of a light that an obstacle blocks, 0 to 1."""
    fold: float
    """Strength of dark folds and bright stretched skin, 0 to 1."""
    noise: float
    """Standard deviation of the camera's noise [grey levels]."""
    illumination: Image
    """Strength of each light at each pixel, (lights, height, width)."""
    scattered: float
    """Share of the light on an imprint that is the same at each pixel, 0 to 1."""
    no_contact: NDArray[np.uint8]
    """Image without contact and noise, (height, width, 3), RGB."""

    @cached_property
    def place(self) -> Image:
        """Position of each pixel on the pad, (2, height, width): y and z in the sensor frame [m]."""
        height, width = self.no_contact.shape[:2]
        right = (np.arange(width) - 0.5 * (width - 1)) * self.pitch
        up = (0.5 * (height - 1) - np.arange(height)[:, None]) * self.pitch
        cos = math.cos(self.roll)
        sin = math.sin(self.roll)
        y = self.offset[0] + cos * right - sin * up
        z = self.offset[1] + sin * right + cos * up
        return np.stack([y, z]).astype(np.float32)

    @cached_property
    def softness(self) -> Image:
        """Compliance of the gel at each pixel, (height, width): 1, falling to 0 at the pad's hard rim over 0.8 mm."""
        inside = np.clip((self.half_width - np.abs(self.place[0])) / np.float32(8e-4), 0.0, 1.0)
        return inside * inside * (3.0 - 2.0 * inside)

    def sag(self, y: Any) -> Any:
        """Return the drop of the gel's surface at y on the pad [m]."""
        return _arc(np.maximum(np.abs(y) - 0.5 * self.flat_width, 0.0), self.radius)

    def sag_along(self, z: Any) -> Any:
        """Return the drop of the gel's surface at z on the pad [m]."""
        return _arc(z, self.length_radius)

    def shown_angle(self, pad_angle: Any) -> Any:
        """Return the angle (...) [rad] at which a sensor whose image is as wide as its pad would see one at pad_angle.

        An image does not reveal the unit's own pitch, offset, roll and radius. A flat gel shows its edges, and the two
        angles are the same.
        """
        if self.flat_width:
            return pad_angle
        y = self.radius * np.sin(pad_angle) - self.offset[0]
        z = -self.offset[1]
        pixels = (math.cos(self.roll) * y + math.sin(self.roll) * z) / self.pitch
        place = pixels * 2.0 * self.half_width / self.no_contact.shape[1] / self.profile.radius
        return np.arcsin(np.clip(place, -1.0, 1.0))  # clipped beyond the gel's side

    @property
    def half_width(self) -> float:
        """Half the width of the pad along y [m]."""
        assert self.profile.half_width is not None  # draw_unit takes no other
        return self.profile.half_width


def draw_unit(profile: SensorProfile, seed: int) -> SensorUnit:
    """Draw a unit; the same seed gives the same unit. Raises SettingError for a sensor without images or a pad.

    The gel's radii are those fitted to the published DIGIT mesh: 19.5 to 22 mm across and 87 to 180 mm along for 21 mm.
    A flat gel is flat to a tenth of a millimetre along the pad, and its edges are less or more round.
    """
    height = profile.image_height
    half_width = profile.half_width
    pitch = profile.pixel_pitch
    flat = profile.flat_width
    if not height or pitch is None or half_width is None or not 0.0 < half_width - 0.5 * flat <= profile.radius:
        found = f"sensor {profile.name!r} has {height} rows, radius {profile.radius} m and half_width {half_width}"
        raise SettingError(f"{found}; touch images need rows, and a half_width that radius and flat_width reach")
    rng = np.random.default_rng(seed)
    # In half of the units red, green and blue come from the usual sides; in the others from any, in any order.
    usual = np.deg2rad((90.0, 0.0, 270.0) if flat else (30.0, 150.0, 270.0))
    bearing = usual + rng.normal(0.0, math.radians(12.0), 3)
    if rng.random() > 0.5:
        bearing = rng.permutation(bearing) + rng.uniform(-math.pi, math.pi)
    elevation = rng.uniform(math.radians(12.0), math.radians(40.0), 3)
    level = np.cos(elevation)
    light = np.stack([level * np.cos(bearing), level * np.sin(bearing), np.sin(elevation)], axis=-1)
    # Of each light in each channel.
    crosstalk = rng.uniform(0.0, 1.0, (3, 3)) * np.array([(0.2, 0.3, 0.4), (0.3, 0.2, 0.5), (0.2, 0.4, 0.2)])
    colour = (np.eye(3) + crosstalk) * rng.uniform(130.0, 210.0, (3, 1))
    colour *= np.where(rng.random((3, 1)) < 0.1, rng.uniform(0.2, 0.6, (3, 1)), 1.0)  # every tenth light is weak
    # A light makes the far side of a round gel glow, which is hollow, and the near side of a flat one.
    kind, glow = (backdrop.FLAT, bearing) if flat else (backdrop.ROUND, math.pi - bearing)
    illumination = backdrop.draw_illumination(glow, height, profile.image_width, rng, kind)
    unit = SensorUnit(
        profile=profile,
        radius=profile.radius * (rng.uniform(0.8, 1.3) if flat else rng.uniform(0.93, 1.045)),
        length_radius=rng.uniform(0.3, 2.0) if flat else profile.radius * rng.uniform(4.15, 8.6),
        pitch=pitch / (1.0 + math.sqrt(3.0) * profile.pixel_pitch_sigma * rng.uniform(-1.0, 1.0)),
        offset=tuple(rng.normal(0.0, 3e-4, 2).tolist()),
        roll=float(rng.normal(0.0, math.radians(1.0))),
        flat_width=flat,
        markers=None,
        light=light,
        colour=colour,
        shear_compliance=rng.uniform(1e-4, 4e-4),
        response=rng.uniform(-0.3, 0.3),
        halo=rng.uniform(0.35, 1.1),
        shadow=rng.uniform(0.4, 1.0),
        fold=rng.uniform(0.0, 1.0),
        noise=rng.uniform(0.8, 1.6),
        illumination=illumination,
        scattered=0.6,
        no_contact=backdrop.draw_no_contact(illumination, colour / 200.0, rng, kind),
    )
    shade = 0.7 + 0.3 * np.sqrt(unit.softness)[..., None]  # little light reaches the rim
    markers = draw_markers(unit.place, rng) if flat and rng.random() < 0.5 else None
    no_contact = np.rint(unit.no_contact * shade).astype(np.uint8)
    # On a real DIGIT a ball's flank has four times less of the light that hardly reaches its place.
    unit = replace(unit, no_contact=no_contact, markers=markers, scattered=rng.uniform(0.05, 0.6))
    for array in (unit.light, unit.colour, unit.illumination, unit.no_contact):
        array.flags.writeable = False
    return unit


def draw_markers(place: Image, rng: np.random.Generator) -> Markers:
    """Draw markers 1.2 to 2.4 mm apart, for pixels at these positions on the pad (2, height, width) [m]."""
    _, height, width = place.shape
    pitch = float(abs(place[0, 0, 1] - place[0, 0, 0]))
    spacing = rng.uniform(1.2e-3, 2.4e-3) / pitch
    columns, rows = (np.arange(rng.uniform(0.2, 0.8) * spacing, count, spacing) for count in (width, height))
    dots = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    dots += rng.normal(0.0, 0.05 * spacing, dots.shape)
    return Markers(dots.astype(np.float32), rng.uniform(1.8e-4, 3e-4) / pitch, rng.uniform(0.5, 0.9))


def _arc(away: Any, radius: float) -> Any:
    """Return the drop of an arc at this distance from its apex."""
    return radius - np.sqrt(np.maximum(radius * radius - away * away, 0.0))
