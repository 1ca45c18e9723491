"""The profile of a new kind of sensor, from its untouched image, its shape in words and a ruler."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import SettingError
from palpate.files import numbers_of

if TYPE_CHECKING:
    import palpate


@dataclass(frozen=True)
class Guess:
    """A new sensor before it is measured."""

    shown: float = 0.017
    """Width of gel [m] that an image is taken to show until a ruler says it."""
    edge: float = 2e-3
    """Radius of the edges [m] of a flat pad, as of a GelSight Mini."""
    unit_sigma: float = 0.02
    """Deviation of the pixel pitch from unit to unit, as a share of it."""


_GUESS = Guess()


def first_guess(name: str, gel: str | None, still: Path, orientation: str) -> "palpate.SensorProfile":
    """Return the profile of a sensor before anything of its images is measured.

    gel is "flat", or the radius of a dome such as "21mm". Raises PalpateError on other words and on a bad image.
    """
    from palpate.types.images import camera_view, read_image
    from palpate.types.sensor import SensorProfile

    radius = numbers_of([gel[:-2]]) if gel is not None and gel.endswith("mm") else None
    if gel != "flat" and not (radius and 1.0 <= radius[0] <= 200.0):
        raise SettingError(f"--gel is {gel!r}; --new-sensor needs flat, or the radius of a dome from 1 to 200 mm: 21mm")
    height, width = camera_view(orientation).of(read_image(still)).shape[:2]
    return SensorProfile(
        name=name,
        radius=1e-3 * radius[0] if radius else _GUESS.edge,
        flat_width=0.0 if radius else _GUESS.shown - 2.0 * _GUESS.edge,
        half_width=0.5 * _GUESS.shown,
        image_height=height,
        image_width=width,
        pixel_pitch=_GUESS.shown / width,
        orientation=orientation,
    )


def with_scale_of(unit: "palpate.Calibration", guess: "palpate.SensorProfile") -> "palpate.SensorProfile":
    """Return a profile with the scale of a unit that a ruler has measured; its pad is as wide as its image."""
    assert unit.pixel_pitch is not None
    half_width = 0.5 * unit.pixel_pitch * guess.image_width
    if guess.flat_width:
        flat_width = 2.0 * max(half_width - guess.radius, 0.1 * half_width)
    else:
        flat_width = 0.0
        half_width = min(half_width, 0.99 * guess.radius)
    sigma = (unit.pixel_pitch_sigma**2 + _GUESS.unit_sigma**2) ** 0.5
    return replace(
        guess, half_width=half_width, flat_width=flat_width, pixel_pitch=unit.pixel_pitch, pixel_pitch_sigma=sigma
    )
