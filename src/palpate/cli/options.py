"""Options that several commands share, each declared once, with what they mean to all of them."""

import math
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.constructors import PrimitiveConstructorSpec

from palpate.shards import Shard

# Said again here so that --help need not import the estimator; a test compares them.
Tactile = Literal[
    "none", "constant", "oracle", "learnt", "learnt-linear", "learnt-pairs", "learnt-turn", "learnt-direction"
]
TactileChoice = Literal["auto", Tactile]
SmootherName = Literal["fixed-lag", "isam2", "batch", "particle-filter"]

ShapeUnit = Literal["m", "cm", "mm", "in"]

NOISE = "palpate|sticking|published|FILE"
"""What an option that takes noise settings shows of what it takes."""

RecordingsFolder = Annotated[
    tyro.conf.Positional[Path],
    tyro.conf.arg(metavar="DIR", help="Folder of recordings, also in folders in it, in any known format."),
]
_TOUCH_SAYS = (
    "What touch says: nothing, no turning, the truth, or what a model reads from images: by each image, by pairs of "
    "images (linear is the paper's), the turn or the contact's direction alone"
)
TactileOption = Annotated[
    TactileChoice,
    tyro.conf.arg(help=f"{_TOUCH_SAYS}; auto is learnt where there are images that fit the model, else none."),
]
ModelOption = Annotated[
    Path | None,
    tyro.conf.arg(
        metavar="MODEL", help="Folder of a touch model.", help_behavior_hint="(default: the one of the sensor)"
    ),
]
SensorOption = Annotated[str, tyro.conf.arg(metavar="NAME", help="The sensor: digit or gelsight-mini.")]
CalibrationOption = Annotated[
    Path | None,
    tyro.conf.arg(
        metavar="UNIT.npz",
        help="How this sensor unit looks untouched, from palpate calibrate.",
        help_behavior_hint="(default: as in the first half second)",
    ),
]
UnitOption = Annotated[
    Path | None,
    tyro.conf.arg(
        metavar="UNIT.npz",
        help="How the one sensor unit that all recordings are of looks untouched, from palpate calibrate.",
        help_behavior_hint="(default: as in the first half second of each)",
    ),
]


Numbers = tuple[float, float, float]
"""A pose or its standard deviations [m, m, rad]."""


def _three_numbers(option: str, wanted: str) -> PrimitiveConstructorSpec[Numbers | None]:
    """How three numbers are parsed, with one sentence where they are something else."""

    def parse(words: list[str]) -> Numbers | None:
        from palpate.errors import SettingError

        try:
            x, y, theta = map(float, words)
        except ValueError:
            raise SettingError(f"{option} is {' '.join(words)!r}; it must be three numbers, {wanted}") from None
        return x, y, theta

    return PrimitiveConstructorSpec(
        nargs=3,
        metavar="X Y THETA",
        instance_from_str=parse,
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda value: [] if value is None else [f"{number:g}" for number in value],
    )


FirstPoseOption = Annotated[
    Numbers | None,
    _three_numbers("--first-pose", "x [m], y [m] and theta [rad]"),
    tyro.conf.arg(
        metavar="X Y THETA",
        help="Object pose at the start [m, m, rad].",
        help_behavior_hint="(default: as the recording states it, else from ground truth)",
    ),
]
FirstPoseSigmaOption = Annotated[
    Numbers | None,
    _three_numbers("--first-pose-sigma", "standard deviations of x [m], y [m] and theta [rad]"),
    tyro.conf.arg(
        metavar="SX SY STHETA",
        help="Standard deviations of the pose at the start [m, m, rad]; touch finds an object that is known roughly.",
        help_behavior_hint="(default: that of the noise settings)",
    ),
]
FirstPoseUnknownOption = Annotated[
    bool,
    tyro.conf.arg(
        help="Nothing is known of the pose at the start: the object is within a metre of the world's origin, at any "
        "yaw, and touch finds it."
    ),
]
HypothesesOption = Annotated[
    int | None,
    tyro.conf.arg(
        metavar="N",
        help="How many answers are kept at most while touch cannot tell; a contact may begin with more for its first "
        "frames. 1 keeps one whatever happens.",
        help_behavior_hint="(default: that of the tracker)",
    ),
]
SmootherOption = Annotated[
    SmootherName,
    tyro.conf.arg(
        help="How the graph is solved: over the last steps, by iSAM2 or as a whole at each step; or a particle "
        "filter on the same measurements."
    ),
]
NoiseOption = Annotated[
    str, tyro.conf.arg(metavar=NOISE, help="Standard deviations: a preset, or a file of palpate tune.")
]
PressureOption = Annotated[
    str,
    tyro.conf.arg(
        metavar="uniform|rim|corner|METRES", help="How the object presses on the table, or its friction radius c [m]."
    ),
]
WorkersOption = Annotated[int, tyro.conf.arg(metavar="N", help="Processes that share the work.")]
DaskOption = Annotated[
    str | None,
    tyro.conf.arg(
        metavar="ADDRESS",
        help="Share the work among a Dask cluster; its scheduler's address. To track recordings, it has to see the "
        "same files.",
        help_behavior_hint="(default: none)",
    ),
]
ShardOption = Annotated[
    Shard | None,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="I/N",
        instance_from_str=lambda words: _shard(words[0]),
        is_instance=lambda value: value is None or isinstance(value, Shard),
        str_from_instance=lambda value: [] if value is None else [f"{value.number}/{value.count}"],
    ),
    tyro.conf.arg(
        metavar="I/N",
        help="Do every N-th recording only, beginning with the I-th; as many processes, on any machines that see the "
        "same folder, do the rest.",
        help_behavior_hint="(default: all)",
    ),
]
ShapeUnitOption = Annotated[
    ShapeUnit | None,
    tyro.conf.arg(help="Unit of the numbers in --shape.", help_behavior_hint="(default: m, or what a drawing says)"),
]
ForceOption = Annotated[bool, tyro.conf.arg(help="Replace what is there already.")]
JsonOption = Annotated[bool, tyro.conf.arg(help="Print one JSON object.")]


def _shard(text: str) -> Shard:
    from palpate.errors import SettingError

    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal()):
        raise SettingError(f"--shard is {text!r}; allowed are 1/N to N/N, such as 3/8")
    return Shard(int(number), int(count))


def stated_first_pose(
    first_pose: Numbers | None, sigma: Numbers | None, unknown: bool
) -> tuple[Numbers | None, Numbers | None]:
    """Return the first pose and its sigma as --first-pose, --first-pose-sigma and --first-pose-unknown say them.

    Raises SettingError where the last comes with one of the others.
    """
    from palpate.errors import SettingError
    from palpate.tracker_arguments import ANYWHERE, ANYWHERE_SIGMA

    if not unknown:
        return first_pose, sigma
    if first_pose is not None or sigma is not None:
        given = "--first-pose" if first_pose is not None else "--first-pose-sigma"
        raise SettingError(f"--first-pose-unknown says that nothing is known of the first pose, and {given} is given")
    return ANYWHERE, ANYWHERE_SIGMA


def check_new(path: Path, force: bool) -> None:
    """Raise FileError if a file to be written is there already and is not to be replaced."""
    from palpate.errors import FileError

    if path.exists() and not force:
        raise FileError(f"{path}: already exists; --force replaces it")


def check_window(instead: str = "") -> None:
    """Raise SettingError where a view is asked for that cannot be opened; `instead` says what else can be done."""
    from palpate.errors import SettingError
    from palpate.viewer.rerun_view import check_rerun, has_display

    check_rerun()
    if not has_display():
        raise SettingError(f"--view: there is no display to open a window on{instead}")


def check_model(model: Path | None, tactile: Collection[str]) -> None:
    """Raise SettingError if a touch model is given and no mode of touch takes one."""
    from palpate.errors import SettingError

    if model is not None and not any(mode.startswith(("learnt", "auto")) for mode in tactile):
        raise SettingError(f"--model {model} is of no use with --tactile {' '.join(tactile)}; a learnt one takes it")


def pressure_of(text: str) -> str | float:
    """Return what --pressure says: a name, or a friction radius [m]; SettingError where it is neither."""
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
