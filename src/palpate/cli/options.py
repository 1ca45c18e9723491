"""Options that several commands share: one frozen dataclass a group of the help.

A command takes these groups as parameters (`start: Start = Start()`); tyro makes the options from their fields and the
help from the docstrings. Nothing heavy is imported before a method is called, so that `--help` stays fast. Defaults
that Python has too are in `palpate.types.choices`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import tyro

import palpate
from palpate.cli.quantities import ANGLE, LENGTH, PURE, TIME, quantities, quantity
from palpate.errors import PalpateError, SettingError, kept_warnings
from palpate.types.choices import (
    DEFAULT_NOISE,
    DEFAULT_SENSOR,
    BagChoices,
    MarkersChoice,
    Normal,
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

    first_pose: Annotated[
        Numbers | None,
        quantities("--first-pose", "X Y THETA", LENGTH, LENGTH, ANGLE),
        arg("X Y THETA", "from the recording"),
    ] = None
    """Object pose in the world [m, m, rad], or with units, as 120mm 0 17deg."""
    first_pose_sigma: Annotated[
        Numbers | None,
        quantities("--first-pose-sigma", "SX SY STHETA", LENGTH, LENGTH, ANGLE),
        arg("SX SY STHETA", "from the recording, else the noise settings"),
    ] = None
    """Its standard deviations [m, m, rad], or with units. With large ones, touch finds the object."""
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
    """Calibration of the sensor unit, from palpate calibrate; of a hand FINGER=UNIT.npz for each, with commas."""
    markers: Marker = TrackerChoices.markers

    def load(self, *tactile: str) -> "tuple[palpate.TouchModel | None, Any]":
        """Read model and calibration, None where not given; of a hand, calibrations by finger.

        Raises SettingError for a model that no touch uses.
        """
        from palpate.types.hand import by_finger

        if self.model is not None and not any(mode.startswith(("learnt", "auto")) for mode in tactile):
            raise SettingError(f"--model {self.model} is not used with --tactile {' '.join(tactile)}; use learnt")
        model = self.model and palpate.TouchModel(self.model)
        if self.calibration is not None and "=" in str(self.calibration) and not self.calibration.exists():
            files = by_finger("--calibration", str(self.calibration))
            return model, {finger: palpate.load_calibration(file) for finger, file in files.items()}
        return model, self.calibration and palpate.load_calibration(self.calibration)


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
class BagOptions(BagChoices):
    """Settings for reading a bag, as options; their texts are those of BagChoices."""

    orientation: Annotated[str, arg("WORDS", "as they come")] = ""
    sensor_T_gel: Annotated[
        tuple[float, float, float, float, float, float, float] | None,
        quantities("--sensor-T-gel", "X Y Z QX QY QZ QW", LENGTH, LENGTH, LENGTH, PURE, PURE, PURE, PURE),
        arg(
            "X Y Z QX QY QZ QW",
            "they are poses of the gel",
            help="Pose of the gel in the frame of the sensor's poses, such as that of a flange [m, quaternion].",
        ),
    ] = None
    time_offset: Annotated[float, quantities("--time-offset", "S", TIME), arg("S", "0")] = 0.0
    plane: Annotated[
        Normal, quantities("--plane", "X Y Z|fit", PURE, PURE, PURE, word="fit"), arg("X Y Z|fit", "0 0 1")
    ] = (
        0.0,
        0.0,
        1.0,
    )
    off_plane: Annotated[float, quantities("--off-plane", "M", LENGTH), arg("M", "10mm")] = 0.01
    images: Annotated[str | None, arg("TOPIC|DIR", "the only one")] = None
    image_times: Annotated[Path | None, arg("TABLE", "none; images are in the bag")] = None
    sensor_poses: Annotated[str | None, arg("TOPIC|PARENT:CHILD", "the only one")] = None
    object_poses: Annotated[str | None, arg("TOPIC|PARENT:CHILD", "none")] = None


@dataclass(frozen=True)
class Bag:
    """The object and the topics, for bags of ROS messages."""

    shape: Annotated[
        str | None,
        arg(
            "NAME|AxB|FILE",
            "none; bags need it",
            help="The object: a name as in palpate simulate, the sides of a rectangle such as 0.09x0.06 [m] or "
            "90mmx60mm, or an outline in a file (CSV, JSON, SVG or DXF). With track and live also unknown, or "
            "unknown:50mm-200mm with its least and largest width: touch learns it.",
        ),
    ] = None
    shape_unit: Annotated[Unit | None, arg(default="m, or the unit of the drawing")] = None
    """Unit of the numbers in --shape."""
    shape_layer: Annotated[str | None, arg("NAME", "the only one with an outline")] = None
    """Layer of the outline in a drawing; of an SVG also the name of a group or an element."""
    sensor: Sensor = DEFAULT_SENSOR
    mounts: Annotated[tuple[str, ...], arg("FINGER=X,Y,YAW", "none; a hand in a bag needs them")] = ()
    """Pose of each finger of a hand in the hand's frame [m, rad, or with units], as left=0,20mm,0 right=0,-20mm,0. Then
    --images is left=TOPIC,right=TOPIC, and --sensor is of all fingers or left=NAME,right=NAME."""
    choices: Annotated[BagOptions, tyro.conf.arg(name="")] = field(default_factory=BagOptions)

    def read(self, file: Path) -> "palpate.BagReading":
        """Read a recording or, with --shape, a bag of ROS messages and the plane of its push. Raises SettingError."""
        from palpate.io import detect_format
        from palpate.types.sensor_file import known_sensor
        from palpate.types.space import flat

        orientation = self.choices.orientation
        kind = detect_format(file)
        if kind != "bag":  # reading a file of no known format raises an error that says what is wrong with it
            gel = self.choices.sensor_T_gel
            if kind is not None and self != Bag(choices=BagOptions(orientation, gel)):
                raise SettingError(
                    f"{file}: is no bag but a recording, whose outline, sensor and times are settled; of the options "
                    "for bags only --orientation and --sensor-T-gel apply to it (track and live also learn an outline: "
                    "--shape unknown, or --shape FILE with --outline-sigma)"
                )
            recording = palpate.load_recording(file, orientation)
            return palpate.BagReading(recording if gel is None else recording.moved_onto_gel(gel), flat())
        if self.shape is None:
            raise SettingError(self._missing(file))
        with kept_warnings() as warnings:
            shape = palpate.load_shape(self.shape, self.shape_unit, self.shape_layer)
        recording, plane = palpate.read_bag(file, shape, self.choices, self.hand() or known_sensor(self.sensor))
        return palpate.BagReading(recording.warned(warnings), plane)

    def hand(self, cameras: str | None = None) -> "palpate.Hand | None":
        """Return the hand that the options describe; None for one sensor. Raises SettingError.

        Its images are those of topics, or come from `cameras`.
        """
        images = cameras or self.choices.images or ""
        if not self.mounts and "=" not in self.sensor and "=" not in images:
            return None
        if not self.mounts or "=" not in images:
            needed = "--camera left=0,right=1" if cameras else "--images left=TOPIC,right=TOPIC"
            raise SettingError(f"a hand needs both --mounts left=X,Y,YAW right=X,Y,YAW and {needed}")
        return hand_in_words(self.sensor, self.mounts)

    def _missing(self, file: Path) -> str:
        """Return a sentence on all that a bag needs which is not given: the object, and topics of several."""
        from palpate.types.sensor_file import known_sensor

        needs = f"{file}: is a bag, which needs --shape NAME|AxB|FILE and, unless --object-poses has them, --first-pose"
        try:
            palpate.read_bag(file, palpate.Disc(0.05), self.choices, self.hand() or known_sensor(self.sensor))
        except PalpateError as error:
            return f"{needs}; it also {str(error).removeprefix(f'{file}: ')}"
        return needs


@dataclass(frozen=True)
class Workers:
    """Processes that share the work."""

    workers: Annotated[int, arg("N")] = 1
    """Processes on this machine."""
    dask: Annotated[str | None, arg("ADDRESS", "none")] = None
    """Address of the scheduler of a Dask cluster, which sees the same files."""


def hand_in_words(sensor: str, mounts: Sequence[str]) -> "palpate.Hand":
    """Return a hand of mounts FINGER=X,Y,YAW, and of one sensor for all fingers or FINGER=SENSOR with commas.

    Raises SettingError on other words.
    """
    from palpate.types.hand import by_finger

    placed: Any = {}
    for word in mounts:
        finger, _, numbers = word.partition("=")
        try:
            kinds = (LENGTH, LENGTH, ANGLE)
            placed[finger] = tuple(quantity(cell, kind) for cell, kind in zip(numbers.split(","), kinds, strict=True))
        except (SettingError, ValueError) as error:
            raise SettingError(f"mounts: found {word!r}; allowed is FINGER=X,Y,YAW, as left=0,20mm,0") from error
    sensors: Any = by_finger("sensor", sensor) if "=" in sensor else dict.fromkeys(placed, sensor)
    return palpate.Hand(sensors, placed)
