"""What several commands ask about bags, said once, and how they load a recording with it."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from palpate.cli.options import SensorOption, ShapeUnitOption

if TYPE_CHECKING:
    from palpate.io.rosbag_recording import BagChoices, BagReading
    from palpate.types.recording import Recording


@dataclass(frozen=True)
class BagOptions:
    """How to read a FILE that is a bag of ROS messages."""

    # Defaults are said again so that --help need not import NumPy; a test compares them with `BagChoices`.
    shape: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="NAME|AxB|FILE",
            help="The object: a name as palpate simulate has them, the sides of a rectangle such as 0.09x0.06 [m], or "
            "an outline in a file: CSV, JSON, SVG or DXF.",
            help_behavior_hint="(required for bags)",
        ),
    ] = None
    shape_unit: ShapeUnitOption = None
    sensor: SensorOption = "digit"
    images: Annotated[
        str | None,
        tyro.conf.arg(metavar="TOPIC", help="Touch images.", help_behavior_hint="(default: the only image topic)"),
    ] = None
    sensor_poses: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="TOPIC|PARENT:CHILD",
            help="Poses of the sensor: a topic, or two frames between which transforms lead.",
            help_behavior_hint="(default: the only source of poses)",
        ),
    ] = None
    object_poses: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="TOPIC|PARENT:CHILD",
            help="Poses of the object, likewise: ground truth.",
            help_behavior_hint="(default: none)",
        ),
    ] = None
    clock: Annotated[
        Literal["header", "log"], tyro.conf.arg(help="Times in the messages' headers, or of their recording.")
    ] = "header"
    time_offset: Annotated[
        float | Literal["fit"],
        tyro.conf.arg(
            metavar="S|fit",
            help="Added to the times of images [s], negative where they are stamped late; or fitted to when contacts "
            "begin, which takes a first pose or ground truth.",
        ),
    ] = 0.0
    plane: Annotated[
        tuple[float, float, float] | Literal["fit"],
        tyro.conf.arg(
            metavar="X Y Z|fit", help="Normal of the plane of the push in the frame of the poses, or fitted to them."
        ),
    ] = (0.0, 0.0, 1.0)
    off_plane: Annotated[float, tyro.conf.arg(metavar="METRES", help="How far poses may be off that plane [m].")] = 0.01


BAG_DEFAULTS = BagOptions()
Bag = Annotated[BagOptions, tyro.conf.arg(name="")]
"""The options of `BagOptions` as options of a command."""


def choices_of(options: BagOptions) -> "BagChoices":
    """What the options say of a bag, object and sensor left out; an offset that is still to be fitted is none."""
    from palpate.io.rosbag_recording import BagChoices

    said = asdict(options)
    del said["shape"], said["shape_unit"], said["sensor"]
    if options.time_offset == "fit":
        said["time_offset"] = 0.0
    return BagChoices(**said)


def read_with(file: Path, options: BagOptions) -> "Recording | BagReading":
    """The recording in a file or, if it is a bag and a shape is given, in what its reading told.

    Raises SettingError for options that are of no use.
    """
    from palpate import io as formats
    from palpate.errors import SettingError
    from palpate.io.outlines.load import load_shape
    from palpate.io.rosbag_recording import read_bag
    from palpate.types.sensor import known_sensor

    if options.shape is None:
        if options != BAG_DEFAULTS:
            given = [name for name, value in asdict(options).items() if value != getattr(BAG_DEFAULTS, name)]
            names = ", ".join(f"--{name.replace('_', '-')}" for name in given)
            raise SettingError(f"{names} can be used for bags only, with --shape")
        return formats.load_recording(file)
    if formats.detect_format(file) != "bag":
        raise SettingError(f"--shape {options.shape}: {file} is no bag, so it tells the object's outline itself")
    sensor = known_sensor(options.sensor)
    return read_bag(file, load_shape(options.shape, options.shape_unit), choices_of(options), sensor)


def read_to_convert(file: Path, options: BagOptions) -> tuple["Recording", list[str]]:
    """The recording in a file, and what a bag holds beyond it, in words."""
    from palpate.types.recording import Recording

    reading = read_with(file, options)
    if isinstance(reading, Recording):
        return reading, []
    unused = [f"topic {topic}" for topic in reading.mapping.unused]
    return reading.recording, ["poses between images", "heights and tilts", *unused]
