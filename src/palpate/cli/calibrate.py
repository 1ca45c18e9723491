"""`palpate calibrate`: how a sensor unit looks while nothing touches it, and how its images lie."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from palpate.cli.options import ForceOption, JsonOption, ModelOption, check_new

if TYPE_CHECKING:
    from palpate.types.recording import Recording
    from palpate.types.sensor import SensorProfile


def calibrate(
    file: Annotated[
        tyro.conf.Positional[Path | None],
        tyro.conf.arg(
            metavar="[FILE]",
            help="A recording with images, of which some show no contact.",
            help_behavior_hint="",
        ),
    ] = None,
    /,
    *,
    out: Annotated[Path, tyro.conf.arg(metavar="UNIT.npz", help="File of the calibration.")],
    presses: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="PRESSES",
            help="Presses at known angles: a CSV with the columns file, an image beside it, and angle_deg, of the "
            "contact on the tip; or a recording of presses on an object whose outline and poses are known, or on a "
            "disc that stays anywhere. Five or more tell left from right in the camera's images and what is off in "
            "directions. A CSV with the column file alone is of presses by hand, in order from -y to +y; these tell "
            "left from right alone.",
            help_behavior_hint="",
        ),
    ] = None,
    untouched: Annotated[
        tuple[Path, ...],
        tyro.conf.arg(
            metavar="IMAGE",
            help="Images of the untouched gel in place of FILE. A recording of presses needs neither.",
            help_behavior_hint="",
        ),
    ] = (),
    sensor: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="NAME",
            help="The sensor of images in files: digit or gelsight-mini.",
            help_behavior_hint="(default: the recording's, else digit)",
        ),
    ] = None,
    model: ModelOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> int:
    """Learn a sensor unit: its untouched images, and from presses how its images are read and directions are off.

    The untouched images are files, or a recording's frames without contact: its contact flags say which these are;
    where it has none, they are all. Nothing may touch in them.
    """
    from palpate.cli.calibration_info import noise_of, noise_words
    from palpate.cli.console import print_json, print_line
    from palpate.errors import SettingError
    from palpate.touch.calibration import write_calibration

    if file is None and not untouched and presses is not None and presses.suffix.lower() != ".csv":
        file = presses  # between presses it shows the untouched gel
    if (file is None) == (not untouched):
        raise SettingError("calibrate: name a recording or --untouched images, one of the two, also beside --presses")
    if model is not None and presses is None:
        raise SettingError("calibrate: --model reads presses, and without --presses there are none")
    picture = out.with_suffix(".png")
    if presses is not None and picture == out:
        raise SettingError(f"--out {out}: is where the figure of presses goes; name a file that ends in .npz")
    check_new(out, force)
    if presses is not None:
        calibration, numbers, said = _pressed(presses, file, untouched, sensor, model, picture, force)
    elif file is not None:
        calibration, numbers, said = _rested(file, sensor)
    else:
        calibration, numbers, said = _seen(untouched, sensor)
    write_calibration(calibration, out, overwrite=force)
    height, width = calibration.background.mean.shape[:2]
    noise = noise_of(calibration)
    if json:
        size = {"height": height, "width": width, "noise_levels": noise}
        print_json({"file": None if file is None else str(file), "out": str(out), **size, **numbers})
    else:
        print_line(f"{out}: {height} x {width} px, noise {noise_words(noise)}, {said}")
    return 0


def _rested(file: Path, sensor: str | None) -> tuple[Any, dict[str, Any], str]:
    """Return the calibration, its numbers and words, of a recording's frames without contact."""
    from palpate import io as formats
    from palpate.cli.console import progress_bar
    from palpate.touch.calibration import Calibration, calibrate, untouched_frames

    recording = formats.load_recording(file)
    _sensor_of({file: recording}, sensor)
    with progress_bar(f"calibrating on {file.name}", len(untouched_frames(recording))) as progress:
        background, frames = calibrate(recording, progress)
    return Calibration(background), {"frames": frames}, f"from {frames} frames without contact"


def _seen(untouched: tuple[Path, ...], sensor: str | None) -> tuple[Any, dict[str, Any], str]:
    """Return the calibration, its numbers and words, of images of the untouched gel."""
    from palpate.errors import FileError
    from palpate.touch.background import background_of_stills
    from palpate.touch.calibration import Calibration, misfit
    from palpate.touch.press_files import read_image
    from palpate.types.sensor import known_sensor

    still = [read_image(each, grey=True) for each in untouched]
    (height, width), first = still[0].shape[:2], untouched[0]
    for each, image in zip(untouched, still, strict=True):
        if image.shape[:2] != (height, width):
            found = f"{image.shape[0]} x {image.shape[1]} px"
            raise FileError(f"{each}: is an image of {found}, and {first} of {height} x {width}")
    calibration = Calibration(background_of_stills(still), file=first)
    if sensor is not None and (wrong := misfit(calibration, known_sensor(sensor))):
        raise FileError(wrong)
    return calibration, {"images": len(still)}, f"from {len(still)} image{'s' * (len(still) > 1)}"


def _sensor_of(recordings: "dict[Path, Recording]", named: str | None) -> "SensorProfile":
    """Return the sensor of recordings or, where there are none, the named one, by default a DIGIT.

    Raises SettingError where two of them are not the same.
    """
    from palpate.errors import SettingError
    from palpate.types.sensor import DIGIT, known_sensor

    sensors = {str(path): recording.sensor for path, recording in recordings.items()}
    if named is not None:
        sensors[f"--sensor {named}"] = known_sensor(named)
    if not sensors:
        return DIGIT
    (path, first), *others = sensors.items()
    for other, sensor in others:
        if sensor.name != first.name:
            raise SettingError(f"{path}: is of sensor {first.name!r}, and {other} is {sensor.name!r}")
    return first


def _pressed(
    presses: Path,
    file: Path | None,
    untouched: tuple[Path, ...],
    named: str | None,
    model: Path | None,
    picture: Path,
    force: bool,
) -> tuple[Any, dict[str, Any], str]:
    """Return the calibration, its numbers and words, of presses, and draw what they tell."""
    import math

    from palpate import io as formats
    from palpate.errors import FileError
    from palpate.files import in_file, whole_file
    from palpate.lab.train.presses_of import presses_of
    from palpate.touch.background import is_grey
    from palpate.touch.calibration import untouched_images
    from palpate.touch.model import TouchModel, shipped_model
    from palpate.touch.modes import GREY
    from palpate.touch.press_calibration import learn_from_presses
    from palpate.touch.press_figure import press_figure
    from palpate.touch.press_files import read_image, read_presses

    check_new(picture, force)
    is_table = presses.suffix.lower() == ".csv"
    paths = (file, None if is_table else presses)
    recordings = {path: formats.load_recording(path) for path in paths if path is not None}
    sensor = _sensor_of(recordings, named)
    may_be_grey = model is not None  # one of the user's own
    if file is None:
        still = [read_image(each, may_be_grey) for each in untouched]
    else:
        still = list(untouched_images(recordings[file]))
    given = read_presses(presses, may_be_grey, in_order=True) if is_table else presses_of(recordings[presses])
    for each, images in ((file, still), (presses, given.images)):
        if not may_be_grey and any(map(is_grey, images)):
            raise FileError(f"{each}: {GREY}")
    reads = TouchModel(model) if model else shipped_model(sensor.name)
    with in_file(presses):
        fit = learn_from_presses(given, still, sensor, reads)
    with whole_file(picture, overwrite=force) as part:
        press_figure(given, fit).savefig(part, dpi=110, format="png")
    view, direction = fit.calibration.view, fit.calibration.direction
    known = given.is_measured
    numbers = {
        "presses": len(given.images),
        "view": str(view),
        "keeps_left_and_right": view.keeps_left_and_right,
        "offset_deg": math.degrees(direction.offset) if known else None,
        "scale": direction.scale if known else None,
        "scatter_deg": math.degrees(fit.scatter),
        "picture": str(picture),
    }
    # All else that the view says is no finding: `scripts/measure_press_views.py`.
    caution = (
        "Presses tell left from right only: up and down are as fits best, and may be otherwise; so is the colours' "
        "order of a unit that is unlike the others."
    )
    if not view.keeps_left_and_right:
        sign = "Angles of the wrong sign look" if known else "Presses in the wrong order look"
        caution += f"\n{sign} the same as images that lie like this: positive is towards +y."
    if known:
        off = f"directions are off by {numbers['offset_deg']:+.2f} degrees and {direction.scale - 1.0:+.1%}"
        found = f"{off}, {numbers['scatter_deg']:.2f} degrees about the line"
    else:
        found = f"directions are {numbers['scatter_deg']:.2f} degrees about the places of the imprints"
    words = f"images read {view}; {len(given.images)} presses: {found}; see {picture}\n{caution}"
    return fit.calibration, numbers, words
