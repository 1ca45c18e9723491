"""Settings of the tracker: frozen dataclasses, one group for each factor, with unit and reason under each field.

`palpate.noise_file` reads and writes `NoiseSettings` as a file.
"""

from dataclasses import dataclass, fields, replace
from numbers import Integral
from typing import Any, get_args

import numpy as np

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.geometry.se2 import Sigmas
from palpate.types.choices import MarkersChoice, SmootherName, TactileChoice, TrackerChoices
from palpate.types.measurements import finite_numbers

Normal = tuple[float, float]
"""Mean and standard deviation."""
Kernel = float | None
"""Scale of a Cauchy kernel [standard deviations]; None is a plain square."""


_SHAPES: dict[Any, tuple[int, ...]] = {Sigmas: (3,), Normal: (2,)}
"""Shapes of the settings that are more than one number, by type."""
_NUMBERS = {Sigmas: "3 finite numbers", Normal: "a finite mean and a finite standard deviation"}
"""Their words in an error."""


def _checked_setting(name: str, given: Any, kind: Any, zero_allowed: bool) -> float | tuple[float, ...] | None:
    """Return a setting as a float, or a tuple of floats; raises SettingError, which names it, on any other value."""
    is_optional = kind == Kernel
    if given is None and is_optional:
        return None
    shape = _SHAPES.get(kind, ())
    numbers = None if isinstance(given, bool) else finite_numbers(given, shape)
    if numbers is None or not _is_in_range(numbers, kind, zero_allowed):
        limit = "at least 0" if zero_allowed else "above 0"
        or_none = ", or None" if is_optional else ""
        allowed = f"{_NUMBERS.get(kind, 'a finite number')} {limit}{or_none}"
        raise SettingError(f"{name} is {given!r}; it must be {allowed}")
    if shape:
        return tuple(numbers.tolist())
    return float(numbers)


def _is_in_range(numbers: Array, kind: Any, zero_allowed: bool) -> bool:
    """Return true if all standard deviations, shares or scales are above 0, or 0 where that is allowed."""
    positive = numbers[1:] if kind == Normal else numbers  # a mean may have any sign
    if zero_allowed:
        return bool(np.all(positive >= 0.0))
    return bool(np.all(positive > 0.0))


@dataclass(frozen=True)
class SensorPoseSettings:
    """Accuracy of the sensor's pose in the world."""

    zero_allowed = ("calibration",)
    deviation: Sigmas = (1e-4, 1e-4, 1e-3)
    """Measured sensor pose [m, m, rad], body frame: a good robot's kinematics or motion capture."""
    calibration: Sigmas = (1e-3, 1e-3, 9e-3)
    """Constant offset between sensor, world and outline [m, m, rad], which only the reported covariance includes."""


@dataclass(frozen=True)
class FirstPoseSettings:
    """Accuracy of the object's first pose, and its motion between contacts."""

    deviation: Sigmas = (3e-3, 3e-3, 5e-2)
    """Default uncertainty of the first pose when none is given [m, m, rad], body frame: an object placed by hand."""
    truth: Sigmas = (5e-4, 5e-4, 5e-3)
    """The same if the first pose is ground truth [m, m, rad]."""
    rest: Sigmas = (1e-5, 1e-5, 1e-4)
    """Motion of the object between two contacts [m, m, rad]."""


@dataclass(frozen=True)
class ContactSettings:
    """Contact between the sensor's surface and the outline."""

    deviation: float = 1e-3
    """Distance between sensor and outline in contact [m]: errors of outline, gel and mounting."""
    kernel: Kernel = 3.0
    """Scale of the Cauchy kernel [standard deviations]."""


@dataclass(frozen=True)
class TouchSettings:
    """Contact direction on a round tip, place on a flat pad, turn of the sensor, or angle at a corner, by touch."""

    zero_allowed = ("floor",)
    share: float = 2.0
    """Factor on the variance that the touch model predicts. The errors that all directions of a unit have in common,
    bias and scale, are variables instead; see `Priors`."""
    floor: float = 0.0
    """Least standard deviation of a measurement [rad], of a place [m]: the error of the contact model itself."""
    kernel: Kernel = 3.0
    """Scale of the Cauchy kernel [standard deviations]: a single bad image must not bend the path."""


@dataclass(frozen=True)
class StickingSettings:
    """Sticking contact: sliding while the pushing force is inside the friction cone."""

    zero_allowed = ("share", "sliding_share", "expected_share")
    still: float = 2e-5
    """Sliding in a step without sensor motion [m]."""
    share: float = 0.06
    """Sliding inside the friction cone, as a share of the sensor's motion. In simulation, one contact in some hundreds
    slides as much while it should stick."""
    sliding_share: float = 2.0
    """The same at the cone's edge. A slide goes on in one direction for many steps, so only a large value allows it."""
    expected_share: float = 0.15
    """Expected slide at the cone's edge, to the side of the force, as a share of the sensor's motion. Half of those in
    simulation are by 0.23 to 0.59 of it. Simulated pushes are tracked better than with 0, and MIT's real ones, over
    eight priors of friction, as well (docs/real_data.md)."""
    margin: float = 0.04
    """Distance of the force's direction from the cone's edge at which the contact begins to stick [rad]."""
    width: float = 0.03
    """A third of the angle over which sticking turns into sliding [rad]."""
    kernel: Kernel = 2.0
    """Scale of the Cauchy kernel on the norm of both components of the sliding [standard deviations]."""


@dataclass(frozen=True)
class BalanceSettings:
    """Balance of force and torque on the limit surface of the friction between object and table."""

    zero_allowed = ("share", "load")
    still: float = 2e-7
    """Imbalance in a step without sensor motion [m^2]."""
    share: float = 0.013
    """Imbalance as a share of the sensor's motion times the friction radius c. An ellipsoid fits the limit surfaces of
    simulated supports to 1 %."""
    load: float = 0.8
    """Error of the place of the load on several tips, as a share of the distance between the outermost tips."""
    kernel: Kernel = 2.0
    """Scale of the Cauchy kernel [standard deviations]; a disturbance breaks the balance."""


@dataclass(frozen=True)
class FrictionConeSettings:
    """Force at the edge of the friction cone while the contact slides."""

    zero_allowed = ("share",)
    still: float = 2e-5
    """Motion outside the cone in a step without sensor motion [m]."""
    share: float | None = 0.2
    """Motion outside the cone as a share of the sensor's motion; None turns the factor off."""
    width: float = 0.03
    """A third of the angle over which the factor's weight rises from none to full at the cone's edge [rad]."""
    kernel: Kernel = 2.0
    """Scale of the Cauchy kernel [standard deviations]; a disturbance breaks the cone."""


@dataclass(frozen=True)
class Priors:
    """Mean and standard deviation of the object's variables before its first contact, by the names of the variables.

    See `palpate.models.pushing.variables`.
    """

    direction_bias: Normal = (0.0, 2e-2)
    """Constant error of all contact directions [rad]."""
    direction_scale: Normal = (0.0, 0.06)
    """Relative scale error of contact directions."""
    place_bias: Normal = (0.0, 1.2e-3)
    """Constant error of all contact places [m]."""
    depth: Normal = (3e-4, 4e-4)
    """Indentation of the gel, plus all constant errors of outline and mounting along the push [m]."""
    outline_scale: Normal = (0.0, 0.007)
    """Relative size error of the outline."""
    friction_ratio: Normal = (0.2, 0.66)
    """Logarithm of the ratio of c^2, the square of the friction radius, to its value for an even pressure on the table.
    With all pressure at the rim it is 0.8."""
    friction_center: Normal = (0.0, 0.06)
    """Centre of friction from the centroid along x and along y, as a share of c."""
    grip: Normal = (-1.05, 0.4)
    """Logarithm of the coefficient of Coulomb friction between sensor and object: 0.35, within a factor of 1.5."""


@dataclass(frozen=True)
class NoiseSettings:
    """Standard deviations, shares and kernels, a group for each factor; see the classes of the groups.

    Numbers become floats. Defaults for touch and sliding are tuned by `palpate tune` on simulated recordings.
    """

    sensor_pose: SensorPoseSettings = SensorPoseSettings()
    first_pose: FirstPoseSettings = FirstPoseSettings()
    contact: ContactSettings = ContactSettings()
    direction: TouchSettings = TouchSettings(floor=0.035)
    """The errors of the pushing model last from frame to frame. Directions with a smaller deviation than the floor of
    2 degrees would override pushing, and raise false alarms."""
    place: TouchSettings = TouchSettings()
    turn: TouchSettings = TouchSettings(share=88.0)
    """On round objects turns have errors of some percent that last a whole contact, so that they add up."""
    corner: TouchSettings = TouchSettings()
    sticking: StickingSettings = StickingSettings()
    balance: BalanceSettings = BalanceSettings()
    friction_cone: FrictionConeSettings = FrictionConeSettings()
    priors: Priors = Priors()

    def __post_init__(self) -> None:
        for group in fields(self):
            settings = getattr(self, group.name)
            kind = type(group.default)
            if not isinstance(settings, kind):
                raise SettingError(f"{group.name} is {settings!r}; it must be palpate.config.{kind.__name__}")
            zero_allowed = getattr(settings, "zero_allowed", ())
            checked = {}
            for setting in fields(settings):
                name = f"{group.name}.{setting.name}"
                given = getattr(settings, setting.name)
                checked[setting.name] = _checked_setting(name, given, setting.type, setting.name in zero_allowed)
            object.__setattr__(self, group.name, replace(settings, **checked))


@dataclass(frozen=True)
class ContactDetection:
    """Limits from which an image shows a touch. They are no settings; all of `palpate.touch` uses them."""

    significant: float = 4.0
    """Deviation of a touched cell from the untouched gel [standard deviations], as in the paper."""
    least_deviation: float = 1.0
    """Least standard deviation of a cell [grey levels]; 4 of it are above the steps, up to 3, of JPEG at quality 75."""
    start: float = 0.01
    """Share of an image's values that are significant from which a touch starts: the paper's for its smallest contacts.
    Noise alone makes 6e-5 of them (normal distribution beyond 4 standard deviations), and 1.3e-3 while the deviation is
    known from 15 frames (Student's). One percent is the area of 12 of 1200 cells, 4 mm^2 of a DIGIT's pad."""
    end: float = 0.005
    """The share at which a touch ends: half, so that a faint one does not flicker, and still well above noise."""


CONTACT_DETECTION = ContactDetection()


@dataclass(frozen=True)
class TrackerSettings(TrackerChoices):
    """Settings of a `Tracker`; raises SettingError on a value that is not allowed."""

    noise: NoiseSettings = NoiseSettings()
    """Noise of all factors."""
    disturbance_rate: float = 0.75
    """Rate at which something else than the sensor moves the object while it is touched [1/s]. With a higher rate more
    disturbances are found, and more estimates are `ambiguous`. With 0.4, simulated pushes without any have a higher
    likelihood, and real ones that are knocked are in their 95 % regions less often."""
    tolerance: tuple[float, float] = (0.01, 0.105)
    """Largest error of the outline's centroid [m] and of yaw [rad] of a pose that is good enough, at two standard
    deviations: a worse one is `uncertain`, and one with a likely alternative beyond it `ambiguous`. The default is
    10 mm and 6 degrees, as an object placed by hand has. The yaw of a round object does not count."""

    def __post_init__(self) -> None:
        _check_choice("tactile", self.tactile, get_args(TactileChoice))
        _check_choice("smoother", self.smoother, get_args(SmootherName))
        _check_choice("markers", self.markers, get_args(MarkersChoice))
        if not isinstance(self.noise, NoiseSettings):
            raise SettingError(f"noise is {self.noise!r}; it must be palpate.NoiseSettings(...)")
        _check_positive("disturbance_rate", self.disturbance_rate, 10.0, "a rate above 0, up to 10/s")
        tolerances = "a length above 0, up to 1 m, and an angle [rad] above 0, up to pi"
        _check_positive("tolerance", self.tolerance, (1.0, np.pi), tolerances)
        if not isinstance(self.hypotheses, Integral) or isinstance(self.hypotheses, bool) or self.hypotheses < 1:
            raise SettingError(f"hypotheses is {self.hypotheses!r}; allowed is a whole number from 1 on")
        # NumPy's numbers cannot be written as JSON.
        object.__setattr__(self, "hypotheses", int(self.hypotheses))


def _check_choice(name: str, given: object, allowed: tuple[str, ...]) -> None:
    """Raise SettingError unless a setting is one of the allowed words."""
    if given not in allowed:
        raise SettingError(f"{name} is {given!r}; allowed are {', '.join(allowed)}")


def _check_positive(name: str, given: object, most: float | tuple[float, ...], allowed: str) -> None:
    """Raise SettingError unless a setting is a number, or numbers, above 0 and up to `most`."""
    numbers = None if isinstance(given, bool) else finite_numbers(given, np.shape(most))
    if numbers is None or not ((numbers > 0.0) & (numbers <= most)).all():
        raise SettingError(f"{name} is {given!r}; allowed are {allowed}")


# Limits that several rooms use and nobody sets.

UNLIKELY = 3.0
"""Standard deviations from which a distance or a pose contradicts the estimate, and a place is not considered."""
ANYWHERE_SIGMA = (1.0, 1.0, 2.0)
"""[m, m, rad] Deviations of the first pose of an object that may be anywhere; larger ones may be millimetres."""
LARGEST_ERROR = (5e-3, 0.1)
"""[m, rad] Largest error of a stated pose, with those of mounting and outline."""
