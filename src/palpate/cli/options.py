"""Options that several commands share: one frozen dataclass a group of the help.

A command takes these groups as parameters (`start: Start = Start()`); tyro makes the options from their fields and the
help from the docstrings. Nothing heavy is imported before a method is called, so that `--help` stays fast. Defaults
that Python has too are in `palpate.types.choices`.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import tyro

import palpate
from palpate.errors import SettingError
from palpate.types.choices import (
    DEFAULT_NOISE,
    DEFAULT_SENSOR,
    BagChoices,
    MarkersChoice,
    SmootherName,
    TactileChoice,
    TrackerChoices,
    Unit,
)

Numbers = tuple[float, float, float]
"""A pose or its standard deviations [m, m, rad]."""

NOISE = "palpate|FILE"
"""Metavar of an option that takes noise settings."""


def arg(metavar: str | None = None, default: str | None = None, *, help: str | None = None, **more: Any) -> Any:
    """Return tyro's argument with a metavar and, if the default is not a plain value, words that describe it.

    `help` is for texts of several lines; tyro takes a shorter one from the docstring under the field.
    """
    return tyro.conf.arg(metavar=metavar, help=help, help_behavior_hint=default and f"(default: {default})", **more)


RecordingsFolder: TypeAlias = Annotated[
    Path, arg("DIR", help="Folder of recordings in any known format; folders in it are searched too.")
]
Force: TypeAlias = Annotated[bool, tyro.conf.arg(help="Replace existing output.")]
Sensor: TypeAlias = Annotated[
    str, tyro.conf.arg(metavar="NAME|FILE", help="Sensor: digit, gelsight-mini, or a profile, my_sensor.toml.")
]
Marker: TypeAlias = Annotated[
    MarkersChoice,
    arg(help="Dark dots on the gel are found and left out (auto), or images are taken as they are (off)."),
]
Orientation: TypeAlias = Annotated[
    str,
    arg(
        "WORDS",
        "as they come",
        help="Steps to make images upright: 90, 180, 270 (degrees counter-clockwise), mirrored, bgr; or upright alone.",
    ),
]


@dataclass(frozen=True)
class Start:
    """The object's pose at the start. By default the recording's own, else its first ground truth."""

    first_pose: Annotated[Numbers | None, arg("X Y THETA", "from the recording")] = None
    """Object pose in the world [m, m, rad]."""
    first_pose_sigma: Annotated[Numbers | None, arg("SX SY STHETA", "from the recording, else the noise settings")] = (
        None
    )
    """Its standard deviations [m, m, rad]. With large ones, touch finds the object."""
    first_pose_unknown: bool = False
    """The pose is unknown: within 1 m of the world's origin, at any yaw. Touch finds the object."""

    def pose_and_sigma(self) -> tuple[Numbers | None, Numbers | None]:
        """Return the first pose and its sigma, None where not given. Raises SettingError where options conflict."""
        from palpate.config import ANYWHERE_SIGMA

        if not self.first_pose_unknown:
            return self.first_pose, self.first_pose_sigma
        if self != Start(first_pose_unknown=True):
            raise SettingError("--first-pose-unknown cannot be combined with --first-pose or --first-pose-sigma")
        return (0.0, 0.0, 0.0), ANYWHERE_SIGMA


@dataclass(frozen=True)
class SensorUnit:
    """The model and calibration of the sensor."""

    model: Annotated[Path | None, arg("MODEL", "the sensor's own")] = None
    """Folder of a touch model, or the name of a sensor whose own it is."""
    calibration: Annotated[Path | None, arg("UNIT.npz", "the first half second is taken as untouched")] = None
    """Calibration of the sensor unit, from palpate calibrate."""
    markers: Marker = TrackerChoices.markers

    def load(self, *tactile: str) -> "tuple[palpate.TouchModel | None, palpate.Calibration | None]":
        """Read model and calibration, None where not given. Raises SettingError for a model that no touch uses."""
        if self.model is not None and not any(mode.startswith(("learnt", "auto")) for mode in tactile):
            raise SettingError(f"--model {self.model} is not used with --tactile {' '.join(tactile)}; use learnt")
        unit = self.calibration and palpate.load_calibration(self.calibration)
        return self.model and palpate.TouchModel(self.model), unit


@dataclass(frozen=True)
class Touch(SensorUnit):
    """Touch measurements, and the model and calibration of the sensor."""

    tactile: Annotated[
        TactileChoice,
        arg(
            help="Measurements of touch: none (contact only), learnt (read from images by a model) or oracle (from "
            "ground truth); auto is learnt where there are images that the model can read, else none."
        ),
    ] = TrackerChoices.tactile


@dataclass(frozen=True)
class Estimator:
    """The estimator: solver, noise, and hypotheses."""

    smoother: SmootherName = TrackerChoices.smoother
    """Solve the graph over the last steps of a contact, or over all of them."""
    noise: Annotated[str, arg(NOISE)] = DEFAULT_NOISE
    """Standard deviations: those of palpate, or a file of palpate tune."""
    hypotheses: Annotated[int, arg("N")] = TrackerChoices.hypotheses
    """Largest number of hypotheses kept while touch is ambiguous; more are allowed at the start of a contact."""

    def settings(
        self, tactile: TactileChoice, markers: MarkersChoice = TrackerChoices.markers
    ) -> "palpate.TrackerSettings":
        """Return the settings of a tracker."""
        from palpate.noise_file import noise_of

        return palpate.TrackerSettings(tactile, self.smoother, self.hypotheses, markers, noise_of(self.noise))


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
    shape_unit: Annotated[Unit | None, arg(default="m, or the unit of the drawing")] = None
    """Unit of the numbers in --shape."""
    sensor: Sensor = DEFAULT_SENSOR
    choices: BagChoices = field(default_factory=BagChoices)

    def read(self, file: Path) -> "palpate.BagReading":
        """Read a recording or, with --shape, a bag of ROS messages and the plane of its push. Raises SettingError."""
        from palpate.io import detect_format
        from palpate.types.sensor_file import known_sensor
        from palpate.types.space import flat

        orientation = self.choices.orientation
        if self.shape is None and self != Bag(choices=BagChoices(orientation)):
            raise SettingError("--sensor, --images and the other options for bags need --shape, too")
        if self.shape is None:
            return palpate.BagReading(palpate.load_recording(file, orientation), flat())
        kind = detect_format(file)
        if kind is None:  # reading it raises an error that says what is wrong with the file
            return palpate.BagReading(palpate.load_recording(file, orientation), flat())
        if kind != "bag":
            raise SettingError(f"--shape {self.shape}: {file} is no bag, so the object's outline is in the file")
        shape = palpate.load_shape(self.shape, self.shape_unit)
        return palpate.read_bag(file, shape, self.choices, known_sensor(self.sensor))


@dataclass(frozen=True)
class Workers:
    """Processes that share the work."""

    workers: Annotated[int, arg("N")] = 1
    """Processes on this machine."""
    dask: Annotated[str | None, arg("ADDRESS", "none")] = None
    """Address of the scheduler of a Dask cluster, which sees the same files."""
