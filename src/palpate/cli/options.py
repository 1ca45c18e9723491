"""Options that several commands share: one frozen dataclass a group of the help, and what each group is turned into.

A command takes these groups as parameters (`start: Start = Start()`); tyro makes the options from their fields and the
help from the docstrings. Nothing heavy is imported before a method is called, so that `--help` stays fast.
"""

import math
from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import tyro
from tyro.constructors import PrimitiveConstructorSpec

if TYPE_CHECKING:
    from palpate.config import TrackerSettings
    from palpate.io.rosbag_recording import BagReading
    from palpate.touch.calibration import Calibration
    from palpate.touch.touch_model import TouchModel
    from palpate.types.recording import Recording

# The library's choices, repeated here so that --help need not import it.
Tactile = Literal["none", "oracle", "learnt", "learnt-turn", "learnt-direction"]
TactileChoice = Literal["auto", Tactile]
SmootherName = Literal["fixed-lag", "batch"]
ShapeUnit = Literal["m", "cm", "mm", "in"]
Numbers = tuple[float, float, float]
"""A pose or its standard deviations [m, m, rad]."""

NOISE = "palpate|published|FILE"
"""The metavar of an option that takes noise settings."""


def arg(
    metavar: str | None = None, default: str | None = None, *, help: str | None = None, name: str | None = None
) -> Any:
    """Return tyro's argument with a metavar and, where the default is not a plain value, words for it.

    `help` is for texts of several lines; tyro takes a shorter one from the docstring under the field.
    """
    hint = default and f"(default: {default})"
    return tyro.conf.arg(metavar=metavar, name=name, help=help, help_behavior_hint=hint)


def positional(metavar: str, help: str, required: bool = False) -> Any:
    """Return tyro's argument for a positional parameter of a command."""
    return tyro.conf.arg(metavar=metavar, help=help, help_behavior_hint="(required)" if required else None)


def _three_numbers(option: str, meaning: str) -> PrimitiveConstructorSpec[Numbers | None]:
    """Parse three numbers, with one sentence as the error where they are something else."""

    def parse(words: list[str]) -> Numbers | None:
        from palpate.errors import SettingError

        try:
            x, y, theta = map(float, words)
        except ValueError:
            raise SettingError(f"{option} is {' '.join(words)!r}; it must be three numbers, {meaning}") from None
        return x, y, theta

    return PrimitiveConstructorSpec(
        nargs=3,
        metavar="X Y THETA",
        instance_from_str=parse,
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda value: [] if value is None else [f"{number:g}" for number in value],
    )


RecordingsFolder = Annotated[
    tyro.conf.Positional[Path],
    positional("DIR", "Folder of recordings in any known format; folders in it are searched too.", required=True),
]
Force: TypeAlias = Annotated[bool, tyro.conf.arg(help="Replace existing output.")]
Json: TypeAlias = Annotated[bool, tyro.conf.arg(help="Print one JSON object.")]
Smoother: TypeAlias = Annotated[
    SmootherName, tyro.conf.arg(help="Solve the graph over the last steps of a contact, or over all of them.")
]
Sensor: TypeAlias = Annotated[str, tyro.conf.arg(metavar="NAME", help="Sensor profile: digit or gelsight-mini.")]


@dataclass(frozen=True)
class Start:
    """The object's pose at the start. By default the recording's own, else its first ground truth."""

    first_pose: Annotated[
        Numbers | None,
        _three_numbers("--first-pose", "x [m], y [m] and theta [rad]"),
        arg("X Y THETA", "from the recording"),
    ] = None
    """Object pose in the world [m, m, rad]."""
    first_pose_sigma: Annotated[
        Numbers | None,
        _three_numbers("--first-pose-sigma", "standard deviations of x [m], y [m] and theta [rad]"),
        arg("SX SY STHETA", "from the recording, else the noise settings"),
    ] = None
    """Its standard deviations [m, m, rad]. With large ones, touch finds the object."""
    first_pose_unknown: bool = False
    """The pose is unknown: within 1 m of the world's origin, at any yaw. Touch finds the object."""

    def pose_and_sigma(self) -> tuple[Numbers | None, Numbers | None]:
        """Return the first pose and its sigma, None where not given. Raises SettingError where options conflict."""
        from palpate.errors import SettingError
        from palpate.tracker import ANYWHERE, ANYWHERE_SIGMA

        if not self.first_pose_unknown:
            return self.first_pose, self.first_pose_sigma
        if self.first_pose is not None or self.first_pose_sigma is not None:
            given = "--first-pose" if self.first_pose is not None else "--first-pose-sigma"
            raise SettingError(f"--first-pose-unknown cannot be combined with {given}")
        return ANYWHERE, ANYWHERE_SIGMA


@dataclass(frozen=True)
class Touch:
    """Touch measurements, and the model and calibration of the sensor."""

    tactile: Annotated[
        TactileChoice,
        arg(
            help="Measurements of touch: none (contact only), learnt (read from images by a model; learnt-turn and "
            "learnt-direction use one of its outputs alone) or oracle (from ground truth); auto is learnt where there "
            "are images that the model can read, else none."
        ),
    ] = "auto"
    model: Annotated[Path | None, arg("MODEL", "the sensor's own")] = None
    """Folder of a touch model."""
    calibration: Annotated[Path | None, arg("UNIT.npz", "the first half second is taken as untouched")] = None
    """Calibration of this sensor unit, from palpate calibrate."""

    def load(self) -> "tuple[TouchModel | None, Calibration | None]":
        """Read model and calibration, None where not given. Raises SettingError for a model that is not used."""
        from palpate.touch.calibration import load_calibration
        from palpate.touch.touch_model import TouchModel

        check_model(self.model, [self.tactile])
        return self.model and TouchModel(self.model), self.calibration and load_calibration(self.calibration)


@dataclass(frozen=True)
class Estimator:
    """The estimator: noise, friction on the table, and hypotheses."""

    noise: Annotated[str, arg(NOISE)] = "palpate"
    """Standard deviations: a preset, or a file of palpate tune."""
    pressure: Annotated[str, arg("uniform|rim|corner|METRES")] = "uniform"
    """Pressure of the object on the table, or its friction radius c [m]."""
    hypotheses: Annotated[int | None, arg("N", "9")] = None
    """Largest number of hypotheses kept while touch is ambiguous; more are allowed at the start of a contact."""

    def settings(self, tactile: TactileChoice, smoother: SmootherName = "fixed-lag") -> "TrackerSettings":
        """Return the settings of a tracker."""
        from palpate.config import TrackerSettings, noise_of

        pressure = pressure_of(self.pressure)
        settings = TrackerSettings(tactile=tactile, smoother=smoother, noise=noise_of(self.noise), pressure=pressure)
        return settings if self.hypotheses is None else replace(settings, hypotheses=self.hypotheses)


@dataclass(frozen=True)
class Bag:
    """The object and the topics, for bags of ROS messages."""

    shape: Annotated[
        str | None,
        arg(
            "NAME|AxB|FILE",
            "none; bags need it",
            help="The object: a name as in palpate simulate, the sides of a rectangle such as 0.09x0.06 [m], or an "
            "outline in a file (CSV, JSON, SVG or DXF).",
        ),
    ] = None
    shape_unit: Annotated[ShapeUnit | None, arg(default="m, or the unit of the drawing")] = None
    """Unit of the numbers in --shape."""
    sensor: Sensor = "digit"
    images: Annotated[str | None, arg("TOPIC", "the only image topic")] = None
    """Touch images."""
    sensor_poses: Annotated[str | None, arg("TOPIC|PARENT:CHILD", "the only source of poses")] = None
    """Poses of the sensor: a topic, or two frames of the transforms."""
    object_poses: Annotated[str | None, arg("TOPIC|PARENT:CHILD", "none")] = None
    """Poses of the object, which are ground truth: a topic, or two frames."""
    clock: Literal["header", "log"] = "header"
    """Times in the headers of messages, or those at which they were recorded."""
    time_offset: Annotated[
        float | Literal["fit"],
        arg(
            "S|fit",
            help="Offset added to the times of images [s], negative where they are stamped late; fit estimates it from "
            "the starts of contacts, which needs a first pose or ground truth.",
        ),
    ] = 0.0
    plane: Annotated[tuple[float, float, float] | Literal["fit"], arg("X Y Z|fit")] = (0.0, 0.0, 1.0)
    """Normal of the plane of the push in the frame of the poses; fit takes the plane through the sensor's path."""
    off_plane: Annotated[float, arg("METRES")] = 0.01
    """Largest distance of poses from that plane [m]."""

    def read(self, file: Path) -> "Recording | BagReading":
        """Read a recording or, with --shape, a bag of ROS messages. Raises SettingError for options that do not fit."""
        from palpate import io as formats
        from palpate.errors import SettingError
        from palpate.io.outlines import load_shape
        from palpate.io.rosbag_recording import BagChoices, read_bag
        from palpate.types.sensor import known_sensor

        if self.shape is None:
            if given := [name for name, value in asdict(self).items() if value != getattr(Bag(), name)]:
                names = ", ".join(f"--{name.replace('_', '-')}" for name in given)
                raise SettingError(f"{names}: only for bags, together with --shape")
            return formats.load_recording(file)
        if formats.detect_format(file) != "bag":
            raise SettingError(f"--shape {self.shape}: {file} is no bag, so the object's outline is in the file")
        choices = BagChoices(
            self.images,
            self.sensor_poses,
            self.object_poses,
            self.clock,
            0.0 if self.time_offset == "fit" else self.time_offset,
            self.plane,
            self.off_plane,
        )
        return read_bag(file, load_shape(self.shape, self.shape_unit), choices, known_sensor(self.sensor))


@dataclass(frozen=True)
class Workers:
    """Processes that share the work."""

    workers: Annotated[int, arg("N")] = 1
    """Processes on this machine."""
    dask: Annotated[str | None, arg("ADDRESS", "none")] = None
    """Address of the scheduler of a Dask cluster, which sees the same files."""


def check_new(path: Path, force: bool) -> None:
    """Raise FileError if a file exists and may not be replaced."""
    from palpate.errors import FileError

    if path.exists() and not force:
        raise FileError(f"{path}: already exists; --force replaces it")


def check_model(model: Path | None, tactile: Collection[str]) -> None:
    """Raise SettingError if a touch model is given and no mode of touch uses one."""
    from palpate.errors import SettingError

    if model is not None and not any(mode.startswith(("learnt", "auto")) for mode in tactile):
        raise SettingError(f"--model {model} is not used with --tactile {' '.join(tactile)}; use learnt")


def check_window() -> None:
    """Raise SettingError if no window can be opened for --view."""
    from palpate.errors import SettingError
    from palpate.viewer.rerun_view import has_display

    if not has_display():
        raise SettingError("--view: there is no display to open a window on")


def pressure_of(text: str) -> str | float:
    """Return --pressure as a name or a friction radius [m]; SettingError where it is neither."""
    from palpate.errors import SettingError
    from palpate.geometry.shapes import PRESSURES

    if text in PRESSURES:
        return text
    try:
        radius = float(text)
    except ValueError:
        radius = math.nan
    if not 0.0 < radius < math.inf:
        raise SettingError(
            f"--pressure is {text!r}; allowed are {', '.join(PRESSURES)} or a friction radius above 0 [m]"
        )
    return radius
