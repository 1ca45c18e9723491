"""A touch sensor: the geometry of its contact surface, its images and its rate.

The sensor frame has its origin at the apex of the undeformed gel (for several tips, at the midpoint of their apexes), x
out of the gel along the push, y along the pad's width and z up. Image columns run along y.
"""

import math
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import Any

import numpy as np

from palpate.arrays import Array
from palpate.checks import FARTHEST, checked_number
from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Shape

TOUCH_WORDS = ("tactile", "touch", "digit", "gel")
"""Words by which streams of a touch sensor are known in names of topics, frames and features."""


def is_named_touch(name: str) -> bool:
    """Return true if a name says that it is of a touch sensor."""
    return any(word in name.lower() for word in TOUCH_WORDS)


@dataclass(frozen=True)
class SensorProfile:
    """Properties of a sensor that the estimator uses; raises SettingError on a value that is not allowed."""

    name: str
    """Name for people and files."""
    radius: float
    """Radius of curvature of the contact surface across the pad [m], of a flat pad that of its edges; 0 is a point."""
    tips: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    """Apex (x, y) of each tip in the sensor frame [m]; a two-finger pusher has two."""
    half_width: float | None = None
    """Half the width of the pad along y [m]; None for a pad without an edge."""
    image_height: int = 0
    """Rows of an image [px]; 0 for a sensor without images."""
    image_width: int = 0
    """Columns of an image [px]; 0 for a sensor without images."""
    rate: float = 30.0
    """Frames per second [Hz]."""
    flat_width: float = 0.0
    """Width along y of the flat part of each tip, between its round edges [m]; 0 for a round tip."""
    pixel_pitch: float | None = None
    """Width and height of a pixel on the gel [m]; by default the image is as wide as the pad."""
    pixel_pitch_sigma: float = 0.0
    """Standard deviation of the pixel pitch from unit to unit, as a share of it."""
    orientation: str = ""
    """Steps that make images of its camera upright, as in `90,mirrored`; those of recordings are upright already."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise SettingError(f"sensor name is {self.name!r}; it must be a string that is not empty")
        allowed = {
            "radius": (0.0, FARTHEST, "a length [m], 0 or more"),
            "flat_width": (0.0, FARTHEST, "a length [m], 0 or more"),
            "rate": (math.ulp(0.0), 1e6, "a rate [Hz] above 0"),
            "half_width": (math.ulp(0.0), FARTHEST, "a length [m] above 0, or None"),
            "image_height": (0, 65_535, "a whole number [px], 0 or more"),
            "image_width": (0, 65_535, "a whole number [px], 0 or more"),
            "pixel_pitch": (1e-6, 1e-2, "the width of a pixel on the gel [m], 1e-6 to 1e-2, or None"),
            "pixel_pitch_sigma": (0.0, 0.5, "a share of the pixel pitch, 0 to 0.5"),
        }
        for name, (least, most, wanted) in allowed.items():
            given = getattr(self, name)
            value = checked_number(given, least, most, Integral if name.startswith("image") else Real)
            if value is None and (given is not None or name not in ("half_width", "pixel_pitch")):
                raise SettingError(f"sensor {self.name!r} has {name} {reprlib.repr(given)}; it must be {wanted}")
            object.__setattr__(self, name, value)
        if not isinstance(self.orientation, str):
            raise SettingError(f"sensor {self.name!r} has orientation {self.orientation!r}; it must be a string")
        if self.half_width is not None and self.half_width < 0.5 * self.flat_width:
            raise SettingError(
                f"sensor {self.name!r} has half_width {self.half_width!r} and flat_width {self.flat_width!r}; the pad "
                "must be as wide as the flat part of its tip, or wider"
            )
        if self.pixel_pitch is None and self.half_width is not None and self.image_width:
            object.__setattr__(self, "pixel_pitch", 2.0 * self.half_width / self.image_width)
        if (self.image_height == 0) != (self.image_width == 0):
            size = f"{self.image_height} rows and {self.image_width} columns"
            raise SettingError(f"sensor {self.name!r} has images of {size}; both must be 0 or both above 0")
        try:
            tips = tuple((float(x), float(y)) for x, y in self.tips)
        except (TypeError, ValueError, OverflowError):
            tips = ()
        if not tips or not (np.abs(tips) <= FARTHEST).all():
            tips_stated = reprlib.repr(self.tips)
            raise SettingError(
                f"sensor {self.name!r} has tips {tips_stated}; they must be one or more finite (x, y) pairs [m]"
            )
        object.__setattr__(self, "tips", tips)

    @property
    def shown(self) -> float:
        """Width of the gel that an image shows, as a share of the pad's; 1 if either is unknown."""
        if self.pixel_pitch is None or self.half_width is None or not self.image_width:
            return 1.0
        return self.pixel_pitch * self.image_width / (2.0 * self.half_width)

    @property
    def centers(self) -> Array:
        """Centres of curvature of the tips in the sensor frame, (tips, 2) [m]."""
        return np.array(self.tips) - np.array((self.radius, 0.0))

    @property
    def center(self) -> Array:
        """Mean of `centers`, (2,) [m]."""
        return self.centers.mean(axis=0)

    @property
    def width(self) -> float:
        """Width along y over which the load may shift: of a pad's flat part and between outer tips [m]; else 0."""
        return self.flat_width + float(np.ptp(self.centers[:, 1]))

    @property
    def round_centers(self) -> Array:
        """Centres of curvature of all round parts of all tips in the sensor frame, (tips times n, 2) [m].

        A flat pad is a row of 15 round parts. At the Mini's width they are 1.2 mm apart, and a soft gel is even over
        such a distance.
        """
        y = np.linspace(-0.5, 0.5, 15) * self.flat_width if self.flat_width else np.zeros(1)
        offsets = np.column_stack((np.zeros_like(y), y))
        return (self.centers[:, None] + offsets).reshape(-1, 2)

    def gaps(self, sensor_pose: Array, object_pose: Array, shape: Shape) -> Array:
        """Return the distance of the sensor's surface from an outline (N,) [m]; negative is overlap.

        Poses are world_T_sensor and world_T_object (N, 3); the gap is NaN where the object pose is.
        """
        gap = np.full(len(sensor_pose), np.nan)
        known = ~np.isnan(object_pose).any(axis=1)
        object_T_sensor = se2.between(object_pose[known], sensor_pose[known])
        centers = se2.transform(object_T_sensor[:, None], self.round_centers)
        gap[known] = shape.signed_distance(centers).min(axis=1) - self.radius
        return gap

    @property
    def pads(self) -> list[Array]:
        """Outlines (n, 2) [m] of the tips in the sensor frame, for figures: pads as deep as wide, or round tips."""
        if self.half_width is None:
            angle = np.linspace(-np.pi, np.pi, 60)
            back = np.empty((0, 2))
        else:
            round_ = self.half_width - 0.5 * self.flat_width
            edge = np.arcsin(round_ / self.radius) if round_ < self.radius else 0.5 * np.pi
            angle = np.linspace(-1.0, 1.0, 30) * edge
            back = self.half_width * np.array([(-2.0, 1.0), (-2.0, -1.0)])
        arc = self.radius * np.column_stack((np.cos(angle) - 1.0, np.sin(angle)))
        arc[:, 1] += 0.5 * self.flat_width * np.sign(angle)
        return [np.array(tip) + np.concatenate([arc, back]) for tip in self.tips]


def sensor_from_dict(data: Mapping[str, Any]) -> SensorProfile:
    """Return the profile whose fields were written; raises SettingError on a missing or unknown field."""
    if not isinstance(data, Mapping):
        raise SettingError(f"a sensor must be an object with fields, not {data!r}")
    allowed = [field.name for field in fields(SensorProfile)]
    if not {"name", "radius"} <= data.keys() <= set(allowed):
        raise SettingError(f"a sensor has the fields {sorted(data)}; needed are name and radius of {allowed}")
    return SensorProfile(**data)


DIGIT = SensorProfile(
    name="DIGIT",
    radius=0.021,
    half_width=0.0092,
    image_height=320,
    image_width=240,
    rate=30.0,
    pixel_pitch=6.25e-5,
    pixel_pitch_sigma=0.144,
)
"""The DIGIT with its curved gel, whose image shows the middle of the pad: units were measured at 14 to 19.6 px/mm."""

GELSIGHT_MINI = SensorProfile(
    name="GelSight Mini",
    radius=0.002,
    half_width=0.01014,
    image_height=240,
    image_width=320,
    rate=25.0,
    flat_width=0.01628,
    pixel_pitch=6.25e-5,
    pixel_pitch_sigma=0.015,
)
"""The GelSight Mini: 320 x 240 px of 0.0625 mm as measured on real edges; the maker's software (gsrobotics) has 0.0634.

Its gel is flat, and its pad is assumed to end at the border of the image, in edges of 2 mm.
"""

POINT = SensorProfile(name="point", radius=0.0, rate=30.0)
"""A sharp probe without images."""

SENSORS = {"digit": DIGIT, "gelsight-mini": GELSIGHT_MINI, "point": POINT}
"""Profiles by the names in options."""
ALIASES = {"mini": "gelsight-mini", "gelsightmini": "gelsight-mini", "gelsight": "gelsight-mini"}
