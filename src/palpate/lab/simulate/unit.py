"""One simulated sensor: its gel, its camera and its lights, all drawn from a seed."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.lab.simulate import backdrop
from palpate.lab.simulate.markers import Markers, draw_markers
from palpate.types.sensor import SensorProfile

Image = NDArray[np.float32]

_RIM = 8e-4  # [m] from the pad's edge to where the gel gives way freely
_BEARINGS = np.deg2rad((30.0, 150.0, 270.0))  # from where red, green and blue light come in the image, usually
_FLAT_BEARINGS = np.deg2rad((90.0, 0.0, 270.0))  # the same of a GelSight Mini
_MARKED = 0.5  # share of flat gels that have markers
_USUAL = 0.5  # share of units in which they do; in the others from anywhere, in any order
_WEAK = 0.1  # share of lights that are weak

_CROSSTALK = np.array([(0.2, 0.3, 0.4), (0.3, 0.2, 0.5), (0.2, 0.4, 0.2)])  # most that each light adds to each channel


@dataclass(frozen=True, eq=False)
class SensorUnit:
    """What makes one unit differ from the next of its profile; `draw_unit` makes it."""

    profile: SensorProfile
    """What all units share."""
    seed: int
    """The seed it was drawn from."""
    radius: float
    """Radius of curvature of the gel across the pad [m]."""
    length_radius: float
    """Radius of curvature of the gel along the pad [m]."""
    pitch: float
    """Width and height on the gel of a pixel [m]."""
    offset: tuple[float, float]
    """Where the image's middle lies on the pad, (y, z) in the sensor frame [m]."""
    roll: float
    """How far the image is turned on the pad, about the sensor's x [rad]."""
    flat_width: float
    """Width of the flat part of the gel across the pad [m]; 0 where it is round."""
    markers: Markers | None
    """Black dots on the skin; None without."""
    light: NDArray[np.float64]
    """Direction towards each light, (3 lights, 3): to the image's right, up, and into the camera."""
    colour: NDArray[np.float64]
    """What each light adds to red, green and blue where the gel faces it, (3 lights, 3) [grey levels]."""
    shear_compliance: float
    """How far a tangential force shifts the gel's skin [m/N]."""
    response: float
    """Exponent by which the camera answers more strongly where the image is bright; 0 is everywhere alike."""
    halo: float
    """Over how much of the usual distance the gel follows around a contact."""
    shadow: float
    """Share of a light that is missing where something stands in its way, 0 to 1."""
    fold: float
    """How much of its light the gel's skin loses where it is folded, and gains where it is stretched, 0 to 1."""
    noise: float
    """Standard deviation of the camera's noise [grey levels]."""
    illumination: Image
    """How strongly each light reaches each pixel, (3, height, width)."""
    no_contact: NDArray[np.uint8]
    """Image without contact and noise, (height, width, 3), RGB."""

    @cached_property
    def place(self) -> Image:
        """Where on the pad each pixel looks, (2, height, width): y and z in the sensor frame [m]."""
        height, width = self.no_contact.shape[:2]
        right = (np.arange(width) - 0.5 * (width - 1)) * self.pitch
        up = (0.5 * (height - 1) - np.arange(height)[:, None]) * self.pitch
        cos, sin = math.cos(self.roll), math.sin(self.roll)
        y = self.offset[0] + cos * right - sin * up
        z = self.offset[1] + sin * right + cos * up
        return np.stack([y, z]).astype(np.float32)

    @cached_property
    def softness(self) -> Image:
        """How far the gel gives way at each pixel, (height, width): 1, falling to 0 at the pad's hard rim."""
        inside = np.clip((self.half_width - np.abs(self.place[0])) / np.float32(_RIM), 0.0, 1.0)
        return inside * inside * (3.0 - 2.0 * inside)

    def sag(self, y: Any) -> Any:
        """How far the gel falls back at y on the pad [m]."""
        return _arc(np.maximum(np.abs(y) - 0.5 * self.flat_width, 0.0), self.radius)

    def sag_along(self, z: Any) -> Any:
        """How far the gel falls back at z on the pad [m]."""
        return _arc(z, self.length_radius)

    @cached_property
    def rest_slope(self) -> Image:
        """Slopes of the gel's normal at rest to the right and up at each pixel, (2, height, width); it is hollow."""
        y, z = self.place
        beyond = np.sign(y) * np.maximum(np.abs(y) - np.float32(0.5 * self.flat_width), 0.0)
        return np.stack([-beyond / np.float32(self.radius), -z / np.float32(self.length_radius)])

    def shown_angle(self, pad_angle: Any) -> Any:
        """Return the angle at which the profile's geometry takes a contact to lie that is at pad_angle (...) [rad].

        That is all that an image tells: how far its pixels lie apart on this unit, where its middle looks and how round
        the gel is show nowhere in it. Of a flat gel, whose edges are what shows, it is the angle itself.
        """
        if self.flat_width:
            return pad_angle
        y, z = self.radius * np.sin(pad_angle) - self.offset[0], -self.offset[1]
        pixels = (math.cos(self.roll) * y + math.sin(self.roll) * z) / self.pitch
        place = pixels * 2.0 * self.half_width / self.no_contact.shape[1] / self.profile.radius
        return np.arcsin(np.clip(place, -1.0, 1.0))  # out of sight, where it lies beyond the gel's side

    @property
    def half_width(self) -> float:
        """Half the width of the pad along y [m]."""
        assert self.profile.half_width is not None  # draw_unit takes no other
        return self.profile.half_width


def draw_unit(profile: SensorProfile, seed: int) -> SensorUnit:
    """Draw a unit; the same seed gives the same unit. Raises SettingError for a sensor without images or a pad.

    The image shows 90 to 102 % of the pad's width. Relative to the profile's radius, the gel's radii are
    those fitted to the published DIGIT mesh: 19.5 to 22 mm across and 87 to 180 mm along for 21 mm. A flat gel is flat
    to a tenth of a millimetre along the pad, and its edges are less or more round; half of them have markers.
    """
    height, width, half_width = profile.image_height, profile.image_width, profile.half_width
    flat = profile.flat_width
    if not height or half_width is None or not 0.0 < half_width - 0.5 * flat <= profile.radius:
        found = f"sensor {profile.name!r} has {height} rows, radius {profile.radius} m and half_width {half_width}"
        raise SettingError(f"{found}; touch images need rows, and a half_width that radius and flat_width reach")
    rng = np.random.default_rng(seed)
    bearing = (_FLAT_BEARINGS if flat else _BEARINGS) + rng.normal(0.0, math.radians(12.0), 3)
    if rng.random() > _USUAL:
        bearing = rng.permutation(bearing) + rng.uniform(-math.pi, math.pi)
    elevation = rng.uniform(math.radians(12.0), math.radians(40.0), 3)
    level = np.cos(elevation)
    light = np.stack([level * np.cos(bearing), level * np.sin(bearing), np.sin(elevation)], axis=-1)
    crosstalk = rng.uniform(0.0, 1.0, (3, 3)) * _CROSSTALK
    colour = (np.eye(3) + crosstalk) * rng.uniform(130.0, 210.0, (3, 1))
    colour *= np.where(rng.random((3, 1)) < _WEAK, rng.uniform(0.2, 0.6, (3, 1)), 1.0)
    # A round gel is hollow across the pad: what a light makes glow is the far side. In a flat one it is the near side.
    kind, glow = (backdrop.FLAT, bearing) if flat else (backdrop.ROUND, math.pi - bearing)
    illumination = backdrop.draw_illumination(glow, height, width, rng, kind)
    unit = SensorUnit(
        profile=profile,
        seed=seed,
        radius=profile.radius * (rng.uniform(0.8, 1.3) if flat else rng.uniform(0.93, 1.045)),
        length_radius=rng.uniform(0.3, 2.0) if flat else profile.radius * rng.uniform(4.15, 8.6),
        pitch=2.0 * half_width / width * rng.uniform(0.9, 1.02),
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
        no_contact=backdrop.draw_no_contact(illumination, colour / 200.0, rng, kind),
    )
    shade = 0.7 + 0.3 * np.sqrt(unit.softness)[..., None]  # little light gets to the rim
    markers = draw_markers(unit.place, rng) if flat and rng.random() < _MARKED else None
    unit = replace(unit, no_contact=np.rint(unit.no_contact * shade).astype(np.uint8), markers=markers)
    for array in (unit.light, unit.colour, unit.illumination, unit.no_contact):
        array.flags.writeable = False
    return unit


def _arc(away: Any, radius: float) -> Any:
    """How far an arc falls back at this distance from its apex."""
    return radius - np.sqrt(np.maximum(radius * radius - away * away, 0.0))
