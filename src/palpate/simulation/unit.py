"""One simulated sensor: its gel, its camera and its lights, all drawn from a seed."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from palpate.errors import SettingError
from palpate.recording.sensor import SensorProfile
from palpate.simulation import backdrop

Image = NDArray[np.float32]

_RIM = 8e-4  # [m] from the pad's edge to where the gel gives way freely
_BEARINGS = np.deg2rad((30.0, 150.0, 270.0))  # from where red, green and blue light come in the image, usually
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

    @property
    def half_width(self) -> float:
        """Half the width of the pad along y [m]."""
        assert self.profile.half_width is not None  # draw_unit takes no other
        return self.profile.half_width


def draw_unit(profile: SensorProfile, seed: int) -> SensorUnit:
    """Draw a unit; the same seed gives the same unit. Raises SettingError for a sensor without images or a pad.

    The image shows 90 to 102 % of the pad's width. Relative to the profile's radius, the gel's radii are
    those fitted to the published DIGIT mesh: 19.5 to 22 mm across and 87 to 180 mm along for 21 mm.
    """
    height, width, half_width = profile.image_height, profile.image_width, profile.half_width
    if not height or half_width is None or not 0.0 < half_width < profile.radius:
        found = f"sensor {profile.name!r} has {height} rows, radius {profile.radius} m and half_width {half_width}"
        raise SettingError(f"{found}; touch images need rows, and a half_width below the radius")
    rng = np.random.default_rng(seed)
    bearing = _BEARINGS + rng.normal(0.0, math.radians(12.0), 3)
    if rng.random() > _USUAL:
        bearing = rng.permutation(bearing) + rng.uniform(-math.pi, math.pi)
    elevation = rng.uniform(math.radians(12.0), math.radians(40.0), 3)
    level = np.cos(elevation)
    light = np.stack([level * np.cos(bearing), level * np.sin(bearing), np.sin(elevation)], axis=-1)
    crosstalk = rng.uniform(0.0, 1.0, (3, 3)) * _CROSSTALK
    colour = (np.eye(3) + crosstalk) * rng.uniform(130.0, 210.0, (3, 1))
    colour *= np.where(rng.random((3, 1)) < _WEAK, rng.uniform(0.2, 0.6, (3, 1)), 1.0)
    # The gel is hollow across the pad: what a light makes glow is the far side.
    illumination = backdrop.draw_illumination(math.pi - bearing, height, width, rng)
    unit = SensorUnit(
        profile=profile,
        seed=seed,
        radius=profile.radius * rng.uniform(0.93, 1.045),
        length_radius=profile.radius * rng.uniform(4.15, 8.6),
        pitch=2.0 * half_width / width * rng.uniform(0.9, 1.02),
        offset=tuple(rng.normal(0.0, 3e-4, 2).tolist()),
        roll=float(rng.normal(0.0, math.radians(1.0))),
        light=light,
        colour=colour,
        shear_compliance=rng.uniform(1e-4, 4e-4),
        response=rng.uniform(-0.3, 0.3),
        halo=rng.uniform(0.35, 1.1),
        shadow=rng.uniform(0.4, 1.0),
        fold=rng.uniform(0.0, 1.0),
        noise=rng.uniform(0.8, 1.6),
        illumination=illumination,
        no_contact=backdrop.draw_no_contact(illumination, colour / 200.0, rng),
    )
    shade = 0.7 + 0.3 * np.sqrt(unit.softness)[..., None]  # little light gets to the rim
    unit = replace(unit, no_contact=np.rint(unit.no_contact * shade).astype(np.uint8))
    for array in (unit.light, unit.colour, unit.illumination, unit.no_contact):
        array.flags.writeable = False
    return unit
