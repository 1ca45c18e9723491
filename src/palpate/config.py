"""Settings of the tracker: frozen dataclasses, one group a factor, with unit and reason under each field.

`NoiseSettings` can be kept in a JSON file, which `palpate tune` writes and `--noise FILE` reads.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from numbers import Integral
from pathlib import Path
from typing import Any, ClassVar, get_args

import numpy as np

from palpate.arrays import Array
from palpate.errors import FileError, SettingError
from palpate.files import read_json
from palpate.geometry.se2 import Sigmas
from palpate.types.choices import SmootherName, TactileChoice
from palpate.types.measurements import finite_numbers

Normal = tuple[float, float]
"""Mean and standard deviation."""
Kernel = float | None
"""Scale of a Cauchy kernel [standard deviations]; None is a plain square."""


def _checked(name: str, given: Any, kind: Any, zero_allowed: bool) -> float | tuple[float, ...] | None:
    optional, shape = kind == Kernel, {Sigmas: (3,), Normal: (2,)}.get(kind, ())
    if given is None and optional:
        return None
    numbers = None if isinstance(given, bool) else finite_numbers(given, shape)
    least = np.inf if numbers is None else numbers[1:] if kind == Normal else numbers
    if numbers is None or not np.all(least >= 0.0 if zero_allowed else least > 0.0):
        limit = f"{'at least' if zero_allowed else 'above'} 0{', or None' if optional else ''}"
        counts = {Sigmas: "3 finite numbers", Normal: "a finite mean and a finite standard deviation"}
        raise SettingError(f"{name} is {given!r}; it must be {counts.get(kind, 'a finite number')} {limit}")
    return tuple(numbers.tolist()) if shape else float(numbers)


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
    """Factor on the variance that the touch model predicts, without the bias and scale that all directions share."""
    floor: float = 0.0
    """Least standard deviation of a measurement [rad], of a place [m]: the error of the contact model itself."""
    kernel: Kernel = 3.0
    """Scale of the Cauchy kernel [standard deviations]: a single bad image must not bend the path."""


@dataclass(frozen=True)
class StickingSettings:
    """Sticking contact: sliding while the pushing force is inside the friction cone."""

    zero_allowed = ("share", "sliding_share")
    still: float = 2e-5
    """Sliding in a step without sensor motion [m]."""
    share: float = 0.06
    """Sliding as a share of the sensor's motion, inside the cone: one simulated contact in hundreds creeps so much."""
    sliding_share: float = 2.0
    """The same at the cone's edge: slides are long and one-sided, so only a large value leaves them free."""
    margin: float = 0.04
    """Angle inside the cone's edge from which the contact sticks [rad]."""
    width: float = 0.03
    """A third of the angle over which sticking turns into sliding [rad]."""
    kernel: Kernel = 2.0
    """Scale of the Cauchy kernel on both rows together [standard deviations]."""


@dataclass(frozen=True)
class BalanceSettings:
    """Balance of force and torque on the limit surface of the friction between object and table."""

    zero_allowed = ("share", "load")
    still: float = 2e-7
    """Imbalance in a step without sensor motion [m^2]."""
    share: float = 0.013
    """Imbalance as a share of the sensor's motion times c: the ellipsoid fits simulated supports to 1 %."""
    load: float = 0.8
    """Error of the load's place on several tips, as a share of the distance between the outermost."""
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
    """A third of the angle over which the edge begins to count [rad]."""
    kernel: Kernel = 2.0
    """Scale of the Cauchy kernel [standard deviations]; a disturbance breaks the cone."""


@dataclass(frozen=True)
class Priors:
    """Mean and standard deviation of what belongs to the object, before its first contact; see `graph.variables`."""

    direction_bias: Normal = (0.0, 2e-2)
    """Constant error of all contact directions [rad]."""
    direction_scale: Normal = (0.0, 0.06)
    """Relative scale error of contact directions."""
    place_bias: Normal = (0.0, 1.2e-3)
    """Constant error of all contact places [m]."""
    depth: Normal = (3e-4, 4e-4)
    """Indentation of the gel, with all constant errors of outline and mounting along the push [m]."""
    outline_scale: Normal = (0.0, 0.007)
    """Relative size error of the outline."""
    friction_ratio: Normal = (0.2, 0.66)
    """Logarithm of c^2 over its value for an even pressure on the table; with the pressure at the rim it is 0.8."""
    friction_center: Normal = (0.0, 0.06)
    """Centre of friction from the centroid along x and along y, as a share of c."""
    grip: Normal = (-1.05, 0.4)
    """Logarithm of Coulomb friction between sensor and object: the coefficient is 0.35, times or by 1.5."""
    friction_changes: ClassVar[tuple[float, float]] = (0.44, 0.006)
    """Change of the last three between contacts and in each step, as shares of their standard deviation."""

    @cached_property
    def mean(self) -> Array:
        """Means (9,), in the order of the fields, the centre of friction twice."""
        return self._of_each_number()[:, 0]

    @cached_property
    def deviation(self) -> Array:
        """Standard deviations (9,), in the same order."""
        return self._of_each_number()[:, 1]

    @cached_property
    def changes(self) -> Array:
        """Variances (2, 9) of the changes from one contact to the next and in each step of one, in the same order."""
        return np.square(np.outer(self.friction_changes, np.repeat([0.0, 1.0], [5, 4]) * self.deviation))

    def _of_each_number(self) -> Array:
        normals = [getattr(self, each.name) for each in fields(self)]
        return np.array([*normals[:-1], *normals[-2:]])  # the centre of friction, which is the last but one, twice


@dataclass(frozen=True)
class NoiseSettings:
    """Standard deviations, shares and kernels of all factors, a group each; see the classes of the groups.

    Numbers become floats. Defaults for touch and sliding are tuned by `palpate tune` on simulated recordings.
    """

    sensor_pose: SensorPoseSettings = SensorPoseSettings()
    first_pose: FirstPoseSettings = FirstPoseSettings()
    contact: ContactSettings = ContactSettings()
    direction: TouchSettings = TouchSettings(floor=0.035)
    """Errors of pushing are alike from frame to frame, so that nearly exact directions, taken as they are, would
    override it and raise false alarms. The floor is 2 degrees."""
    place: TouchSettings = TouchSettings()
    turn: TouchSettings = TouchSettings(share=88.0)
    """On round objects turns are some percent off for a whole contact, and these errors add up."""
    corner: TouchSettings = TouchSettings()
    sticking: StickingSettings = StickingSettings()
    balance: BalanceSettings = BalanceSettings()
    friction_cone: FrictionConeSettings = FrictionConeSettings()
    priors: Priors = Priors()

    def __post_init__(self) -> None:
        for group in fields(self):
            settings, checked = getattr(self, group.name), {}
            if not isinstance(settings, kind := type(group.default)):
                raise SettingError(f"{group.name} is {settings!r}; it must be palpate.config.{kind.__name__}")
            for each in fields(settings):
                given, zero_allowed = getattr(settings, each.name), each.name in getattr(settings, "zero_allowed", ())
                checked[each.name] = _checked(f"{group.name}.{each.name}", given, each.type, zero_allowed)
            object.__setattr__(self, group.name, replace(settings, **checked))


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of a `Tracker`; raises SettingError on a value that is not allowed."""

    tactile: TactileChoice = "auto"
    """Source of the touch measurements."""
    smoother: SmootherName = "fixed-lag"
    """Solver for the graph of a contact."""
    noise: NoiseSettings = NoiseSettings()
    """Noise of all factors."""
    hypotheses: int = 9
    """Largest number of hypotheses kept after a contact's first frames; 1 keeps one always."""
    disturbance_rate: float = 0.75
    """Rate at which something else moves the object while it is touched [1/s]. A higher rate finds more disturbances
    and calls more estimates `ambiguous`."""
    tolerance: tuple[float, float] = (0.01, 0.105)
    """Largest error of position [m] and yaw [rad] of a pose that is good enough, at two standard deviations: a worse
    one is `uncertain`, and one with a likely alternative beyond it `ambiguous`. The default is 10 mm and 6 degrees,
    as an object placed by hand has. The yaw of a round object does not count."""

    def __post_init__(self) -> None:
        for name, allowed in (("tactile", get_args(TactileChoice)), ("smoother", get_args(SmootherName))):
            if (found := getattr(self, name)) not in allowed:
                raise SettingError(f"{name} is {found!r}; allowed are {', '.join(allowed)}")
        if not isinstance(self.noise, NoiseSettings):
            raise SettingError(f"noise is {self.noise!r}; it must be palpate.NoiseSettings(...)")
        for name, most, allowed in (
            ("disturbance_rate", 10.0, "a rate above 0, up to 10/s"),
            ("tolerance", (1.0, np.pi), "a length above 0, up to 1 m, and an angle [rad] above 0, up to pi"),
        ):
            numbers = finite_numbers(given := getattr(self, name), np.shape(most))
            if numbers is None or isinstance(given, bool) or not ((numbers > 0.0) & (numbers <= most)).all():
                raise SettingError(f"{name} is {given!r}; allowed are {allowed}")
        if not isinstance(self.hypotheses, Integral) or isinstance(self.hypotheses, bool) or self.hypotheses < 1:
            raise SettingError(f"hypotheses is {self.hypotheses!r}; allowed is a whole number from 1 on")
        # NumPy's numbers cannot be written as JSON.
        object.__setattr__(self, "hypotheses", int(self.hypotheses))


FORMAT, VERSION = "palpate-noise", 4


def noise_of(name_or_path: Path | str) -> NoiseSettings:
    """Return the settings in a file, missing ones with their defaults; "palpate" is the defaults.

    Raises SettingError if there is no such file, FileError on a bad one.
    """
    path, noise, groups = Path(name_or_path), NoiseSettings(), {}
    if str(name_or_path) == "palpate":
        return noise
    if not path.exists():
        raise SettingError(f"noise is {str(path)!r}; allowed are 'palpate' or a file of palpate tune")
    content = read_json(path)
    if (found := (content.get("format"), content.get("version"))) != (FORMAT, VERSION):
        expected = f"expected {(FORMAT, VERSION)}; make the file anew with palpate tune"
        raise FileError(f"{path}: format and version are {found}, {expected}")
    try:
        for group, values in _known("noise", content.get("noise"), noise).items():
            settings = getattr(noise, group)
            groups[group] = replace(settings, **_known(f"noise {group}", values, settings))
        return replace(noise, **groups)
    except SettingError as error:
        raise FileError(f"{path}: {error}") from error


def _known(name: str, given: Any, settings: Any) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise SettingError(f"{name} is {given!r}, expected an object of settings")
    known = [field.name for field in fields(settings)]
    if unknown := [one for one in given if one not in known]:
        raise SettingError(f"{name} has no {unknown[0]!r}; known are {', '.join(known)}")
    return given


# Numbers of the graph and of consistency tests, which nobody sets.

LAG = 40  # steps in a sliding window: 20 or 30 lose a little
ITERATIONS = 4  # most Gauss-Newton steps in a frame: with two sigma doubles
CONVERGED = 5e-5  # [m], [rad] change of a pose that ends them: with six times as much, real pushes end worse
REMEMBERED = 1000  # steps that left the window whose costs still count, half a minute: older ones are forgotten
SLACK = 0.02  # [s] tolerance on a measurement's time: clocks of cameras and robots differ
SOFT = 2e-4  # [m] indentation over which the parts of a pad share the load: keeps the contact smooth
REACH = 3  # steps before and after a step over which the angle of the force is computed: one alone is mostly noise
ACROSS = 2e-3  # [m] motion of a disturbed object across the outline in a step: the sensor stays in touch
TURNED = 3.0  # ratio of c times the turn of a disturbed object to its slide: a hand turns more than it slides
SHORT = 5  # steps over which innovations are judged: more tell no more shoves
PREDICTED = 1e-4  # least share of R in R + H P H' from which a measurement is predicted at all
UNLIKELY = 3.0  # standard deviations from which a distance or a pose contradicts, and a place is not considered
RECENT = 10  # images that repeat to the last bit before a camera counts as hanging

# Limits of plausible frames.
ANYWHERE_SIGMA = 1.0, 1.0, 2.0  # [m, m, rad] of an object that may be anywhere; larger ones may be millimetres
LARGEST_ERROR = 5e-3, 0.1  # [m, rad] of a stated pose, with those of mounting and outline

# Limits of what touch images show.
SIGNIFICANT = 4.0  # standard deviations by which a touched cell is off the untouched gel, as in the paper
LEAST_DEVIATION = 1.0  # [grey levels] of a cell; 4 of it are above the steps, up to 3, of JPEG at quality 75
START = 0.01  # share of significant values from which the gel is touched: the paper's for its smallest contacts
"""Noise alone makes 6e-5 of them (normal distribution beyond 4 standard deviations), and 1.3e-3 while the deviation is
known from 15 frames (Student's). One percent is the area of 12 of 1200 cells, 4 mm^2 of a DIGIT's pad."""
MOST = 0.5  # share of a change from which it is thin lines, a scratch, and of an image from which a change is noise
NO_GEL = 0.8  # share of significant values from which no gel is seen: touches make up to 0.7
NO_GEL_IN_DOUBT = 0.6  # the same while a calibration may be of another unit, which mostly makes more
UNLIKE = 8.0  # [grey levels] between cells of images that do not show one gel at rest: 12 miss how a contact begins
DARKER = 12.0  # [grey levels] of markers below the gel around them: with 8 real gels without any have some
MEMORY, EVERY = 90, 5  # images over which the background follows the light, 3 s at 30 Hz; one in five is used
LIGHT = 3.0  # factor by which the light may change either way while the gel still shows
CORNER_LOGIT = 2.0  # log odds of a corner from which its angle is a measurement
FITS, SETTLED = 8, 1e-3  # most fits of the light, and its change, a quarter of a grey level, that ends them
